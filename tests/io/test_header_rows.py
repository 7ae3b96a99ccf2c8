"""Tables whose header has several rows: exports of optical trackers, and columns that two rows name."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tssgeom.errors import ShapeError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.recording import Recording
from tssgeom.io.formats.runs import read_run
from tssgeom.stream import Frame

POINTS = np.array([[[10.0 * k + f, k * k + 1, 5 - f] for k in range(5)] for f in range(3)])
"""[frame, point, axis] [mm]"""
NAMES = [f"Scope:S{k}" for k in range(1, 6)]
MOTIVE = (
    "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,120.000000,Total Exported Frames,3,"
    "Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global"
)


def written(path: Path, head: Sequence[str], rows: Sequence[str]) -> Path:
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    return path


def cells(points: np.ndarray, lost: tuple[int, int] | None = None, gap: str = "") -> list[list[str]]:
    rows = [[f"{value:.6f}" for value in frame.ravel()] for frame in points]
    if lost is not None:
        rows[lost[0]][3 * lost[1] : 3 * lost[1] + 3] = [gap] * 3
    return rows


def frames_of(recording: Recording) -> list[Frame]:
    frames = [*recording.frames]
    assert all(isinstance(frame, Frame) for frame in frames), frames
    return frames  # type: ignore[return-value]


def require_points(recording: Recording, step: float, lost: tuple[int, int] | None = None) -> None:
    wanted = POINTS / 1e3
    if lost is not None:
        wanted[lost] = np.nan
    frames = frames_of(recording)
    np.testing.assert_allclose([frame.points for frame in frames], wanted, rtol=1e-9)
    np.testing.assert_allclose([frame.time for frame in frames], step * np.arange(3), atol=1e-6)


def motive(
    path: Path, kinds: Sequence[str], titled: bool, unit: str = "Meters", factor: float = 1e-3
) -> Path:
    first = ["", ",Type,", ",Name,", ",ID,"] if titled else ["", ",,", ",,", ",,"]
    names = [f"{name} {kind}" if kind != "Marker" else name for kind in kinds for name in NAMES]
    of_kinds = [kind for kind in kinds for _ in NAMES]
    three = [
        ",".join(each for each in row for _ in "xyz")
        for row in (of_kinds, names, [str(k) for k in range(len(names))], ["Position"] * len(names))
    ]
    head = [MOTIVE.format(unit=unit), "", *(a + b for a, b in zip(first[1:], three[:3], strict=True))]
    head += [",," + three[3], "Frame,Time (Seconds)," + ",".join(["X,Y,Z"] * len(names))]
    rows = [
        ",".join([str(f), f"{f / 120:.6f}", *row, *(["1.5"] * 15 * (len(kinds) - 1))])
        for f, row in enumerate(cells(POINTS * factor, (1, 2)))
    ]
    return written(path, head, rows)


@pytest.mark.parametrize("titled", [False, True])
@pytest.mark.parametrize(("unit", "factor"), [("Meters", 1e-3), ("Millimeters", 1.0), ("Centimeters", 0.1)])
def test_markers_of_motive_are_points_in_the_unit_of_the_first_row(titled, unit, factor, tmp_path):
    recording = open_recording(motive(tmp_path / "take.csv", ["Marker"], titled, unit, factor))
    require_points(recording, 1 / 120, (1, 2))
    assert "Motive's export: positions of markers" in recording.notes
    assert "each row read as the 5 points of a frame, 'Scope:S1' to 'Scope:S5'" in recording.notes


def test_four_rigid_bodies_of_motive_are_the_points_and_their_markers_are_not(tmp_path):
    path = motive(tmp_path / "take.csv", ["Rigid Body", "Rigid Body Marker", "Marker"], titled=True)
    recording = open_recording(path)
    require_points(recording, 1 / 120, (1, 2))
    assert "Motive's export: positions of rigid bodies" in recording.notes


def test_rotations_and_errors_of_motives_rigid_bodies_are_no_points(tmp_path):
    of_one = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]
    rows = zip(*(cells(POINTS), [["0.5"]] * 3), strict=True)
    bodies = [
        [*["0.1", "0.2", "0.3", "0.9", *row[3 * k : 3 * k + 3], "0.001"]] for row, _ in rows for k in range(5)
    ]
    head = [
        MOTIVE.format(unit="Millimeters"),
        ",Type," + ",".join(["Rigid Body"] * 40),
        ",Name," + ",".join(name for name in NAMES for _ in of_one),
        ",ID," + ",".join("7" for _ in range(40)),
        ",Parent," + "," * 39,
        ",," + ",".join(of_one * 5),
        "Frame,Time (Seconds)," + ",".join(["X,Y,Z,W,X,Y,Z,"] * 5),
    ]
    lines = [
        ",".join([str(f), f"{f / 120:.6f}", *(cell for body in bodies[5 * f : 5 * f + 5] for cell in body)])
        for f in range(3)
    ]
    require_points(open_recording(written(tmp_path / "take.csv", head, lines)), 1 / 120)


def test_a_take_of_three_markers_is_refused_with_what_it_holds(tmp_path):
    path = motive(tmp_path / "take.csv", ["Marker"], titled=True)
    text = path.read_text(encoding="utf-8").replace("Marker,Marker,Marker", "Bone,Bone,Bone", 2)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ShapeError, match="the positions of 3 markers and 0 rigid bodies: export those of"):
        open_recording(path)


def vicon(lost: bool = False) -> list[str]:
    head = [
        *("Trajectories", "100", ",," + ",,,".join(NAMES)),
        *("Frame,Sub Frame," + ",".join(["X,Y,Z"] * 5), ",," + ",".join(["mm"] * 15)),
    ]
    rows = cells(POINTS, (1, 2) if lost else None)
    return [*head, *(",".join([str(f + 1), "0", *row]) for f, row in enumerate(rows))]


def test_trajectories_of_nexus_have_the_unit_of_their_row_and_the_rate_of_the_second_line(tmp_path):
    recording = open_recording(written(tmp_path / "trial.csv", vicon(lost=True), []))
    require_points(recording, 0.01, (1, 2))
    assert "time from the frames, 100 a second" in recording.notes


def test_of_several_tables_of_nexus_that_of_trajectories_is_read(tmp_path):
    devices = [
        "Devices",
        "1000",
        ",,Plate",
        "Frame,Sub Frame,Fx",
        ",,N",
        *(f"1,{k},3.5" for k in range(9)),
        "",
    ]
    recording = open_recording(written(tmp_path / "trial.csv", [*devices, *vicon(), "", *devices], []))
    require_points(recording, 0.01)


def test_a_spreadsheet_that_pads_the_lines_of_nexus_changes_nothing(tmp_path):
    padded = [line + "," * (16 - line.count(",")) for line in vicon()]
    require_points(open_recording(written(tmp_path / "trial.csv", padded, [])), 0.01)


def qtm(named: bool, timed: bool, gap: str) -> list[str]:
    head = ["NO_OF_FRAMES\t3", "NO_OF_CAMERAS\t8", "NO_OF_MARKERS\t5", "FREQUENCY\t100", "DESCRIPTION\t--"]
    head += ["TIME_STAMP\t2026-11-12, 14:40:21.114\t81234.5", "DATA_INCLUDED\t3D"]
    head += ["MARKER_NAMES\t" + "\t".join(NAMES), "TRAJECTORY_TYPES" + "\tMeasured" * 5]
    columns = [f"{name} {axis}" for name in NAMES for axis in "XYZ"]
    head += ["\t".join([*(["Frame", "Time"] if timed else []), *columns])] if named else []
    rows = [
        "\t".join([*([str(f + 1), f"{f / 100:.5f}"] if timed else []), *row])
        for f, row in enumerate(cells(POINTS, (1, 2), gap))
    ]
    return [*head, *rows]


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize(("gap", "lost"), [("0.000", 1), ("", 0)])
def test_markers_of_qtm_are_points_in_mm_and_lost_ones_are_zeros_or_empty(named, gap, lost, tmp_path):
    recording = open_recording(written(tmp_path / "m.tsv", qtm(named, True, gap), []))
    require_points(recording, 0.01, (1, 2))
    assert ("1 points at exactly 0,0,0 taken as missing" in recording.notes) == bool(lost)


def test_without_a_column_of_time_qtms_rows_are_counted(tmp_path):
    recording = open_recording(written(tmp_path / "m.tsv", qtm(True, False, "0.000"), []))
    require_points(recording, 1.0, (1, 2))


@pytest.mark.parametrize("key", ["MARKER_NAMES", "BODY_NAMES"])
def test_bodies_of_qtm_are_refused_with_what_to_export(tmp_path, key):
    lines = [line.replace("\t3D", "\t6D").replace("MARKER_NAMES", key) for line in qtm(True, True, "")]
    with pytest.raises(ShapeError, match="QTM exported 6D: export 3D data as TSV, with its header"):
        open_recording(written(tmp_path / "m.tsv", lines, []))


@pytest.mark.parametrize(
    "head",
    [
        ["," + ",".join(name for name in NAMES for _ in "xyz"), "time_s," + ",".join(["x,y,z"] * 5)],
        [
            "," + ",".join(name for name in NAMES for _ in "xyz"),
            "," + ",".join(["x,y,z"] * 5),
            "time_s" + "," * 15,
        ],
        ["time_s," + ",,,".join(NAMES) + ",,", "," + ",".join(["x,y,z"] * 5)],
    ],
    ids=["named index", "index in a row of its own", "merged cells"],
)
def test_columns_that_two_rows_name_together_are_joined(head, tmp_path):
    rows = [",".join([f"{f:g}", *row]) for f, row in enumerate(cells(POINTS))]
    recording = open_recording(written(tmp_path / "frame.csv", head, rows), "mm")
    require_points(recording, 1.0)
    assert any(note.startswith("names joined from") for note in recording.notes)


def test_a_preamble_over_names_that_differ_is_no_part_of_them(tmp_path):
    head = ["Test 7,by hand,,,", "time_s,x_mm,y_mm,z_mm,note"]
    rows = [f"0,{k},{k * k},0,1" for k in range(5)]
    (frame,) = frames_of(open_recording(written(tmp_path / "test.csv", head, rows)))
    np.testing.assert_allclose(frame.points[:, 0] * 1e3, range(5))


def test_header_rows_that_name_a_column_twice_are_refused_with_what_to_write(tmp_path):
    head = ["a," + ",".join(["S"] * 15), "time_s," + ",".join(["x,y,z"] * 5)]
    rows = [",".join([f"{f:g}", *row]) for f, row in enumerate(cells(POINTS))]
    with pytest.raises(ShapeError, match="2 header rows, and 'x' is there twice: write one row of names"):
        open_recording(written(tmp_path / "frame.csv", head, rows), "mm")


@pytest.mark.parametrize(
    "comment", ["# units: cm", "# Unit = cm", "% coordinates in cm", "# unit of length (cm)", "# Units cm"]
)
@pytest.mark.parametrize("unit", [None, "mm"])
def test_a_unit_in_a_comment_is_that_of_the_coordinates(tmp_path, comment, unit):
    path = written(
        tmp_path / "a.csv", [comment, "x,y,z"], [",".join(row[:3]) for row in cells(POINTS[:, :1])]
    )
    recording = open_recording(path, unit=unit)
    (frame,) = frames_of(recording)
    np.testing.assert_allclose(frame.points, POINTS[:, 0] / 100.0)
    assert any("a comment states cm" in note for note in recording.notes)


def test_a_unit_in_a_comment_is_that_of_points_side_by_side(tmp_path):
    head = ["# units: cm", "Time [s]," + ",".join(f"S{k}_{axis}" for k in range(1, 6) for axis in "xyz")]
    rows = [",".join([f"{f:g}", *row]) for f, row in enumerate(cells(POINTS))]
    recording = open_recording(written(tmp_path / "a.csv", head, rows), None)
    for frame, points in zip(frames_of(recording), POINTS, strict=True):
        np.testing.assert_allclose(frame.points, points / 100.0)
    assert any("a comment states cm" in note for note in recording.notes)


def test_a_unit_in_a_comment_that_contradicts_the_option_is_refused(tmp_path):
    path = written(
        tmp_path / "a.csv", ["# units: m", "x,y,z"], [",".join(row) for row in cells(POINTS[:, :1])]
    )
    with pytest.raises(ShapeError, match="--unit says mm"):
        open_recording(path, unit="mm")


def test_points_whose_names_are_sorted_as_words_are_in_the_order_of_their_numbers(tmp_path):
    points = np.array([[10.0 * k, k * k, 5.0] for k in range(12)])
    order = sorted(range(12), key=lambda k: f"S{k + 1}")
    head = ",".join(f"S{k + 1}_{axis}_mm" for k in order for axis in "xyz")
    rows = [",".join(f"{value:g}" for value in points[order].ravel())] * 2
    for frame in frames_of(open_recording(written(tmp_path / "a.csv", [head], rows))):
        np.testing.assert_allclose(frame.points, points / 1000.0)


def test_points_in_another_order_stay_as_the_table_has_them(tmp_path):
    order = [4, 0, 2, 1, 3]
    head = ",".join(f"S{k + 1}_{axis}_mm" for k in order for axis in "xyz")
    (frame,) = frames_of(
        open_recording(written(tmp_path / "a.csv", [head], [",".join(cells(POINTS[:1])[0])]))
    )
    np.testing.assert_allclose(frame.points, POINTS[0] / 1000.0)


@pytest.mark.parametrize("comment", ["# unit 4 of the tracker", "# units: see the manual", "# time unit: s"])
def test_words_of_a_comment_that_state_no_length_are_no_unit(tmp_path, comment):
    path = written(tmp_path / "a.csv", [comment, "x,y,z"], [",".join(row) for row in cells(POINTS[:, :1])])
    (frame,) = frames_of(open_recording(path, unit="mm"))
    np.testing.assert_allclose(frame.points, POINTS[:, 0] / 1000.0)


def test_a_note_counts_the_lines_before_a_table_and_not_its_comments(tmp_path):
    table = ["time_s,tension_in_N,tension_out_N", "0,1,2", "1,2,3"]
    commented = written(tmp_path / "a.csv", ["# a comment", "# another"], table)
    assert read_run(commented).notes == ()
    below = written(tmp_path / "b.csv", ["Rig of the second floor", "cold", "# a comment"], table)
    assert read_run(below).notes == ("2 lines before the table are not read",)


def test_columns_that_a_row_leaves_open_are_named_by_the_row_above(tmp_path):
    """As OpenSim writes markers: `Frame#` and `Time` beside the labels, the axes below."""
    head = [
        "PathFileType\t4\t(X/Y/Z)\ttake.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        "20\t20\t3\t5\tmm",
        "Frame#\tTime\t" + "\t\t\t".join(NAMES) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{k}" for k in range(1, 6) for axis in "XYZ"),
    ]
    rows = ["\t".join([str(f + 1), f"{0.05 * f:.3f}", *row]) for f, row in enumerate(cells(POINTS))]
    recording = open_recording(written(tmp_path / "take.txt", head, rows), "mm")
    require_points(recording, 0.05)
    assert "'Frame#', 'Time' named one row above the others" in recording.notes


def test_ends_below_quantities_leave_the_time_its_name(tmp_path):
    head = ["Zeit;Zugkraft;;Weg", ";proximal;distal;Motor", "s;N;N;mm"]
    rows = [f"{0.1 * k:.1f};{8 + k};{5 + k};{k}" for k in range(6)]
    read = read_run(written(tmp_path / "run.csv", head, rows))
    np.testing.assert_allclose(read.time, 0.1 * np.arange(6))
    assert read.tension_out is not None
    assert read.tension_out[0] == 5.0
    assert read.displacement_in is not None
    np.testing.assert_allclose(read.displacement_in, 1e-3 * np.arange(6))


@pytest.mark.parametrize("mark", ["#", "# ", "% ", "// "])
def test_a_row_that_is_a_comment_is_left_out_and_counted(tmp_path, mark):
    rows = [",".join(row) for row in cells(POINTS[:1].transpose(1, 0, 2))]
    path = written(tmp_path / "a.csv", ["x_mm,y_mm,z_mm"], [*rows[:2], f"{mark}999,99,9", *rows[2:]])
    recording = open_recording(path)
    (frame,) = frames_of(recording)
    np.testing.assert_allclose(frame.points, POINTS[0] / 1e3)
    assert "1 row in comments not read" in recording.notes


@pytest.mark.parametrize("row", ["*,*,*", "***;***;***"])
def test_marks_of_a_lost_point_are_no_comment(tmp_path, row):
    mark = row.strip("*")[0]
    rows = [mark.join(each) for each in cells(POINTS[:1].transpose(1, 0, 2))]
    path = written(tmp_path / "a.csv", [mark.join(("x_mm", "y_mm", "z_mm"))], [*rows, row])
    with pytest.raises(ShapeError, match=r"line 7: x_mm is '\*+': write a number or leave it empty"):
        open_recording(path)
