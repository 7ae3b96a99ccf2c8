"""Recordings of all commands are alike: entities, units, colours, text, time and camera."""

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pipelines.cli import main
from pipelines.live.worker import Recorder
from tests.view.recorded import axes, entities, timelines, verify, views
from tests.worked_finding import worked_finding
from tssgeom.stream import FrameResult
from tssgeom.view import colours
from tssgeom.view.quantities import COUNT, TIMELINE
from tssgeom.view.samples import numbers_of
from tssgeom.view.scene.compare.comparison import write_comparison
from tssgeom.view.scene.finding.recording import write_finding_recording
from tssgeom.view.scene.labels import ASPECT
from tssgeom.view.scene.paper import write_paper_recording

SAMPLES = Path(__file__).resolve().parents[2] / "sample_shapes"
CHAIN = SAMPLES / "campaign_clean"

ROUTE = {"route", "joints", "labels", "scale", "scale/length"}
CHART = {f"tension/{part}" for part in ("grid", "numbers", "colour_bar", "curve", "pieces")}
MOVED = {"route/slip_front", "tension/slip_front"}


class Expected(NamedTuple):
    """Expected content of the recording of a command."""

    timeline: str | None
    words: str = "summary"
    below: tuple[str, ...] = ("",)
    """Entities below which the routes stand."""


TABLE = {
    "analyse": Expected(None),
    "batch": Expected(TIMELINE),
    "simulate": Expected(TIMELINE),
    "live": Expected(TIMELINE),
    "discover": Expected(COUNT),
    "paper": Expected(TIMELINE, below=("a/", "b/")),
    "view": Expected(TIMELINE, words="difference/words", below=("a/", "b/")),
}


@pytest.fixture(scope="module")
def recordings(
    moving: list[FrameResult], moving_file: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    """A recording of each command."""
    folder = tmp_path_factory.mktemp("commands")
    pulled = folder / "pulled.jsonl"
    lines = (SAMPLES / "insertion.jsonl").read_text("utf-8").splitlines()
    pulled.write_text("\n".join(lines[100:112]) + "\n", "utf-8")
    half = SAMPLES / "half_circle.csv"
    drive = ("--drive", CHAIN / "chain.csv", "--rig", CHAIN / "rig.toml")
    tssgeom("analyse", half, "--out", folder / "analyse")
    tssgeom("batch", pulled, "--out", folder / "batch", "--workers", 1)
    tssgeom("simulate", CHAIN / "route_chain.csv", *drive, "--out", folder / "simulate")
    recorded = Recorder(folder / "live.rrd")
    for result in moving:
        recorded.take("picture", result)
    recorded.take("numbers", np.array([[one.frame.time, *numbers_of(one)] for one in moving]))
    recorded.finish()
    write_finding_recording(folder / "discover.rrd", worked_finding())
    write_paper_recording(folder / "paper.rrd")
    write_comparison(folder / "view.rrd", moving_file, moving_file)
    return {
        "analyse": folder / "analyse" / "half_circle.rrd",
        "batch": folder / "batch" / "recordings" / "pulled.rrd",
        "simulate": folder / "simulate" / "simulate.rrd",
        **{name: folder / f"{name}.rrd" for name in ("live", "discover", "paper", "view")},
    }


def tssgeom(*arguments: object) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments), "--quiet"])
    assert not ended.value.code


command = pytest.mark.parametrize("command", TABLE)


@command
def test_it_has_the_shared_entities_on_its_timeline_and_nothing_wrong(command: str, recordings):
    path, expected = recordings[command], TABLE[command]
    present = entities(path)
    wanted = ROUTE | CHART | (MOVED if expected.timeline else set())
    for below in expected.below:
        assert {f"/{below}{name}" for name in wanted} <= present
    assert f"/{expected.words}" in present
    assert timelines(path) == ({expected.timeline} if expected.timeline else set())
    verify(path)


@pytest.mark.parametrize("command", ["simulate", "discover", "view"])
def test_its_plot_of_tensions_begins_at_zero_and_holds_all_of_them(command: str, recordings):
    path, expected = recordings[command], TABLE[command]
    ((low, high),) = [(low, high) for low, high in axes(path) if low != -high]  # residuals have both signs
    assert -0.1 * high < low < 0.0  # so that 0 stands beside the one other number that the viewer writes
    most = max(
        float(value.removeprefix("proximal · T_in ").removesuffix(" N"))
        for below in expected.below
        for value, *_ in rows(path, f"{below}labels", "Points3D:labels")
    )
    assert most < high < 1.5 * most


@command
def test_its_words_and_labels_have_numbers_with_units(command: str, recordings):
    path, expected = recordings[command], TABLE[command]
    texts = rows(path, expected.words, "TextDocument:text")
    assert all(len(text.split()) > 5 for row in texts for text in row)
    for below in expected.below:
        for row in rows(path, f"{below}labels", "Points3D:labels"):
            assert re.fullmatch(r"proximal · T_in \d+\.\d\d N", row[0])
            assert re.fullmatch(r"distal · T_out \d+\.\d\d N", row[1])
            for number, text in enumerate(row[2:], start=1):
                assert re.fullmatch(rf"{number}( · ((?:nearly )?straight|[\d.]+° · r [\d.]+ m?m))?", text)
            assert len(row) > 2


@command
def test_one_tension_has_the_same_colour_on_its_bar_as_everywhere(command: str, recordings):
    for below in TABLE[command].below:
        bar = rows(recordings[command], f"{below}tension/colour_bar", "LineStrips2D:colors")[-1]
        middles = (np.arange(len(bar)) + 0.5) / len(bar)
        np.testing.assert_array_equal(bar, colours.tension_rgba32(middles, 1.0))
        shades = {
            shade
            for row in rows(recordings[command], f"{below}route", "LineStrips3D:colors")
            for shade in row
        }
        assert shades <= set(colours.tension_rgba32(np.linspace(0.0, 1.0, 5001), 1.0).tolist())


@pytest.mark.parametrize("command", [name for name, expected in TABLE.items() if expected.timeline])
def test_every_line_over_time_has_a_name_with_its_unit(command: str, recordings):
    path = recordings[command]
    series = [entity for entity in entities(path) if "/series/" in entity]
    assert any(entity.endswith("series/tension_in") for entity in series)
    for entity in series:
        kind = "SeriesPoints" if entity.endswith("_measured") else "SeriesLines"
        (name,) = rows(path, entity[1:], f"{kind}:names")[-1]
        assert re.search(r"\[(N|mm|°)\]$", name), entity


@command
def test_the_camera_sees_the_whole_route_and_not_from_afar(command: str, recordings):
    path = recordings[command]
    assert "3D" in views(path)
    routes = [
        np.concatenate(
            [np.reshape(row, (-1, 3)) for row in rows(path, f"{below}route", "LineStrips3D:strips")]
        )
        for below in TABLE[command].below
    ]
    cameras = eyes(path)
    assert len(cameras) >= len(routes)
    for eye, target, up in cameras:
        fits = [extent(route, eye, target, up) for route in routes]
        assert any(0.35 < most <= 1.0 for most in fits), fits


def rows(path: Path, entity: str, column: str) -> list:
    """Every row of a column that is not empty, with or without a time."""
    values = []
    for chunk in RrdReader(str(path)).stream().filter(content=f"/{entity}"):
        batch = chunk.to_record_batch()
        if column in batch.schema.names:
            values += [row for row in batch.column(column).to_pylist() if row]
    return values


def eyes(path: Path) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Position, target and upward direction of each eye."""
    reader, values = RrdReader(str(path)), dict[str, dict[str, np.ndarray]]()
    for entry in reader.blueprints():
        for chunk in reader.stream(store=entry):
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                if name.startswith("EyeControls3D:") and batch.column(name)[0].as_py():
                    value = batch.column(name).to_pylist()[-1][0]
                    values.setdefault(str(chunk.entity_path), {})[name.split(":")[1]] = np.array(value)
    return [(eye["position"], eye["look_target"], eye["eye_up"]) for eye in values.values()]


def extent(route: np.ndarray, eye: np.ndarray, target: np.ndarray, up: np.ndarray) -> float:
    """How much of the view a route takes, to its edge; above 1 it leaves the view."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    upright = up - (up @ forward) * forward
    upright /= np.linalg.norm(upright)
    across = np.cross(forward, upright)
    depth = (route - eye) @ forward
    half = math.tan(math.radians(27.5)) * depth
    high = np.abs((route - eye) @ upright) / half
    wide = np.abs((route - eye) @ across) / (ASPECT * half)
    return float(np.maximum(high, wide).max())
