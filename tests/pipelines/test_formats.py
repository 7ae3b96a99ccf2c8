"""Files of other programs through the commands."""

import json
import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

CORPUS = Path(__file__).parents[1] / "io" / "corpus"
SAYING_THEIR_UNIT = ["curve.mrk.json", "points.fcsv", "tools_toolbox.csv"]
SAYING_NONE = ["lines_ascii.vtp#2", "colonoscope", "shape.mcap", "shape.db3"]
LENGTH = {  # along the made-up routes of the corpus, in mm; two of them are arcs
    "tools_toolbox.csv": pytest.approx(100.0, rel=1e-3),
    "lines_ascii.vtp#2": pytest.approx(60.0, rel=1e-3),
}


@pytest.mark.parametrize("name", [*SAYING_THEIR_UNIT, *SAYING_NONE])
def test_analyse_takes_it_as_one_shape_or_recording(run, name):
    outcome = run(
        "analyse", CORPUS / name, "--json", *([] if name in SAYING_THEIR_UNIT else ["--unit", "mm"])
    )
    output = json.loads(outcome.out)
    assert (outcome.status, outcome.errors) == (0, [])
    assert 1e3 * output["length_m"] == LENGTH.get(name, pytest.approx(70, abs=40))
    assert ("frames" in output) == (name in {"tools_toolbox.csv", "colonoscope", "shape.mcap", "shape.db3"})


@pytest.mark.parametrize("name", SAYING_NONE)
def test_without_a_unit_it_is_refused_with_the_hint(run, name):
    (error,) = run("analyse", CORPUS / name).errors
    assert name.partition("#")[0] in error
    assert error.endswith("give --unit mm|m|cm|in|…")


@pytest.mark.parametrize(
    ("name", "holds"),
    [
        ("curve.mrk.json", "shape in mm (slicer)\n  points: 6, 1 missing"),
        ("points.fcsv", "shape in mm (fcsv)\n  points: 5, none missing"),
        ("tools_toolbox.csv", "recording in mm (ndi), 3 frames in 0.1 s\n  points: 5, 1 missing"),
        ("lines_ascii.vtp#1", "shape in mm (vtk)\n  points: 6, none missing"),
        ("colonoscope", "recording in mm (colonoscope), 4 frames in 0.3 s\n  points: 6, 1 missing"),
        ("shape.mcap", "recording in mm (ros2), 3 frames in 2 s\n  points: 6, 1 missing"),
    ],
)
def test_check_reports_what_it_holds(run, name, holds):
    outcome = run("check", CORPUS / name, "--unit", "mm")
    assert (outcome.status, outcome.errors) == (0, [])
    assert f"{CORPUS / name}: {holds}" in outcome.out


def test_a_file_of_two_lines_is_a_list_of_two_shapes(run):
    output = json.loads(run("analyse", CORPUS / "lines_binary.vtp", "--unit", "mm", "--json").out)
    assert [each["shape"] for each in output] == ["lines_binary-1", "lines_binary-2"]


def test_batch_takes_a_folder_of_all_and_records_where_each_came_from(run, tmp_path):
    for name in ("curve.mrk.json", "lines_ascii.vtp", "shape.mcap"):
        shutil.copy(CORPUS / name, tmp_path / name)
    shutil.copytree(CORPUS / "colonoscope", tmp_path / "case")
    outcome = run("batch", tmp_path, "--unit", "mm", "--out", tmp_path / "out", "--json")
    assert (outcome.status, outcome.errors) == (0, [])
    names = ["case", "curve", "lines_ascii-1", "lines_ascii-2", "shape"]
    assert [each["shape"] for each in json.loads(outcome.out)] == names
    inputs = json.loads((tmp_path / "out/run.json").read_text())["inputs"]
    assert [each["kind"] for each in inputs] == ["colonoscope", "slicer", "vtk", "vtk", "ros2"]
    assert len({each["sha256"] for each in inputs}) == 4  # both lines are of one file


def test_export_writes_beside_the_results_and_never_over_the_input(run, half):
    before = half.read_bytes()
    outcome = run("analyse", half, "--out", half.parent, "--export", "mrk.json,vtp,ply,csv", "--quiet")
    assert (outcome.status, outcome.errors) == (0, [])
    written = {path.name for path in half.parent.glob("half_tension.*")}
    assert written == {"half_tension.mrk.json", "half_tension.vtp", "half_tension.ply", "half_tension.csv"}
    assert half.read_bytes() == before


def test_a_format_whose_library_is_missing_leaves_all_others(run, half, write_csv, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkIOXML", None)
    other = write_csv("other.csv", np.loadtxt(half, delimiter=",", skiprows=1))
    out, figures = tmp_path / "out", tmp_path / "figures"
    options = ("--export", "vtp,csv,ply", "--figures", figures, "--quiet")
    outcome = run("analyse", half, other, "--out", out, *options)
    assert (outcome.status, len(outcome.errors)) == (1, 1)
    assert "--export vtp: no .vtp file is written, as VTK is not installed" in outcome.errors[0]
    for name in ("half", "other"):
        assert {path.name for path in out.glob(f"{name}*")} == {
            f"{name}{rest}" for rest in (".rrd", ".glb", "_tension.csv", "_tension.ply")
        }
        assert (figures / f"{name}_route.pdf").exists()


def test_an_exported_curve_has_the_length_and_angle_of_its_source(run, half, tmp_path):
    run("analyse", half, "--out", tmp_path / "out", "--export", "mrk.json")
    (here,) = json.loads(run("check", half, "--json").out)
    output = json.loads(run("analyse", tmp_path / "out/half_tension.mrk.json", "--json").out)
    assert output["length_m"] == pytest.approx(here["length_m"], rel=1e-6)
    assert output["total_angle_rad"] == pytest.approx(math.pi, rel=1e-4)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--export", "vtp"], "--export vtp: there is no folder to write to: give --out DIR too"),
        (
            ["--export", "vtp,stl", "--out", "out"],
            "--export: no writer for 'stl': choose from mrk.json,vtp,ply,csv",
        ),
    ],
)
def test_an_export_that_cannot_be_is_refused_before_any_work(run, half, arguments, expected):
    outcome = run("analyse", half, *arguments)
    assert (outcome.status, outcome.errors) == (2, [f"tssgeom: {expected}"])
