from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
import rerun.blueprint as rrb
import trimesh
from rerun.chunk import RrdReader

from tests.view.recorded import columns, entities, verify, views
from tssgeom.errors import SourceError
from tssgeom.stream import FrameResult
from tssgeom.view.colours import tension_rgba32
from tssgeom.view.mesh import tube
from tssgeom.view.samples import route_samples
from tssgeom.view.scene.recording import write_recording
from tssgeom.view.scene.writer import recording_file
from tssgeom.view.wording import piece_labels

ENTITIES = {
    "/route",
    "/sensed",
    "/sensed/outliers",
    "/joints",
    "/labels",
    "/scale",
    "/scale/length",
    "/scale/axes",
    "/scale/axes/letters",
    "/tension/grid",
    "/tension/numbers",
    "/tension/colour_bar",
    "/tension/curve",
    "/tension/pieces",
    "/curvature/grid",
    "/curvature/numbers",
    "/curvature/standard_error",
    "/curvature/sensed",
    "/curvature/pieces",
    "/summary",
    "/table",
}
SERIES = {
    f"/series/{name}"
    for name in ("tension_in", "tension_out", "elongation", "angle", "angle_least", "angle_most")
}
FRONT = {"/route/slip_front", "/tension/slip_front"}


def floats(array: pa.Array) -> np.ndarray:
    """All floating-point numbers of an Arrow array, however deep they lie."""
    while pa.types.is_list(array.type) or pa.types.is_fixed_size_list(array.type):
        array = array.flatten()
    return array.to_numpy(zero_copy_only=False) if pa.types.is_floating(array.type) else np.empty(0)


def test_still_recording_holds_every_part_of_the_picture_and_no_series(still_file: Path) -> None:
    assert entities(still_file) - {"/"} == ENTITIES


def test_moving_recording_holds_the_series_too(moving_file: Path) -> None:
    assert entities(moving_file) - {"/"} == ENTITIES | SERIES | FRONT | {"/scale/time"}


def test_still_recording_has_no_timeline(still_file: Path) -> None:
    assert all(chunk.timeline_names == [] for chunk in RrdReader(str(still_file)).stream())


def test_each_frame_is_one_row_at_its_own_time(moving_file: Path, moving: list[FrameResult]) -> None:
    times = [result.frame.time for result in moving]
    moved = {"/route", "/sensed", "/joints", "/labels", "/tension/curve", "/curvature/sensed", "/table"}
    for entity in moved | SERIES | {"/summary"}:
        rows = columns(moving_file, entity, timed=True)["time"]
        # The route's numbers are rows of their own beside its lines.
        assert sorted({row.total_seconds() for row in rows}) == times


def test_route_has_one_colour_for_each_strip_and_one_strip_less_than_nodes(
    moving_file: Path, moving: list[FrameResult]
) -> None:
    route = columns(moving_file, "/route", timed=True)
    for strips, colours, result in zip(
        route["LineStrips3D:strips"], route["LineStrips3D:colors"], moving, strict=True
    ):
        assert len(strips) == len(colours) == len(route_samples(result).s) - 1
        assert all(len(strip) == 2 for strip in strips)


def test_one_tension_has_one_colour_in_every_frame_and_on_the_colour_bar(
    moving_file: Path, moving: list[FrameResult]
) -> None:
    top = 12.0  # the greatest tension of the run, itself a plain number
    rows = columns(moving_file, "/route", timed=True)["LineStrips3D:colors"]
    for colours, result in zip(rows, moving, strict=True):
        tension = route_samples(result).tension
        np.testing.assert_array_equal(colours, tension_rgba32(0.5 * (tension[:-1] + tension[1:]), top))
    bar = columns(moving_file, "/tension/colour_bar", timed=False)["LineStrips2D:colors"][0]
    assert bar[-1] == tension_rgba32(np.array([top * (1 - 0.5 / len(bar))]), top)[0]


def test_raw_numbers_on_the_route_are_the_results_in_single_precision(
    moving_file: Path, moving: list[FrameResult]
) -> None:
    rows = columns(moving_file, "/route", timed=True)
    fields = {"s_m": "s", "tension_N": "tension", "phi_rad": "phi", "kappa_per_m": "kappa"}
    for name, field in fields.items():
        for numbers, result in zip(rows[name], moving, strict=True):
            np.testing.assert_array_equal(numbers, getattr(route_samples(result), field).astype(np.float32))


def test_tension_on_the_route_runs_from_tension_in_to_tension_out(
    moving_file: Path, moving: list[FrameResult]
) -> None:
    for row, result in zip(columns(moving_file, "/route", timed=True)["tension_N"], moving, strict=True):
        assert row[0] == pytest.approx(result.transmission.tension_in, rel=1e-6)
        # The pieces carry the profile's whole angle, so that both end at the same tension.
        assert row[-1] == pytest.approx(result.transmission.tension_out, rel=1e-4)


def test_every_position_that_is_drawn_is_finite(still_file: Path, moving_file: Path) -> None:
    for path in (still_file, moving_file):
        for chunk in RrdReader(str(path)).stream():
            if not str(chunk.entity_path).startswith("/__"):
                batch = chunk.to_record_batch()
                for column in batch.columns:
                    assert np.isfinite(floats(column)).all(), chunk.entity_path


def test_sensed_points_are_all_drawn_and_the_outlier_once_more(
    still_file: Path, still: list[FrameResult]
) -> None:
    points = still[0].frame.points
    rows = columns(still_file, "/sensed", timed=False)["Points3D:positions"]
    outliers = columns(still_file, "/sensed/outliers", timed=False)["Points3D:positions"]
    assert [len(row) for row in rows if row] == [len(points)]
    np.testing.assert_array_equal(next(row for row in outliers if row), points[[30]].astype(np.float32))


def test_each_piece_has_a_joint_of_its_class_and_a_label(
    moving_file: Path, moving: list[FrameResult]
) -> None:
    classes = columns(moving_file, "/joints", timed=True)["Points3D:class_ids"]
    labels = columns(moving_file, "/labels", timed=True)["Points3D:labels"]
    for numbers, texts, result in zip(classes, labels, moving, strict=True):
        assert numbers == list(range(len(result.arcs.length)))
        assert texts[2:] == piece_labels(result.arcs)
        assert texts[0] == f"proximal · T_in {result.transmission.tension_in:.2f} N"


def test_series_carry_the_numbers_in_the_units_of_their_names(
    moving_file: Path, moving: list[FrameResult]
) -> None:
    expected = {
        "tension_out": [result.transmission.tension_out for result in moving],
        "elongation": [1e3 * result.transmission.elongation for result in moving],
        "angle": [np.degrees(result.profile.total_angle) for result in moving],
    }
    for name, values in expected.items():
        rows = columns(moving_file, f"/series/{name}", timed=True)["Scalars:scalars"]
        np.testing.assert_allclose(np.ravel(rows), values, rtol=1e-15)


def test_table_and_words_move_with_time(moving_file: Path, moving: list[FrameResult]) -> None:
    tables = columns(moving_file, "/table", timed=True)["TextDocument:text"]
    words = columns(moving_file, "/summary", timed=True)["TextDocument:text"]
    assert len({text for row in tables for text in row}) == len(moving)
    assert "Released to **T_in = 9.00 N**" in words[4][0]


def test_layout_of_a_still_shape_has_no_time_series_and_that_of_a_run_has_three(
    still_file: Path, moving_file: Path
) -> None:
    assert sorted(views(still_file)) == ["2D", "2D", "3D", "TextDocument", "TextDocument"]
    assert views(moving_file).count("TimeSeries") == 3


def test_rerun_itself_finds_no_error(still_file: Path, moving_file: Path) -> None:
    for path in (still_file, moving_file):
        verify(path)


@pytest.mark.parametrize("inverted", [False, True])
def test_lumen_normals_point_at_the_route_whichever_way_the_mesh_was_turned(
    still: list[FrameResult], tmp_path: Path, inverted: bool
) -> None:
    route = still[0].route
    wall = tube(route.position, route.tangent, np.ones(len(route.s)), 0.01)
    given = trimesh.Trimesh(wall.vertices, wall.faces[:, ::-1] if inverted else wall.faces, process=False)
    write_recording(tmp_path / "lumen.rrd", "lumen", still, timed=False, lumen=given)
    wall = columns(tmp_path / "lumen.rrd", "/lumen", timed=False)
    corners = np.array(wall["Mesh3D:vertex_positions"][0])[np.array(wall["Mesh3D:triangle_indices"][0])]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume > 0  # faces outward, of which "Back" shows the inner side
    inward = route.position[20] - np.array(wall["Mesh3D:vertex_positions"][0])[20 * 16]
    assert inward @ np.array(wall["Mesh3D:vertex_normals"][0])[20 * 16] > 0


def test_recording_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no frame of empty could be used"):
        write_recording(tmp_path / "empty.rrd", "empty", [], timed=True)


def test_folder_that_cannot_be_made_is_an_error_with_its_path(
    still: list[FrameResult], tmp_path: Path
) -> None:
    (tmp_path / "nowhere").touch()
    with pytest.raises(SourceError, match=r"nowhere.*cannot be written"):
        write_recording(tmp_path / "nowhere" / "still.rrd", "still", still, timed=False)


def test_nothing_unfinished_is_left_beside_the_file(still_file: Path) -> None:
    assert [path.name for path in still_file.parent.iterdir()] == ["still.rrd"]


@pytest.mark.parametrize("name", ["ok_a (1)", "Probe #3 50 % é", "scan.v2", "quote'\"", "plain name_1-2"])
def test_rerun_takes_any_name_without_a_warning(tmp_path: Path, name: str, capfd) -> None:
    for application in (None, f"tssgeom track: {name}"):
        with recording_file(tmp_path / "a.rrd", name, rrb.Blueprint(), application=application) as recording:
            recording.log("text", rr.TextLog("a"))
    assert capfd.readouterr().err == ""
