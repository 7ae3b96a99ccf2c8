"""CONTRIBUTING.md is done as it stands: its blocks are applied to a copy of the code, and that is tried.

One run takes effect, format and channel: its route is in the new format, its rig has the new effect and the
sensor of the new channel, and the run holds that channel. The reading has files of its own.
"""

import ast
import json
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from tssgeom.effects.kinds import Setup

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs" / "building"))

from contributing import BLOCKS, TEXT, apply_to_copy  # noqa: E402 - below docs, as the line above

NEEDED = (
    "tssgeom",
    "pipelines",
    "tests/io",
    "tests/effects",
    "tests/tendon",
    "tests/lumped",
    "tests/compiled.py",
    "pyproject.toml",
)

ROUTE = "mm\n" + "".join(f"{10 * k} 0 0\n" for k in range(31))
RIG = (
    "friction.coefficient = 0.0\n[tendon]\npretension_N = 2.0\n"
    '[[effects]]\nname = "sealed_ends"\nforce_N = 0.3\n'
)
RUN = "time_s,tension_in_N,tension_lost_N\n" + "".join(f"{k},{2 + 0.25 * k},0.6\n" for k in range(40))

CAMPAIGN = """
from pathlib import Path
import numpy as np
import tssgeom.view.quantities
from tssgeom import Arcs, read_rig
from tssgeom.identify.campaign import Campaign, Route, Run
from tssgeom.identify.readings import readings
from tssgeom.identify.prediction import run_channels
from tssgeom.plausibility.runs import fit_remarks, run_remarks
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.runs import read_run

(frame,) = open_recording("bench.stylus").frames
s = np.linalg.norm(frame.points - frame.points[0], axis=1)
route = Route("bench", Arcs.exact(s[-1:], np.zeros(1)), frame.points, s)
read, rig = read_run(Path("run.csv")), read_rig("rig.toml")
columns = {"time_s": read.time, "tension_in_N": read.tension_in, "tension_lost_N": read.tension_lost}
run = Run("run", route, columns)
assert list(fit_remarks(columns)) == []
assert not [each for each in run_remarks(columns, rig) if each.severity == "refuse"]
(reading,), _ = readings(Campaign("bench", rig, (run,)))
lost = run_channels(reading, rig)["tension_lost_N"]
print(s[-1], reading.noise["tension_lost_N"], lost[-1], *reading.measured)
"""


CARRIED = """
from pathlib import Path
from tssgeom import Rig
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.runs import read_run
from tssgeom.io.results.tables import part_of
from tssgeom.engine import process

print(*read_run(Path("current.csv")).current)
for name in ("frames.jsonl", "frames.csv"):
    part = part_of("bench", process(open_recording(name).frames, Rig(), tension_in=5.0), 1)
    print(*part.frames.column("measured_current_A").to_pylist())
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The code with all that CONTRIBUTING.md adds, compiled kernels included where there are any."""
    home = tmp_path_factory.mktemp("contributed")
    (home / "rig.toml").write_text(RIG, encoding="utf-8")
    apply_to_copy(home, NEEDED)
    (home / "tests" / "io" / "corpus" / "shape.stylus").write_text(ROUTE, encoding="utf-8")
    return home


def output_of(copy: Path, *words: str) -> str:
    """Run a module or a program of Python in the copy, and return its output; it has to succeed."""
    done = subprocess.run(
        [sys.executable, *words],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def counted(copy: Path, *words: str) -> int:
    """Run tests in the copy, and return how many passed; none may fail."""
    said = output_of(copy, "-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", *words)
    return int(re.findall(r"(\d+) passed", said)[-1])


def test_an_effect_as_contributed_keeps_the_contract_of_all_effects(copy):
    """Among the tests: size zero is the base model bit for bit, and any other size shows in each drive."""
    assert counted(copy, "tests/effects/test_contract.py", "-k", "sealed_ends") == 9
    assert counted(copy, "tests/effects/test_rig_effects.py", "-k", "sealed_ends") == 1


def test_every_test_of_the_effect_passes_by_the_command_that_is_printed(copy):
    (words,) = re.findall(r"`pytest (tests/effects -k sealed_ends)`", TEXT)
    assert counted(copy, *words.split()) > 10


def test_every_number_that_an_effect_may_change_is_listed():
    part = TEXT.partition("The fields of `Setup`")[2].partition("An effect that no")[0]
    listed = re.findall(r"`(\w+)`", part)
    assert listed == [field.name for field in fields(Setup)]


def test_a_format_as_contributed_is_read_and_survives_the_fuzz_tests(copy):
    chosen = "stylus or corpus_has_a_file"
    assert counted(copy, "tests/io/test_fuzz.py", "-k", chosen) == 4


def test_a_channel_as_contributed_shows_the_effects_that_say_so_and_no_others(copy):
    """One that moves it, one that does not, one of another sensor."""
    few = "shows_in_its_channels and tension_in_N and (viscous_drag or backlash or crosstalk)"
    assert counted(copy, "tests/effects/test_contract.py", "-k", few) == 3


def test_a_format_as_contributed_names_the_line_that_holds_no_point(copy):
    opening = (
        "from tssgeom.io.formats.files import open_recording\n"
        "try: open_recording('bad.stylus')\nexcept Exception as error: print(error)"
    )
    for text, fault in (
        ("mm\n1 2 3\n1 2\n", "line 3: no point in '1 2'"),
        ("mm\n", "line 2: no point in ''"),
    ):
        (copy / "bad.stylus").write_text(text, encoding="utf-8")
        assert output_of(copy, "-c", opening) == f"bad.stylus: {fault}: write x y z\n"


def test_a_reading_as_contributed_comes_with_runs_and_frames_and_goes_into_the_table(copy):
    points = [[10 * k, k * k, 0] for k in range(8)]
    lines = [json.dumps({"t": t, "unit": "mm", "points": points, "current_A": 0.5 + t}) for t in range(2)]
    rows = [f"{t},{x},{y},{z},{0.5 + t}" for t in range(2) for x, y, z in points]
    (copy / "frames.jsonl").write_text("\n".join(lines), encoding="utf-8")
    (copy / "frames.csv").write_text("\n".join(["time_s,x_mm,y_mm,z_mm,current_A", *rows]), encoding="utf-8")
    (copy / "current.csv").write_text("time_s,tension_in_N,current_A\n0,5,0.5\n1,6,1.5\n", encoding="utf-8")
    assert output_of(copy, "-c", CARRIED).splitlines() == ["0.5 1.5"] * 3


def test_effect_format_and_sensor_as_contributed_work_together(copy):
    for name, text in (("bench.stylus", ROUTE), ("run.csv", RUN)):
        (copy / name).write_text(text, encoding="utf-8")
    length, noise, lost, *measured = output_of(copy, "-c", CAMPAIGN).split()
    assert measured == ["tension_lost_N"]
    assert float(length) == pytest.approx(0.3, rel=1e-12)
    assert float(noise) == pytest.approx((0.02**2 + 0.005**2 / 12) ** 0.5)
    assert float(lost) == pytest.approx(2 * 0.3, abs=1e-8)  # both seals, and what an equilibrium leaves over


def test_what_is_contributed_has_the_style_and_the_layers_of_the_rest(copy):
    paths = [name for name, kind, _ in BLOCKS if kind != "toml"]
    output_of(copy, "-m", "ruff", "check", *paths)
    output_of(copy, "-m", "ruff", "format", "--check", *paths)
    output_of(copy, "-c", "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())")


def statements(code: str) -> int:
    """Return the statements of a module, its imports and docstrings aside."""
    aside = (ast.Import, ast.ImportFrom, ast.Expr)
    return sum(
        isinstance(node, ast.stmt) and not isinstance(node, aside) for node in ast.walk(ast.parse(code))
    )


@pytest.mark.parametrize("heading", ["An effect", "A format", "A reading", "A sensor"])
def test_each_addition_takes_about_ten_lines(heading):
    part = TEXT.partition(f"## {heading}")[2].partition("\n## ")[0]
    written = sum(statements(code) for code in re.findall(r"```python\n(.*?)```", part, re.DOTALL))
    put_in = sum(block.count("\n+") for block in re.findall(r"```diff(\n.*?)```", part, re.DOTALL))
    assert 5 < written + put_in <= 11
