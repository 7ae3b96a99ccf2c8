"""`tssgeom discover`: from a folder to report, page, rig and recording, and what is refused."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as papq
import pytest

from pipelines.cli import main
from pipelines.discover import _notes
from tests.pipelines.conftest import Run
from tests.worked_finding import worked_finding
from tssgeom.effects import HiddenBend
from tssgeom.rig import read_rig

SAMPLES = Path(__file__).resolve().parents[2] / "sample_shapes"
BEND = SAMPLES / "campaign_hidden_bend"
FILES = ["discover.rrd", "report.html", "report.json", "rig.updated.toml"]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command writes of the sample with a hidden bend."""
    out = tmp_path_factory.mktemp("found") / "out"
    with pytest.raises(SystemExit) as ended:
        main(["discover", str(BEND), "--out", str(out), "--figures", str(out.parent / "figures"), "--quiet"])
    assert not ended.value.code
    return out


def report(out: Path) -> dict[str, Any]:
    return json.loads((out / "report.json").read_text("utf-8"))


def test_all_files_are_written_and_no_other(results):
    assert sorted(path.name for path in results.iterdir()) == FILES


def test_the_figures_of_the_page_are_written_for_print(results):
    figures = ("along", "heat", "ranking", "residual", "transmission")
    written = sorted(path.name for path in (results.parent / "figures").iterdir())
    assert written == [f"{BEND.name}_{name}.{ending}" for name in figures for ending in ("pdf", "svg")]


def test_the_hidden_bend_is_named_with_an_interval_that_holds_it(results):
    output = report(results)
    assert output["verdict"] == "effect"
    (effect,) = output["effects"]
    assert effect["name"] == "hidden_bend"
    for key, truth in (("at_m", 0.21), ("angle_rad", 0.6)):
        low, high = effect["parameters"][key]["ci95"]
        assert low < truth < high
        assert effect["parameters"][key]["value"] == pytest.approx(
            truth, rel=0.1
        )  # the target of the project
    before, after = (output["gap"][when]["held_out"] for when in ("before", "after"))
    assert after["tension_in_N"] < 0.5 * before["tension_in_N"]


def test_the_updated_rig_has_the_bend_and_the_refitted_base(results):
    rig = read_rig(results / "rig.updated.toml")
    (bend,) = rig.effects
    assert isinstance(bend, HiddenBend)
    output = report(results)
    assert rig.friction.coefficient == output["base"]["friction"]["value"]
    assert rig.tendon.compliance_per_N == output["base"]["compliance_per_N"]["value"]
    assert output["base"]["friction"]["nominal"] == 0.145


def test_the_updated_rig_shrinks_the_misfit_of_a_held_out_run(
    results: Path, run: Run, tmp_path: Path
) -> None:
    left = {}
    for rig in (BEND / "rig.toml", results / "rig.updated.toml"):
        options = ("--drive", BEND / "chain.csv", "--rig", rig, "--out", tmp_path / rig.stem, "--quiet")
        assert run("simulate", BEND / "route_chain.csv", *options).status == 0
        simulated = papq.read_table(tmp_path / rig.stem / "simulate.parquet")["tension_out_N"].to_numpy()
        measured = np.genfromtxt(BEND / "chain.csv", delimiter=",", names=True)["tension_out_N"]
        left[rig.stem] = float(np.sqrt(np.mean((simulated - measured) ** 2)))
    assert left["rig.updated"] < 0.25 * left["rig"]
    # raw readings drive the command: 0.02 N of noise at both ends, and what friction keeps of it at turns
    assert left["rig.updated"] < 0.08


def test_the_page_has_the_sentence_of_the_report(results):
    page = (results / "report.html").read_text("utf-8")
    assert "hidden bend" in page
    assert page.index(report(results)["sentence"][:20]) < page.index("<section>")


def altered(
    folder: Path, change: Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]], runs: int = 2
) -> Path:
    """Copy the first runs of the sample, with their columns changed, and no run held out."""
    folder.mkdir()
    names = ["half_slow", "loop_slow", "half_fast"][:runs]
    shutil.copy(BEND / "rig.toml", folder)
    listing = ""
    for name in names:
        lines = (BEND / f"{name}.csv").read_text().splitlines()
        header = lines[0].split(",")
        table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
        columns = change(dict(zip(header, table.T, strict=True)))
        cells = np.column_stack(list(columns.values()))
        np.savetxt(
            folder / f"{name}.csv", cells, delimiter=",", header=",".join(columns), comments="", fmt="%.9g"
        )
        shape = "route_half_circle.csv" if name.startswith("half") else "route_setup_a.csv"
        shutil.copy(BEND / shape, folder)
        listing += f'[[run]]\ndata = "{name}.csv"\nshape = "{shape}"\n'
    (folder / "campaign.toml").write_text(listing)
    return folder


def keep(*names: str) -> Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]:
    return lambda columns: {name: columns[name] for name in ("time_s", *names)}


def uneven(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Drop samples at random, and readings of one channel in a row."""
    rng = np.random.default_rng(3)
    kept = np.sort(rng.choice(len(columns["time_s"]), 170, replace=False))
    fewer = {name: values[kept].copy() for name, values in columns.items()}
    fewer["tension_out_N"][60:75] = np.nan
    return fewer


PARTIAL = {
    "no_tension_out": keep("displacement_in_m", "tension_in_N", "elongation_m"),
    "displacement_only": keep("displacement_in_m", "elongation_m"),
    "tension_in_and_elongation": keep("tension_in_N", "elongation_m"),
    "uneven_with_dropouts": uneven,
}


@pytest.mark.parametrize("case", PARTIAL)
def test_partial_data_get_an_answer_and_a_list_of_what_they_cannot_show(
    run: Run, tmp_path: Path, case: str
) -> None:
    campaign = altered(
        tmp_path / "campaign", PARTIAL[case], runs=1 if case == "tension_in_and_elongation" else 2
    )
    done = run("discover", campaign, "--out", tmp_path / "out", "--json")
    assert (done.status, done.errors) == (0, [])
    output = json.loads(done.out)
    assert output["verdict"] in ("none", "effect", "tie", "unknown")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == FILES
    hidden = {"thermal_drift"}  # no run has a temperature
    if case != "uneven_with_dropouts":
        hidden |= {"tension_out_offset", "tension_out_gain", "load_cell_crosstalk"}
    assert hidden <= set(output["unobservable"])


def test_a_campaign_without_drive_is_refused_in_one_line_and_leaves_nothing(run: Run, tmp_path: Path) -> None:
    campaign = altered(tmp_path / "campaign", keep("tension_out_N", "elongation_m"))
    done = run("discover", campaign, "--out", tmp_path / "out")
    assert (done.status, done.out) == (2, "")
    (line,) = done.errors
    assert "half_slow.csv: no drive" in line
    assert not (tmp_path / "out").exists()


def test_a_file_instead_of_the_folder_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    done = run("discover", BEND, "--out", tmp_path / "out")
    assert done.status == 2
    assert "name a folder" in done.errors[0]


def test_no_campaign_is_refused_with_what_one_is(run: Run, tmp_path: Path) -> None:
    done = run("discover", tmp_path, "--out", tmp_path / "out")
    assert done.status == 2
    assert "campaign.toml" in done.errors[0]


def test_a_number_that_the_rig_file_does_not_state_is_printed_as_unknown():
    whole = worked_finding()
    name = "friction"
    stated, unknown = (replace(whole, nominal=nominal) for nominal in (whole.nominal, {}))
    of_both = [next(note for note in _notes(each) if note.startswith(name)) for each in (stated, unknown)]
    assert f"{whole.nominal[name]:.4g} in the rig file" in of_both[0]
    assert of_both[1].startswith("friction: unknown in the rig file, ")
