"""`tssgeom samples` and the part of `tssgeom view` that needs no viewer."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipelines.view import pairs, recordings_in
from tssgeom.errors import SourceError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.meshes import lumen_beside, read_lumen
from tssgeom.io.results.samples import write_samples
from tssgeom.route.synthetic import Sample, Tube, half_circle, positions
from tssgeom.stream import Frame

POINTS = positions(half_circle(), np.linspace(0.0, 0.5, 25))
TIME = np.arange(3) / 30
SAMPLES = (
    Sample("arc", "half circle", POINTS, 0.0, 0.5, math.pi),
    Sample("arc_noisy", "with noise", POINTS + 1e-4, 2e-4, 0.5, math.pi),
    Sample("arc_run", "pulled", np.stack([POINTS] * 3), 2e-4, 0.5, math.pi, TIME, np.array([0.0, 7.5, 15.0])),
)
LUMEN = Tube("arc_lumen", np.eye(3)[[0, 1, 2, 0]] * [[1], [1], [1], [0]], np.array([[0, 1, 2], [0, 3, 1]]))


@pytest.fixture
def folder(tmp_path) -> Path:
    write_samples(tmp_path / "samples", SAMPLES, LUMEN)
    return tmp_path / "samples"


def frames(path: Path) -> list[Frame]:
    return [item for item in open_recording(path).frames if isinstance(item, Frame)]


def test_samples_come_back_as_they_were(folder):
    # Exact samples are written to 1e-9 mm, noisy ones to 1e-3 mm: half of the last digit.
    np.testing.assert_allclose(frames(folder / "arc.csv")[0].points, POINTS, atol=0.51e-12)
    np.testing.assert_allclose(frames(folder / "arc_noisy.csv")[0].points, POINTS + 1e-4, atol=0.51e-6)
    run = frames(folder / "arc_run.jsonl")
    assert [frame.tension_in for frame in run] == [0.0, 7.5, 15.0]
    np.testing.assert_allclose([frame.time for frame in run], TIME, atol=1e-6)
    np.testing.assert_allclose(run[2].points, POINTS, atol=0.51e-6)


def test_the_lumen_mesh_belongs_to_the_samples_of_its_name(folder):
    mesh = lumen_beside(folder / "arc_noisy.csv")
    assert mesh == folder / "arc_lumen.ply"
    lumen = read_lumen(mesh, "mm")
    assert isinstance(lumen, trimesh.Trimesh)
    np.testing.assert_allclose(lumen.extents, 1.0, rtol=1e-6)


def test_writing_again_gives_the_same_bytes(folder, tmp_path):
    write_samples(tmp_path / "again", SAMPLES, LUMEN)
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes()


def test_the_readme_has_columns_units_and_the_truth(folder):
    text = (folder / "README.md").read_text()
    assert "| `arc_noisy.csv` | with noise | 25 | 0.2 | 500.00 | 3.14159 | 180.00 |" in text
    assert "25 × 3 frames" in text
    assert "`x_mm`, `y_mm`, `z_mm`" in text


def test_the_samples_pass_the_check(run, folder):
    output = json.loads(run("check", folder, "--json").out)
    assert [one["wrong"] for one in output] == [[], [], []]
    assert [one["holds"] for one in output] == ["shape", "shape", "recording"]


def test_view_finds_the_recordings_of_a_folder_in_order(tmp_path):
    for name in ("recordings/b.rrd", "recordings/a.rrd", "recordings/.a.part.rrd", "recordings/.c.rrd"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [path.name for path in recordings_in(tmp_path)] == ["a.rrd", "b.rrd"]


def test_view_of_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(SourceError, match=r"no recording \(.rrd\) in this folder"):
        recordings_in(tmp_path)


def test_view_of_what_is_no_recording_is_one_line(run, half, tmp_path):
    outcome = run("view", half, "--screenshot", tmp_path / "picture.png")
    assert outcome.status == 2
    assert "no Rerun recording" in outcome.errors[0]


def touched(folder: Path, *names: str) -> Path:
    folder.mkdir()
    for name in names:
        (folder / f"{name}.rrd").touch()
    return folder


def test_two_folders_are_compared_by_the_names_that_both_have(tmp_path):
    a = touched(tmp_path / "a", "route", "loop", "more")
    b = touched(tmp_path / "b", "loop", "route", "other")
    assert pairs(a, b) == {name: (a / f"{name}.rrd", b / f"{name}.rrd") for name in ("loop", "route")}
    assert pairs(a / "more.rrd", touched(tmp_path / "c", "else")).keys() == {"more_and_else"}
    with pytest.raises(SourceError, match=r"they share no name of a recording: name two \.rrd files"):
        pairs(a, touched(tmp_path / "d", "x", "y"))


def test_view_of_two_results_writes_their_comparison(run, half, tmp_path):
    for name, pull in (("a", 10), ("b", 15)):
        run("analyse", half, "--out", tmp_path / name, "--tension-in", pull, "--quiet")
    outcome = run("view", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "both")
    assert outcome.status == 0
    assert [path.name for path in (tmp_path / "both").iterdir()] == ["half.rrd"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("a", "b", "c"), "3 paths: give one to view, or two"),
        (("a", "--out", "d"), "two recordings or folders"),
    ],
)
def test_view_reports_how_many_paths_it_takes(run, arguments, words):
    outcome = run("view", *arguments)
    assert outcome.status == 2
    assert words in outcome.errors[0]
