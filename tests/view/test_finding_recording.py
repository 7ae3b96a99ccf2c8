"""discover.rrd: every run on one slider, the route in colours of tension and misfit, lines, and words."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from tests.worked_finding import worked_finding
from tssgeom.view.quantities import COUNT
from tssgeom.view.scene.finding.recording import BOX, write_finding_recording
from tssgeom.view.scene.finding.replay import MOST_NODES, MOST_ROWS, replay
from tssgeom.view.scene.viewer import moment_of_greatest_tension


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("finding") / "discover.rrd"
    write_finding_recording(path, worked_finding())
    return path


def columns(path: Path, entity: str) -> dict[str, list[pa.Array]]:
    result: dict[str, list[pa.Array]] = {}
    for chunk in RrdReader(str(path)).stream().filter(content=f"/{entity}"):
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            result.setdefault(name, []).append(column)
    return result


def values(path: Path, entity: str) -> np.ndarray:
    parts = columns(path, entity)["Scalars:scalars"]
    return np.concatenate([part.flatten().to_numpy() for part in parts])


def test_lines_hold_every_sample_of_every_run(path):
    traces = worked_finding().traces
    after = np.concatenate([trace.measured["elongation_m"] - trace.after["elongation_m"] for trace in traces])
    np.testing.assert_allclose(values(path, "left/elongation_m/line_3"), 1e3 * after, rtol=1e-12)
    locations = np.concatenate([part.to_numpy() for part in columns(path, "left/elongation_m/line_3")[COUNT]])
    np.testing.assert_array_equal(locations, np.arange(sum(len(trace.time) for trace in traces)))


def test_the_spread_is_two_standard_deviations(path):
    traces = worked_finding().traces
    sigma = np.concatenate([trace.sigma["tension_out_N"] for trace in traces])
    np.testing.assert_allclose(values(path, "left/tension_out_N/line_0"), -2.0 * sigma, rtol=1e-12)
    np.testing.assert_allclose(values(path, "left/tension_out_N/line_1"), 2.0 * sigma, rtol=1e-12)


def test_the_route_is_sent_once_a_run_and_its_colours_at_every_row(path):
    displayed = replay(worked_finding())
    route = columns(path, "route")
    strips = [part for part in route["LineStrips3D:strips"] if part.null_count == 0]
    shades = [part for part in route["LineStrips3D:colors"] if part.null_count == 0]
    assert sum(map(len, strips)) == len(displayed.stretches)
    rows = sum(len(stretch.rows) for stretch in displayed.stretches)
    assert sum(map(len, shades)) == rows <= MOST_ROWS
    segments = [len(stretch.s) - 1 for stretch in displayed.stretches for _ in stretch.rows]
    assert [len(row) for part in shades for row in part] == segments
    assert max(segments) < MOST_NODES


def test_misfit_along_the_route_marks_the_detected_bend(path):
    result = columns(path, "blame/found")
    labels = [
        text for part in result["Points3D:labels"] if part.null_count == 0 for row in part for text in row
    ]
    assert {text.as_py() for text in labels} == {"hidden bend, s = 210 mm"}
    stretch = replay(worked_finding()).stretches[0]
    location = np.array([np.interp(0.21, stretch.s, axis) for axis in stretch.position.T])
    first = result["Points3D:positions"][0][0].as_py()[0]
    np.testing.assert_allclose(first, location, atol=1e-6)  # sent in single precision


def test_the_chart_of_the_missing_angle_marks_the_bend_at_its_arc_length(path):
    length = 1e3 * replay(worked_finding()).length
    ((strip,),) = columns(path, "missing/found")["LineStrips2D:strips"][0].to_pylist()
    across = BOX.width * 210.0 / length
    np.testing.assert_allclose(strip, [[across, 1.0], [across, 0.0]], atol=1e-6)  # sent in single precision


def test_documents_state_the_verdict_and_the_run_of_the_moment(path):
    (verdict,) = columns(path, "summary")["TextDocument:text"]
    assert "hidden bend" in verdict[0].as_py()[0]
    texts = [row.as_py()[0] for part in columns(path, "table")["TextDocument:text"] for row in part]
    assert len(texts) == len(worked_finding().traces)
    assert "Run chain" in texts[-1]
    assert "held out" in texts[-1]


def test_a_route_is_turned_without_being_bent():
    finding = worked_finding()
    routes = {run.name: run.route for run in finding.campaign.runs}
    for stretch in replay(finding).stretches:
        before = np.diff(routes[stretch.trace.run].position[stretch.nodes], axis=0)
        after = np.diff(stretch.position, axis=0)
        np.testing.assert_allclose(after @ after.T, before @ before.T, atol=1e-12)  # rounding of a rotation


def test_the_picture_is_taken_at_the_greatest_tension(path):
    tension = np.concatenate([trace.tension_in for trace in worked_finding().traces])
    timeline, location = moment_of_greatest_tension(path)
    assert timeline == COUNT
    assert tension[int(location)] > 0.99 * tension.max()


def test_a_recording_is_small(path):
    assert path.stat().st_size < 2e6


@pytest.mark.parametrize("verdict", ["none", "tie", "unknown"])
def test_every_verdict_has_a_recording(tmp_path, verdict):
    write_finding_recording(tmp_path / "discover.rrd", worked_finding(verdict))
    assert columns(tmp_path / "discover.rrd", "route")
    assert [path.name for path in tmp_path.iterdir()] == ["discover.rrd"]
