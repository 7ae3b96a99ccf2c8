"""Files as laboratories write them are read right, or what is missing is asked for."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.io.variants import BEGIN, VARIANTS, markers, run
from tssgeom.errors import SettingsError, ShapeError
from tssgeom.io.formats.files import find_inputs, open_recording
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.io.formats.laboratory.names import meaning_of
from tssgeom.io.formats.laboratory.table import laboratory_table
from tssgeom.io.formats.recording import usable
from tssgeom.io.formats.runs import read_run
from tssgeom.stream import Frame, Rejected


def read_markers(path: Path) -> dict[str, np.ndarray]:
    frames = [frame for frame in open_recording(path).frames if isinstance(frame, Frame)]
    return {
        "time": np.array([frame.time for frame in frames]),
        "points": np.array([frame.points for frame in frames]),
        "tension": np.array([frame.tension_in for frame in frames], float),
    }


def true_markers() -> dict[str, np.ndarray]:
    time, *points, tension = markers().columns
    return {
        "time": time[::12],
        "points": np.column_stack(points).reshape(3, 12, 3) / 1e3,
        "tension": tension[::12],
    }


def read_channels(path: Path) -> dict[str, np.ndarray]:
    read = read_run(path)
    return {"time": read.time, "in": read.tension_in, "out": read.tension_out, "drive": read.displacement_in}


def true_channels() -> dict[str, np.ndarray]:
    return dict(zip(("time", "in", "out", "drive"), run().columns, strict=True))


def assert_alike(read: dict[str, np.ndarray], true: dict[str, np.ndarray]) -> None:
    since = read["time"][0] if read["time"][0] > 1e6 else 0.0
    assert since in (0.0, pytest.approx(BEGIN))
    for name, values in read.items():
        assert values is not None, name
        expected = true[name] + (since if name == "time" else 0.0)
        np.testing.assert_allclose(
            values, expected, rtol=1e-9, atol=1e-6 if name == "time" else 1e-12, err_msg=name
        )


@pytest.mark.parametrize("name", VARIANTS)
def test_markers_of_any_variant_are_read_right(name, tmp_path):
    assert_alike(read_markers(VARIANTS[name](tmp_path, markers())), true_markers())


@pytest.mark.parametrize("name", VARIANTS)
def test_a_run_of_any_variant_is_read_right(name, tmp_path):
    assert_alike(read_channels(VARIANTS[name](tmp_path, run())), true_channels())


def test_at_least_as_many_variants_as_promised_are_read():
    assert 2 * len(VARIANTS) >= 60


ONE_OPTION = [
    ("time_s,tension_in_N,Pos\n", "Pos=displacement_in_m:mm", "displacement_in", 1e-3),
    ("time_s,Force 1 [N],tension_out_N\n", "Force 1 [N]=tension_in_N", "tension_in", 1.0),
    ("time_s,tension_out_N,T_in\n", "T_in=tension_in_N:mN", "tension_in", 1e-3),
    (
        "time_s,tension_out_N,Motor angle [deg]\n",
        "Motor angle [deg]=displacement_in_m:0.2mm",
        "displacement_in",
        2e-4,
    ),
    ("time_s,tension_out_N,Pull [V]\n", "Pull [V]=tension_in_N:-2N", "tension_in", -2.0),
]


@pytest.mark.parametrize(("header", "option", "field", "factor"), ONE_OPTION)
def test_what_is_not_certain_is_read_with_one_option(tmp_path, header, option, field, factor):
    path = tmp_path / "run.csv"
    path.write_text(header + "0,1,300\n0.1,2,400\n0.2,1,300\n")
    column = header.strip().split(",").index(option.partition("=")[0])
    read = getattr(read_run(path, ColumnMap([option])), field)
    np.testing.assert_allclose(read, factor * np.array([[1, 2, 1], [300, 400, 300]])[column - 1])


@pytest.mark.parametrize(("header", "option"), [each[:2] for each in ONE_OPTION if "angle" not in each[0]])
def test_the_refusal_names_the_option(tmp_path, header, option):
    path = tmp_path / "run.csv"
    path.write_text(header + "0,1,300\n0.1,2,400\n0.2,1,300\n")
    with pytest.raises(ShapeError, match=re.escape(f'--map "{option.partition("_in")[0]}')):
        read_run(path)


def test_the_option_comes_before_the_file_beside_the_data_and_that_before_the_rig(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time_s,tension_in_N,Pos\n0,1,3\n0.1,2,4\n")
    rig = {"Pos": "displacement_in_m:m"}
    assert read_run(path, ColumnMap((), rig)).displacement_in[0] == 3.0
    folder = tmp_path / "beside"
    folder.mkdir()
    (folder / "columns.toml").write_text('[columns]\nPos = "displacement_in_m:cm"\n')
    beside = path.rename(folder / "run.csv")
    assert read_run(beside, ColumnMap((), rig)).displacement_in[0] == pytest.approx(0.03)
    assert read_run(beside, ColumnMap(["Pos=displacement_in_m:mm"], rig)).displacement_in[0] == pytest.approx(
        0.003
    )


def test_an_empty_file_beside_the_data_states_nothing(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time_s,tension_in_N\n0,1\n0.1,2\n")
    (tmp_path / "columns.toml").write_text("")  # as a shell leaves it that writes to it
    assert read_run(path).tension_in[1] == 2.0


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ("Pos", 'write "NAME=channel'),
        ("Pos=displacment_in_m:mm", "did you mean displacement_in_m"),
        ("Pos=tension_in:mm", "'mm' is no unit of force"),
    ],
)
def test_an_option_that_says_nothing_is_refused(option, says):
    with pytest.raises(SettingsError, match=says):
        ColumnMap([option])


def test_recordings_by_a_column_are_parts_of_their_file(tmp_path):
    first, second = markers(), run()
    sheet = first.with_column("trial", [1.0] * 12 + [2.0] * 24)
    (tmp_path / "two.csv").write_text(sheet.text())
    parts = find_inputs([tmp_path / "two.csv"])
    assert [path.name for path in parts] == ["two.csv#1", "two.csv#2"]
    assert [open_recording(path).frame_count for path in parts] == [1, 2]
    (tmp_path / "runs.csv").write_text(second.with_column("run", [1.0] * 30 + [2.0] * 30).text())
    with pytest.raises(ShapeError, match=r"it holds 2 .*runs\.csv#1"):
        read_run(tmp_path / "runs.csv")
    np.testing.assert_array_equal(read_run(tmp_path / "runs.csv#2").time, second.columns[0][30:])


def test_a_numbered_marker_that_is_too_far_out_raises_no_warning_of_its_length(tmp_path):
    (tmp_path / "far.txt").write_text("Nr;x_mm;y_mm;z_mm\n1;1e300;0;0\n2;1;0;0\n3;2;0;0\n4;3;1;0\n")
    (frame,) = open_recording(tmp_path / "far.txt")
    assert isinstance(frame, Frame)
    assert not usable(frame)


def test_a_note_says_how_a_file_was_read(tmp_path):
    (tmp_path / "run.csv").write_text("Zeit [ms];Force [kgf];T_out\n0;1,5;7\n50;2,5;8\n")
    with pytest.raises(ShapeError, match=r"'Force \[kgf\]' may be"):
        read_run(tmp_path / "run.csv")
    (tmp_path / "run.csv").write_text("Zeit [ms];Force [kgf]\n0;1,5\n50;2,5\n")
    notes = read_run(tmp_path / "run.csv").notes
    assert "Force [kgf] read as tension_in_N × 9.80665" in notes
    assert {"decimal comma", "Zeit [ms] read as time_s × 0.001"} <= {*notes}


@pytest.mark.parametrize(
    ("key", "rejected"),
    [("T_in", True), ("force_N", True), ("displacement_target_mm", True), ("camera", False)],
)
def test_a_key_that_may_be_a_drive_rejects_its_frame_where_nothing_else_drives(tmp_path, key, rejected):
    points = [[float(k), 0.1 * k * k, 0.0] for k in range(8)]
    path = tmp_path / "a.jsonl"
    path.write_text(json.dumps({"t": 0.0, "points": points, "unit": "mm", key: 8.0}) + "\n")
    (item,) = open_recording(path).frames
    assert isinstance(item, Rejected) == rejected
    path.write_text(json.dumps({"points": points, "unit": "mm", "tension_in_N": 5.0, key: 8.0}) + "\n")
    recording = open_recording(path)
    assert all(isinstance(item, Frame) for item in recording.frames)
    assert sum(repr(key) in warning for warning in recording.warnings) == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time_s,T_in [-N]\n0,1\n1,2\n", "'T_in [-N]' may be a drive"),
        ("Time [s],Load [4.6 N]\n0,1\n1,2\n", "'Load [4.6 N]' may be a drive"),
        ("time_s,Force [%]\n0,1\n1,2\n", "'Force [%]' may be a drive"),
        ("time_s,Fx [N],Fy [N]\n0,1,2\n1,2,3\n", "'Fx [N]' may be a drive"),
        ("time_s,F [N],F [N]\n0,1,2\n1,2,3\n", "column 'F [N]' is there twice"),
        ("Time,F [N]\n0,1\n10,2\n", 'give --map "Time=time_s:ms"'),
        (
            "t [s];F [N]\n0;1,5\n1;2.5\n",
            "has '1,5' (line 2) and '2.5' (line 3), the table both decimal marks",
        ),
        ("t [s];T_in [N];T_out [N]\n0,5;1,5;0.5\n1,5;2,5;1.5\n", "column 'T_out [N]' has '0.5' (line 2)"),
        ("time_s,tension_in_N,tension_in_mN\n0,1,2\n1,2,3\n", "is tension_in_N too"),
    ],
)
def test_what_could_be_read_wrong_is_refused(tmp_path, text, says):
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(ShapeError, match=re.escape(says)):
        read_run(tmp_path / "run.csv")


@pytest.mark.parametrize(
    ("text", "time", "tension"),
    [
        ("t [s]\tF_in [mN]\n0\t1,234.5\n1\t12,234.5\n2\t2,000\n", [0, 1, 2], [1.2345, 12.2345, 2.0]),
        ("t [s];F_in [mN]\n0;1.234,5\n1;2.234,5\n", [0, 1], [1.2345, 2.2345]),
        ("Time,F [N]\n23:59:59.5,1\n00:00:00.5,2\n", [86399.5, 86400.5], [1, 2]),
        ("Date;Time;F [N]\n2024-01-01;10:00:00;1\n2024-01-01;10:00:01;2\n", [36000, 36001], [1, 2]),
        ("t [s];F soll [N];F ist [N]\n0;1;2\n1;2;3\n", [0, 1], [2, 3]),
    ],
)
def test_groups_of_thousands_midnight_dates_apart_and_set_points(tmp_path, text, time, tension):
    (tmp_path / "run.csv").write_text(text)
    read = read_run(tmp_path / "run.csv")
    np.testing.assert_allclose(read.time, time)
    np.testing.assert_allclose(read.tension_in, tension)


@pytest.mark.parametrize("minus", ["-", "\N{MINUS SIGN}"])
def test_the_minus_sign_of_unicode_is_one(tmp_path, minus):
    text = "time_s;tension_in_N\n" + "".join(f"0,{k};{minus}{k},5\n" for k in range(1, 9))
    (tmp_path / "run.csv").write_text(text, "utf-8")
    np.testing.assert_array_equal(read_run(tmp_path / "run.csv").tension_in, -np.arange(1, 9) - 0.5)


def test_a_target_in_a_run_is_named(tmp_path):
    (tmp_path / "run.csv").write_text("time_s,tension_in_N,displacement_target_m\n0,1,2\n1,2,3\n")
    (warning,) = read_run(tmp_path / "run.csv").warnings
    assert warning.startswith("column 'displacement_target_m' is not read")


def test_force_axes_beside_points_are_no_default_tension(tmp_path):
    rows = "".join(f"{k},{0.1 * k * k},0,3\n" for k in range(8))
    (tmp_path / "a.csv").write_text("x_mm,y_mm,z_mm,Fz [N]\n" + rows)
    with pytest.raises(ShapeError, match=r"'Fz \[N\]' may be a drive, and there is no other"):
        open_recording(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("Gelenkwinkel [°]", "joint_angle"),
        ("Motordrehmoment (Nm)", "motor_torque"),
        ("Motorstrom [A]", "motor_current"),
    ],
)
def test_german_compounds_are_read_as_their_parts(name, channel):
    meaning = meaning_of(name)
    assert meaning is not None
    assert meaning.channel == channel


@pytest.mark.parametrize("unit", ["N mm", "N.mm", "N*mm", "N·mm", "Nmm", "mN m", "mN-m"])
def test_a_unit_of_torque_may_have_a_space_or_a_dot(tmp_path, unit):
    path = tmp_path / "run.csv"
    path.write_text(f"Time (s),Motor torque ({unit})\n0,100\n1,200\n2,300\n3,400\n", encoding="utf-8")
    np.testing.assert_allclose(laboratory_table(path).values["motor_torque_Nm"], [0.1, 0.2, 0.3, 0.4])
    stated = ColumnMap([f"Motor torque ({unit})=motor_torque"])
    np.testing.assert_allclose(laboratory_table(path, stated).values["motor_torque_Nm"], [0.1, 0.2, 0.3, 0.4])


def test_a_unit_that_is_not_known_of_a_column_that_is_named_is_said(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("Time (s),Moment (furlong)\n0,1\n1,2\n2,3\n3,4\n", encoding="utf-8")
    read = laboratory_table(path, ColumnMap(["Moment (furlong)=motor_torque"]))
    assert any("'furlong' is no known unit, and Nm is assumed" in each for each in read.warnings)


def test_many_unclear_columns_are_one_short_line_and_those_with_numbers_are_suggested_as_tendons(
    tmp_path, capsys
):
    from pipelines.suggest import suggested

    path = tmp_path / "robot.csv"
    path.write_text(
        "time_s," + ",".join(f"servo_{k}_mm" for k in range(1, 10)) + "\n0" + ",1" * 9 + "\n1" + ",2" * 9
    )
    with pytest.raises(ShapeError) as refused:
        read_run(path)
    said = str(refused.value)
    assert '--map "servo_1_mm=displacement_in_1_m" or _out_' in said
    assert said.endswith("; likewise of " + ", ".join(f"'servo_{k}_mm'" for k in range(3, 10)))
    assert len(said) < 700
    suggested([path], (), None)
    printed = capsys.readouterr().out
    assert all(f'servo_{k}_mm = "displacement_in_{k}_m"' in printed for k in range(1, 10))


def test_counts_of_an_encoder_are_refused_with_the_option_for_an_angle(tmp_path):
    path = tmp_path / "tool.csv"
    path.write_text("time_s,Encoder [counts]\n0,1\n1,2\n")
    with pytest.raises(
        ShapeError, match=r"of counts with what one is, --map \"Encoder \[counts\]=motor_angle:0.001rad\""
    ):
        read_run(path)


def test_the_unit_in_the_name_of_a_channel_is_that_of_a_column_without_one(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("a,b [cm],c\n" + "".join(f"{10 * k},0.2,{k}\n" for k in range(5)))
    (frame,) = open_recording(path, None, ColumnMap(["a=x_mm", "b [cm]=y_mm", "c=z_mm"])).frames
    np.testing.assert_allclose(frame.points[2], [0.02, 0.002, 0.002])


GROUPED = """point;x_mm;y_mm;z_mm
0;800;800;800.0
1;1,141;829;800.0
2;1,463;927;800.0
3;-1,764;1,086;800.0
4;2,017;1,299;1,200.5
"""


@pytest.mark.parametrize("separator", [";", "\t", ","])
def test_integers_in_groups_beside_decimal_points_are_read_as_they_are(tmp_path, separator):
    cells = [line.split(";") for line in GROUPED.splitlines()]
    path = tmp_path / "excel.csv"
    path.write_text("\n".join(separator.join(f'"{c}"' if "," in c else c for c in row) for row in cells))
    (frame,) = open_recording(path).frames
    assert 1e3 * frame.points[:, 0] == pytest.approx([800, 1141, 1463, -1764, 2017])
    assert 1e3 * frame.points[:, 1] == pytest.approx([800, 829, 927, 1086, 1299])
    assert 1e3 * frame.points[:, 2] == pytest.approx([800, 800, 800, 800, 1200.5])


@pytest.mark.parametrize(
    ("second", "reason"),
    [
        (["1,800", "1,829", "1,927", "1,086", "1,299"], "column 'y_mm' has '1,800' (line 2), the table both"),
        (["829.5", "1.927", "1086", "1.299", "1,800"], "line 6: y_mm is '1,800': write 1800 or a point"),
    ],
)
def test_a_comma_that_may_be_a_decimal_mark_is_refused_beside_decimal_points(tmp_path, second, reason):
    head, *lines = [line.split(";") for line in GROUPED.splitlines()]
    rows = [[*line[:2], y, line[3]] for line, y in zip(lines, second, strict=True)]
    path = tmp_path / "excel.csv"
    path.write_text("\n".join(map(";".join, [head, *rows])))
    with pytest.raises(ShapeError, match=re.escape(reason)):
        list(open_recording(path).frames)
