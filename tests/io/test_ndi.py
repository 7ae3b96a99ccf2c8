"""Tables of tracked tools from NDI's programs."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tssgeom.errors import SettingsError, ShapeError
from tssgeom.io.formats.files import Recording, open_recording
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.stream import Frame, Rejected

CORPUS = Path(__file__).parent / "corpus"
TOOLBOX = CORPUS / "tools_toolbox.csv"


def frames(recording: Recording) -> list[Frame]:
    return [item for item in recording.frames if isinstance(item, Frame)]


def test_tools_side_by_side_are_the_points_of_a_frame_in_mm_and_seconds():
    recording = open_recording(TOOLBOX)
    outcome = frames(recording)
    assert (recording.unit, recording.kind, recording.timed, recording.frame_count) == ("mm", "ndi", True, 3)
    assert recording.warnings == ()
    a = 0.25 * np.arange(5)
    arc = np.column_stack([100 * np.sin(a), 100 * (1 - np.cos(a)), np.full(5, -1500.0)]) / 1000
    np.testing.assert_allclose(
        outcome[0].points, arc, atol=5.1e-7
    )  # the file has three digits of a millimetre
    np.testing.assert_allclose(
        np.diff([frame.time for frame in outcome]), 0.05, atol=1e-6
    )  # times since 1970


def test_a_tool_that_was_not_tracked_is_a_missing_point():
    outcome = frames(open_recording(TOOLBOX))
    assert np.isnan(outcome[1].points[2]).all()
    assert np.isnan(outcome[1].points).any(axis=1).sum() == 1


def test_the_third_axis_of_a_scalar_first_quaternion_is_the_direction():
    first = frames(open_recording(TOOLBOX))[0]
    a = 0.25 * np.arange(5)
    tangents = np.column_stack([np.cos(a), np.sin(a), np.zeros(5)])
    np.testing.assert_allclose(first.directions, tangents, atol=1e-6)  # seven digits in the file


def test_euler_angles_give_the_directions_of_the_quaternions(tmp_path):
    rows = [line.split(",") for line in TOOLBOX.read_text().splitlines()]
    starts = [k for k, name in enumerate(rows[0]) if name == "Q0"]
    for k in reversed(starts):
        rows[0][k : k + 4] = ["Rz", "Ry", "Rx"]
        for row in rows[1:]:
            row[k : k + 4] = _angles(row[k : k + 4])
    (tmp_path / "tools.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    by_angles, by_quaternions = (frames(open_recording(file)) for file in (tmp_path / "tools.csv", TOOLBOX))
    for here, there in zip(by_angles, by_quaternions, strict=True):
        np.testing.assert_array_equal(here.points, there.points)
        np.testing.assert_allclose(here.directions, there.directions, atol=1e-6)


def _angles(quaternion: list[str]) -> list[str]:
    """Roll, pitch and yaw [deg] of a quaternion, by SciPy."""
    if not any(quaternion):
        return ["", "", ""]
    w, *xyz = map(float, quaternion)
    with warnings.catch_warnings():  # some tools of the file point along an axis, where two angles are one
        warnings.simplefilter("ignore")
        angles = Rotation.from_quat([*xyz, w]).as_euler("ZYX", degrees=True)
    return [f"{angle:.9g}" for angle in angles]


def test_coils_with_axes_towards_the_proximal_end_are_turned_round(tmp_path):
    """Half a turn about the first axis, (0, 1, 0, 0) times q, sends the third axis of a tool backwards."""
    rows = [line.split(",") for line in TOOLBOX.read_text().splitlines()]
    starts = [k for k, name in enumerate(rows[0]) if name == "Q0"]
    for row in rows[1:]:
        for k in starts:
            w, x, y, z = row[k : k + 4]
            row[k : k + 4] = [f"{-float(x):.7g}", w, z, f"{-float(y):.7g}"]
    (tmp_path / "tools.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    here, there = frames(open_recording(tmp_path / "tools.csv")), frames(open_recording(TOOLBOX))
    np.testing.assert_allclose(here[0].directions, there[0].directions, atol=1e-6)


def test_one_block_in_the_header_serves_several_tools_with_different_markers_in_a_row():
    recording = open_recording(CORPUS / "tools_capi.csv")
    outcome = frames(recording)
    k = np.arange(5.0)
    np.testing.assert_array_equal(
        outcome[0].points, np.column_stack([20 * k, 0.5 * k**2, np.full(5, -100.0)]) / 1000
    )
    assert np.isnan(outcome[1].points[1]).all()
    assert [frame.time for frame in outcome] == [100.0, 101.0, 102.0]
    assert recording.warnings == ("no time column: the frame numbers are taken as time, one a second",)


def test_the_state_of_each_tool_in_a_row_is_its_own_though_its_last_pose_stands_beside_it(tmp_path):
    text = (CORPUS / "tools_capi.csv").read_text()
    path = tmp_path / "tools.csv"
    path.write_text(text.replace("Missing,,,,,,,,,", "Missing,1,0,0,0,20.0,0.5,-100,0.1,"))
    lost = [np.isnan(frame.points).all(axis=1).tolist() for frame in frames(open_recording(path))]
    assert lost == [[False] * 5, [k == 1 for k in range(5)], [False] * 5]


def test_seconds_and_nanoseconds_make_one_time(tmp_path):
    header = "ToolCount,ToolInfo,Frame#,timespec_s,timespec_ns,TransformStatus,Q0,Qx,Qy,Qz,Tx,Ty,Tz"
    row = "1,a,7,12,250000000,Enabled,1,0,0,0,1,2,3"
    (tmp_path / "tools.csv").write_text(f"{header}\n{row}\n")
    recording = open_recording(tmp_path / "tools.csv")
    assert frames(recording)[0].time == 12.25
    assert not recording.timed


def test_rows_without_clock_and_frame_number_are_counted(tmp_path):
    (tmp_path / "tools.csv").write_text("Q0,Qx,Qy,Qz,Tx,Ty,Tz\n1,0,0,0,1,2,3\n1,0,0,0,1,2,4\n")
    recording = open_recording(tmp_path / "tools.csv")
    assert [frame.time for frame in frames(recording)] == [0.0, 1.0]
    assert "no time" in recording.warnings[0]


def test_a_cell_that_is_no_number_rejects_its_frame_only(tmp_path):
    lines = TOOLBOX.read_text().splitlines()
    lines[2] = lines[2].replace("-1500.000", "far", 1)
    (tmp_path / "tools.csv").write_text("\n".join(lines) + "\n")
    (rejected,) = [
        item for item in open_recording(tmp_path / "tools.csv").frames if isinstance(item, Rejected)
    ]
    assert rejected.seq == 1
    assert rejected.reason.startswith("line 3: could not convert string to float: 'far'")


def test_a_row_that_is_written_twice_is_rejected(tmp_path):
    lines = TOOLBOX.read_text().splitlines()
    (tmp_path / "tools.csv").write_text("\n".join([*lines, lines[-1]]) + "\n")
    (rejected,) = [
        item for item in open_recording(tmp_path / "tools.csv").frames if isinstance(item, Rejected)
    ]
    assert rejected.seq == 3
    assert "put the frames in order, each once" in rejected.reason


def test_a_row_that_is_cut_short_is_rejected_with_its_line(tmp_path):
    text = TOOLBOX.read_text()
    (tmp_path / "tools.csv").write_text(text[: len(text) - 60] + "\n")
    recording = open_recording(tmp_path / "tools.csv")
    (rejected,) = [item for item in recording.frames if isinstance(item, Rejected)]
    assert rejected.seq == 2
    assert rejected.reason.startswith("line 4: ")


def test_a_table_of_points_is_no_table_of_tools(tmp_path):
    (tmp_path / "a.csv").write_text("x_mm,y_mm,z_mm\n0,0,0\n1,0,0\n2,1,0\n3,1,1\n")
    assert open_recording(tmp_path / "a.csv").kind == "csv"


def test_ndi_is_always_in_millimetres(tmp_path):
    with pytest.raises(ShapeError, match="the file is in mm, --unit says m"):
        open_recording(TOOLBOX, "m")


def test_a_header_without_rows_is_refused(tmp_path):
    (tmp_path / "tools.csv").write_text("Q0,Qx,Qy,Qz,Tx,Ty,Tz\n")
    with pytest.raises(ShapeError, match="no row of tools"):
        open_recording(tmp_path / "tools.csv")


@pytest.mark.parametrize(
    ("ending", "separator", "decimal"), [("tsv", "\t", "."), ("csv", ";", ","), ("txt", "\t", ",")]
)
def test_tabs_semicolons_and_decimal_commas_change_nothing(ending, separator, decimal, tmp_path):
    cells = [line.split(",") for line in TOOLBOX.read_text().splitlines()]
    head, *rows = cells
    lines = [separator.join(head), *(separator.join(row).replace(".", decimal) for row in rows)]
    (tmp_path / f"tools.{ending}").write_text("\n".join(lines) + "\n")
    here, there = open_recording(tmp_path / f"tools.{ending}"), open_recording(TOOLBOX)
    assert (here.kind, here.unit, here.warnings) == ("ndi", "mm", ())
    for one, other in zip(frames(here), frames(there), strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.directions, other.directions)
        assert one.time == other.time


def row_a_tool(names: tuple[str, ...], missing: str) -> str:
    """Three frames of five tools, of which the third one is not tracked in the second frame."""
    lines = [",".join(names)]
    for f in range(3):
        for k in range(5):
            pose = f"1,0,0,0,{20 * k + f},{0.5 * k * k},-100" if (f, k) != (1, 2) else missing
            lines.append(f"{1772441122.125 + 0.025 * f:.4f},{100 + f},{k + 10},{pose}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("ending", ["csv", "tsv", "txt"])
@pytest.mark.parametrize("missing", [",,,,,,", "1,0,0,0,-3.697314e28,-3.697314e28,-3.697314e28"])
def test_a_row_for_each_tool_makes_frames_by_time_and_points_by_tool(ending, missing, tmp_path):
    names = ("timestamp", "frame_number", "port_handle", "q0", "qx", "qy", "qz", "tx", "ty", "tz")
    text = row_a_tool(names, missing)
    path = tmp_path / f"tools.{ending}"
    path.write_text(text if ending == "csv" else text.replace(",", "\t"))
    recording = open_recording(path)
    outcome = frames(recording)
    k = np.arange(5.0)
    wanted = np.column_stack([20 * k, 0.5 * k**2, np.full(5, -100.0)]) / 1000
    np.testing.assert_allclose(outcome[0].points, wanted, rtol=1e-12)
    assert np.isnan(outcome[1].points).all(axis=1).tolist() == [False, False, True, False, False]
    np.testing.assert_allclose(np.diff([frame.time for frame in outcome]), 0.025, atol=1e-6)
    lost = "1 tool not tracked" if missing == ",,,,,," else "1 point of -3.69731e+28 read as missing"
    assert {lost, "markers in the order of port_handle"} <= set(recording.notes)


def test_a_state_of_a_tool_in_a_row_of_its_own_makes_a_missing_point(tmp_path):
    names = ("time_s", "frame", "tool", "state", "Q0", "Qx", "Qy", "Qz", "Tx", "Ty", "Tz")
    lines = row_a_tool(names, "1,0,0,0,0,0,0").splitlines()
    rows = [line.split(",") for line in lines[1:]]
    rows = [[*row[:3], "Missing" if row[-1] == "0" else "OK", *row[3:]] for row in rows]
    (tmp_path / "tools.csv").write_text("\n".join([lines[0], *map(",".join, rows)]) + "\n")
    outcome = frames(open_recording(tmp_path / "tools.csv"))
    assert np.isnan(outcome[1].points).all(axis=1).tolist() == [False, False, True, False, False]
    assert not np.isnan(outcome[0].points).any()


def test_a_map_of_a_column_of_tools_is_refused_and_not_left_out():
    with pytest.raises(SettingsError, match=r"--map 'Tx': .* is a table of tracked tools, read by NDI's own"):
        open_recording(TOOLBOX, None, ColumnMap(["Tx=x_mm"]))


def test_a_map_of_a_column_in_a_row_of_its_own_tool_is_used(tmp_path):
    names = ("zeit", "frame_number", "port_handle", "q0", "qx", "qy", "qz", "tx", "ty", "tz")
    (tmp_path / "tools.csv").write_text(row_a_tool(names, ",,,,,,"))
    said = ColumnMap(["zeit=ignore", "tx=x_m", "ty=y_m", "tz=z_m"])
    recording = open_recording(tmp_path / "tools.csv", None, said)
    assert said.unused == set()
    assert frames(recording)[0].points[1, 0] == 20.0
