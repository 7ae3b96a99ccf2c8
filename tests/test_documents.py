"""What README and docs show works as it stands there."""

import ast
import re
import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer import Context
from typer.main import get_command

from pipelines.cli import app
from tests.vocabulary import pages
from tssgeom.adapt.followed import followed_numbers
from tssgeom.channel_names import numbered
from tssgeom.io.formats.columns import CHANNELS, MACHINE_CHANNELS
from tssgeom.mechanism import Drive, End, GivenRoute, tendon_count
from tssgeom.rig import Rig, read_uncertain_rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import drive_channels, simulate_machine
from tssgeom.uncertain import parted

HOME = Path(__file__).parents[1]
DOCUMENTS = [HOME / "README.md", HOME / "CONTRIBUTING.md", *pages(HOME)]
COMMANDS = [
    line.strip()
    for document in DOCUMENTS
    for line in document.read_text("utf-8").replace("\\\n", " ").splitlines()
    if re.match(r"(?:    )?(tssgeom|.*(?:&&|\|) tssgeom) +[a-z]", line) and not line.startswith("|")
]


def blocks(document: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (HOME / document).read_text("utf-8"), re.DOTALL)


def test_the_python_of_the_readme_prints_angle_and_tension_of_a_half_circle(capsys):
    _, example = blocks("README.md", "python")
    exec(example, {})
    first = capsys.readouterr().out.split()
    assert float(first[0]) == pytest.approx(3.14159265, rel=1e-8)
    assert float(first[2]) == pytest.approx(5.0 * 0.6341, rel=1e-4)  # the paper's ratio has four digits


def test_the_first_python_of_the_readme_prints_plots_and_saves(capsys, tmp_path, monkeypatch):
    import matplotlib as mpl
    import pyarrow.parquet as papq

    mpl.use("Agg")
    (tmp_path / "sample_shapes").symlink_to(HOME / "sample_shapes")
    monkeypatch.chdir(tmp_path)
    exec(blocks("README.md", "python")[0], {})
    assert capsys.readouterr().out.startswith("<FrameResult: L = ")
    assert (tmp_path / "tension.png").stat().st_size > 1000
    assert papq.read_table(tmp_path / "run.parquet").num_rows == 240


def test_the_effects_of_the_formats_are_a_rig():
    columns, _, errors, markers, scan, example, laws, joint, adapt = blocks("docs/formats.md", "toml")
    assert msgspec.toml.decode(columns, type=Rig).columns["Pos"] == "displacement_in_m:mm"
    _, uncertain = parted(msgspec.toml.decode(errors))
    assert [each.correlation for each in uncertain] == [
        {"tendon.pretension_N": -0.9995},
        {"friction.coefficient": -0.9995},
    ]
    assert len(msgspec.toml.decode(markers, type=Rig).shape.marker_offset_mm) == 4
    assert msgspec.toml.decode(scan, type=Rig).shape.source == "centreline"
    assert len(msgspec.toml.decode(example, type=Rig).effects) == 2
    assert len(msgspec.toml.decode(laws, type=Rig).effects) == 4
    assert len(msgspec.toml.decode(joint, type=Rig).effects) == 1
    followed = followed_numbers(msgspec.toml.decode(adapt, type=Rig), ["tension_in_N"])
    assert [one.hourly_change for one in followed] == [0.05, 0.2, 0.0]


@pytest.mark.parametrize("block", blocks("docs/machines.md", "toml"))
def test_a_rig_of_the_machines_is_read_and_its_drive_pulls_the_first_tendon(block, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(block, "utf-8")
    rig, uncertain = read_uncertain_rig(path)
    assert len(uncertain) == block.count('"unknown"') + block.count("sd =")
    count = tendon_count(rig.drive, rig.end)
    drive = drive_channels("motor_angle_rad" if rig.drive.radius_m else "displacement_in", count)
    run = {"time_s": np.arange(2.0), **{name: np.zeros(2) for name in drive}}
    run[drive[0]][1] = 0.1 * rig.drive.gear if rig.drive.radius_m else 1e-3
    out = simulate_machine(machine_of(rig, [Arcs.exact(np.array([0.5]), np.array([3.0]))]), run)
    before, after = out[next(numbered("tension_in_N", count))]
    assert after > before + 0.1


def test_the_page_of_the_machines_has_every_key_and_channel():
    page = (HOME / "docs" / "machines.md").read_text("utf-8")
    named = set(re.findall(r"`(?:\[\w+\] )?(\w+)`", page))
    for struct in (Drive, End, GivenRoute):
        assert set(struct.__struct_fields__) <= named
    table = page.partition("| column |")[2].partition("\n\n")[0]
    channels = set(re.findall(r"`(\w+)`", table))
    assert channels <= CHANNELS.keys() | MACHINE_CHANNELS.keys()
    in_si = {name for name, (_, per_si) in MACHINE_CHANNELS.items() if per_si == 1.0}
    assert {re.sub(r"_\d+_", "_1_", name) for name in in_si} <= channels


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_of_the_documents_has_the_options_that_they_give_it(line):
    words = re.split(r" [#|] ?", line.partition("tssgeom ")[2])[0].split()
    group = get_command(app)
    command = group.get_command(Context(group), words[0])
    known = {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
    assert {word for word in words if word.startswith("--")} <= known


def test_the_source_distribution_holds_every_folder_that_its_tests_import():
    settings = tomllib.loads((HOME / "pyproject.toml").read_text("utf-8"))
    held = {name.strip("/") for name in settings["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]}
    trees = [ast.parse(path.read_text("utf-8")) for path in (HOME / "tests").rglob("*.py")]
    nodes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    imported = {(node.module or "").partition(".")[0] for node in nodes}
    folders = {path.name for path in HOME.iterdir() if path.is_dir()} & imported
    assert {"tssgeom", "pipelines", "benchmarks", "tests"} <= folders <= held
    assert {"docs", "sample_shapes"} <= held


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.relative_to(HOME).as_posix())
def test_a_line_of_a_document_has_at_most_120_characters_where_it_can_be_broken(document):
    text = re.sub(r"```.*?```", "", document.read_text("utf-8"), flags=re.DOTALL)
    assert not [
        line for line in text.splitlines() if len(line) > 120 and not line.startswith(("|", "`python -m"))
    ]
