"""JSON lines: frames decoded one at a time, each bad line rejected alone."""

import json
from pathlib import Path

import numpy as np
import pytest

from tssgeom.errors import ShapeError
from tssgeom.io.formats.files import Recording, open_recording
from tssgeom.io.formats.jsonl import frame_of
from tssgeom.io.formats.paths import LONGEST_LINE
from tssgeom.io.formats.recording import GIVE_UNIT
from tssgeom.stream import Frame, Rejected

POINTS = [[0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 1, 1]]


def line(time: float | str, **fields: object) -> str:
    return json.dumps({"t": time, "points": POINTS, "unit": "mm"} | fields)


def opened(folder: Path, *lines: str, unit: str | None = None) -> Recording:
    path = folder / "run.jsonl"
    path.write_text("\n".join(lines) + "\n")
    return open_recording(path, unit)


def reasons(recording: Recording) -> dict[int, str]:
    return {item.seq: item.reason for item in recording.frames if isinstance(item, Rejected)}


def test_every_field_arrives_in_si(tmp_path):
    text = line(
        12.345,
        s=[0, 1, 2.5, 4],
        tension_in_N=8.1,
        tension_out_N=5.0,
        displacement_in_m=0.002,
        elongation_m=0.001,
        id="a7",
        colour="red",
    )
    (frame,) = opened(tmp_path, text).frames
    assert isinstance(frame, Frame)
    np.testing.assert_array_equal(frame.points, np.array(POINTS) / 1000)
    np.testing.assert_array_equal(frame.stations, [0, 0.001, 0.0025, 0.004])
    assert (frame.time, frame.tension_in, frame.tension_out) == (12.345, 8.1, 5.0)
    assert (frame.displacement_in, frame.elongation, frame.id) == (0.002, 0.001, "a7")


def test_a_file_knows_its_length_and_unit_before_it_is_read(tmp_path):
    recording = opened(tmp_path, line(0), "broken", line(1))
    assert (recording.frame_count, recording.unit, recording.kind, recording.timed) == (
        3,
        "mm",
        "jsonl",
        True,
    )


def test_one_line_without_time_is_a_static_shape(tmp_path):
    recording = opened(tmp_path, json.dumps({"points": POINTS, "unit": "m"}))
    assert not recording.timed
    assert recording.warnings == ()


def test_lines_without_time_are_counted_with_a_warning(tmp_path):
    recording = opened(tmp_path, *[json.dumps({"points": POINTS, "unit": "m"})] * 3)
    assert [item.time for item in recording.frames] == [0.0, 1.0, 2.0]
    assert recording.warnings == ("no time: the frames are counted, one a second",)


def test_null_is_a_missing_point(tmp_path):
    points = [[0, 0, 0], None, [2, None, 0], [3, 1, 1]]
    (frame,) = opened(tmp_path, line(0, points=points)).frames
    assert isinstance(frame, Frame)
    np.testing.assert_array_equal(
        np.isnan(frame.points), np.array([[0] * 3, [1] * 3, [1] * 3, [0] * 3], dtype=bool)
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"t":1,"points":[[1,2],[3,4]],"unit":"mm"}', "array` of length 3"),
        ('{"t":1,"points":[[1,2,3],[3,4', "truncated"),
        ('{"t":1,"points":[[1,2,NaN]],"unit":"mm"}', "null for NaN or a missing point"),
        ('{"t":1,"points":[[1,2,"3"]],"unit":"mm"}', "got `str`"),
        ('{"t":1,"unit":"mm"}', "missing required field `points`"),
        ('{"points":[[1,2,3]],"unit":"mm"}', 'the line has no time: write "t" in s'),
        (
            '{"t":1,"points":[[1,2,3]]}',
            f'write "unit": "mm" or "unit": "m" in each line, or {GIVE_UNIT}',
        ),
        ('{"t":1,"points":[[1,2,3]],"s":[1,2],"unit":"mm"}', "2 stations for 1 points"),
        ('{"t":0,"points":[[1,2,3]],"unit":"mm"}', "time 0 s comes after 0 s"),
        ('{"t":1,"points":[[1,2,3]],"unit":"mm","tension_in_N":"eight"}', 'write "tension_in_N" as a number'),
        ('{"t":"0.3","points":[[1,2,3]],"unit":"mm"}', '`$.t`: write "t" as a number'),
        ('{"t":1,"points":[[1,2,3]],"unit":"mm","id":{}}', 'write "id" as text or a whole number'),
        ('{"t":1,"points":[[1,2,3]],"unit":"mm","s":["a"]}', 'write "s" as a list of numbers'),
        ('{"t":1,"points":[[1,2,3]],"unit":"mm","directions":[1]}', "write each direction as [x,y,z]"),
        ("[1, 2]", "Expected `object`, got `array`: write one JSON object a line"),
        ("hello", "one JSON object a line"),
        ("{" + " " * LONGEST_LINE + "}", "longer than 1048576 bytes (1 MiB)"),
    ],
)
def test_a_bad_line_rejects_its_frame_only(tmp_path, text, says):
    recording = opened(tmp_path, line(0), text, line(2))
    outcome = reasons(recording)
    assert list(outcome) == [1]
    assert says in outcome[1]
    assert "\n" not in outcome[1]
    assert [item.time for item in recording.frames if isinstance(item, Frame)] == [0.0, 2.0]


def test_the_reason_names_the_line_of_the_file(tmp_path):
    assert reasons(opened(tmp_path, line(0), "", "", "broken"))[1].startswith("line 4: ")


def test_a_line_of_just_one_mebibyte_is_read(tmp_path):
    text = line(1)
    padded = text[:-1] + " " * (LONGEST_LINE - len(text)) + "}"
    assert len(padded) == LONGEST_LINE
    assert reasons(opened(tmp_path, line(0), padded)) == {}


def test_lines_in_different_units_are_refused(tmp_path):
    with pytest.raises(ShapeError, match="line 2: mixed units, m after mm"):
        opened(tmp_path, line(0), line(1, unit="m"))


def test_no_unit_is_refused_with_the_hint(tmp_path):
    with pytest.raises(ShapeError, match=r"no unit.*--unit mm\|m"):
        opened(tmp_path, json.dumps({"t": 0, "points": POINTS}))


def test_an_unknown_unit_is_refused(tmp_path):
    with pytest.raises(ShapeError, match="the unit is 'inch': write mm or m"):
        opened(tmp_path, line(0, unit="inch"))


def test_unit_option_serves_lines_without_one_and_no_others(tmp_path):
    (frame,) = opened(tmp_path, json.dumps({"t": 0, "points": POINTS}), unit="mm").frames
    assert isinstance(frame, Frame)
    np.testing.assert_array_equal(frame.points, np.array(POINTS) / 1000)
    with pytest.raises(ShapeError, match="the file is in mm, --unit says m"):
        opened(tmp_path, line(0), unit="m")


@pytest.mark.parametrize("text", ["", "\n\n", "hello\nworld\n", "\x00\x01"])
def test_a_file_without_any_frame_is_refused(tmp_path, text):
    (tmp_path / "run.jsonl").write_text(text)
    with pytest.raises(ShapeError, match=r"the file is empty|no line is a frame"):
        open_recording(tmp_path / "run.jsonl")


def test_frames_are_read_lazily_and_again(tmp_path):
    recording = opened(tmp_path, *(line(k) for k in range(5)))
    first = next(iter(recording.frames))
    assert first.time == 0.0
    assert [item.time for item in recording.frames] == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_one_line_decodes_for_a_stream_too():
    frame = frame_of(line(3).encode(), None)
    assert (frame.time, frame.points.shape) == (3.0, (4, 3))


def test_directions_and_length_of_a_line_arrive():
    line = b'{"t":1,"unit":"mm","points":[[0,0,0],[1,0,0]],"directions":[[1,0,0],null],"length_m":0.5}'
    frame = frame_of(line, None)
    np.testing.assert_array_equal(frame.directions, [[1.0, 0.0, 0.0], [np.nan] * 3])
    assert frame.length == 0.5
    with pytest.raises(ShapeError, match="1 directions for 2 points"):
        frame_of(line.replace(b",null]", b"]"), None)


def test_a_byte_order_mark_is_passed_over(tmp_path):
    (tmp_path / "run.jsonl").write_bytes(b"\xef\xbb\xbf" + line(0).encode())
    (frame,) = open_recording(tmp_path / "run.jsonl").frames
    assert isinstance(frame, Frame)


def test_where_no_line_is_a_frame_the_first_fault_is_reported(tmp_path):
    not_json = line(0)[:-1] + ', "unit": NaN}'  # what Python writes, and JSON does not know
    with pytest.raises(ShapeError, match=r"no line is a frame; the first: .*invalid character"):
        opened(tmp_path, not_json)
    with pytest.raises(ShapeError, match=r"Expected `float \| null`, got `str` - at `\$\.t`: write"):
        opened(tmp_path, line("noon"))


MISSPELT = "'temprature_C' is not read: the nearest name is temperature_C"


def test_a_key_that_is_not_read_has_a_warning_with_the_name_that_is_meant(tmp_path):
    text = line(1.0, tension_in_N=5.0, temprature_C=30.0, colour="red")
    warnings = ("'colour' is not read", MISSPELT)
    assert frame_of(text.encode(), None).warnings == warnings
    with_null = line(1.0, points=[*POINTS, None], tension_in_N=5.0, temprature_C=30.0, colour="red")
    assert frame_of(with_null.encode(), None).warnings == warnings
    recording = opened(tmp_path, text, line(2.0))
    assert recording.warnings == warnings
    assert [item.warnings for item in recording.frames] == [(), ()]  # a file is warned of once


@pytest.mark.parametrize("key", ["timestamp", "time", "Time [s]"])
def test_a_second_time_is_no_drive(key):
    (warning,) = frame_of(line(1.0).replace("{", f'{{"{key}": 1.0, ', 1).encode(), None).warnings
    assert warning == f"{key!r} is not read: the nearest name is t"


def test_warnings_of_a_frame_are_few_and_short_whatever_its_keys_are():
    keys = {f"{k:04}" + "x" * 2000: k for k in range(400)}
    warnings = frame_of(line(1.0, **keys).encode(), None).warnings
    assert len(warnings) == 33
    assert warnings[-1] == "368 more names are not read"
    assert max(map(len, warnings)) < 100


def test_a_key_that_is_no_text_rejects_its_frame_only(tmp_path):
    lines = [
        b'{"t": 0, "points": [[0,0,0],[1,0,0]], "unit": "mm", "tens\x85": 1}',
        b'{"t": 1, "points": [[0,0,0],[1,0,0]], "unit": "mm"}',
    ]
    (tmp_path / "shape.jsonl").write_bytes(b"\n".join(lines))
    bad, good = open_recording(tmp_path / "shape.jsonl", None).frames
    assert isinstance(bad, Rejected)
    assert bad.reason.startswith("line 1: ")
    assert "utf-8" in bad.reason.lower()  # msgspec's own words
    assert isinstance(good, Frame)
