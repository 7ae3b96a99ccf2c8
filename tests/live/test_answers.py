"""What a stream answers to frames, good and bad, one after the other."""

import json
import math
import os
from time import sleep

import pytest

from tests.live.peers import frame, half_circle, next_answer
from tests.live_process import PATIENCE, line, live, malformed

KEYS = {
    "t",
    "seq",
    "length_m",
    "total_angle_rad",
    "total_angle_se_rad",
    "tension_out_N",
    "elongation_m",
    "direction_index",
    "dead_zone",
    "segments",
    "latency_us",
    "dropped",
    "stale",
}

REPORT_COLLECTIONS = """
import gc, os

def report(phase, info):
    if phase == "stop" and info["generation"] == 2 and gc.isenabled():
        os.write(2, b"collected\\n")

gc.callbacks.append(report)
"""


def test_once_a_stream_is_ready_no_collection_keeps_its_first_frames_waiting(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(REPORT_COLLECTIONS)
    path = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
    with live(env={**os.environ, "PYTHONPATH": path}) as stream:
        stream.input.write(frame(0.0))
        stream.input.close()
        assert "segments" in next_answer(stream)
        assert stream.process.wait(PATIENCE) == 0
    (ready,) = (i for i, text in enumerate(stream.errors) if text.startswith("ready"))
    assert "collected" in stream.errors[:ready]
    assert "collected" not in stream.errors[ready:]


def test_a_frame_is_answered_with_its_geometry_tension_and_elongation(source, reader):
    source.sendall(line(half_circle(), 1.0, tension_in_N=10.0, noise_m=1e-5, id="a7"))
    reply = reader.until("id", "a7")[-1]
    assert set(reply) >= KEYS
    assert reply["t"] == 1.0
    assert reply["length_m"] == pytest.approx(0.5, rel=1e-6)  # coordinates are rounded to 1e-4 mm
    assert reply["total_angle_rad"] == pytest.approx(math.pi, rel=1e-5)
    assert sum(piece["angle_rad"] for piece in reply["segments"]) == pytest.approx(
        reply["total_angle_rad"], abs=1e-12
    )
    assert all(0.0 <= piece["angle_se_rad"] <= 0.01 for piece in reply["segments"])
    assert 0 < reply["tension_out_N"] < 10.0
    assert reply["latency_us"] > 0
    assert reply["stale"] is False
    assert "displacement_command_m" not in reply


def test_an_id_comes_back_as_it_was_given(source, reader):
    source.sendall(frame(1.0, id=7))
    assert reader.until("id", 7)[-1]["id"] == 7


def test_a_key_that_is_not_read_is_in_the_warnings_of_each_answer(source, reader):
    for time in (1.0, 2.0):
        source.sendall(frame(time, id=f"misspelt at {time}", tension_in_N=9.0, temprature_C=30.0))
        (warning,) = reader.until("id", f"misspelt at {time}")[-1]["warnings"]
        assert warning == "'temprature_C' is not read: the nearest name is temperature_C"
    source.sendall(
        frame(3.0, id="misspelt", tension_in_N=None, displacment_in_m=0.001)
    )  # and nothing else drives
    assert "nearest name is displacement_in_m" in reader.until("id", "misspelt")[-1]["rejected"]


def test_a_target_is_answered_with_the_command_that_reaches_it(source, reader):
    source.sendall(line(half_circle(), 1.0, tension_in_N=None, tension_out_target_N=4.0, id="wanted"))
    reply = reader.until("id", "wanted")[-1]
    assert reply["tension_out_N"] == pytest.approx(4.0, rel=1e-9)
    assert reply["displacement_command_m"] > 0


def test_every_kind_of_bad_line_is_rejected_with_its_reason_and_leaves_the_tendon_alone(source, reader):
    source.sendall(frame(1.0, tension_in_N=9.0, id="before"))
    before = reader.until("id", "before")[-1]
    for seq, (name, text) in enumerate(malformed(), start=before["seq"] + 1):
        source.sendall(text + b"\n")
        reply = reader.answer()
        assert set(reply) - {"id"} == {"t", "seq", "rejected"}, name
        assert reply["seq"] == seq, name
        assert len(reply["rejected"]) < 400, name
        assert "\n" not in reply["rejected"], name
    source.sendall(frame(2.0, tension_in_N=9.0, id="after"))
    after = reader.until("id", "after")[-1]
    assert after["tension_out_N"] == before["tension_out_N"]
    assert after["direction_index"] == before["direction_index"]


def test_a_refused_frame_is_named_by_its_time_and_id(source, reader):
    source.sendall(b'{"t": 3.5, "id": "x1", "unit": "km", "points": [[1,2,3]]}\n')
    reply = reader.until("id", "x1")[-1]
    assert reply["t"] == 3.5
    assert "km" in reply["rejected"]


def test_frames_out_of_order_or_repeated_are_rejected(source, reader):
    for time, name in ((5.0, "first"), (5.0, "again"), (4.0, "back"), (5.1, "next")):
        source.sendall(frame(time, id=name))
        reply = reader.until("id", name)[-1]
        assert ("rejected" in reply) == (name in ("again", "back"))


def test_the_time_of_a_rejected_frame_does_not_count(source, reader):
    source.sendall(frame(0.1, id="before"))
    before = reader.until("id", "before")[-1]
    replies = []
    for name, count, tension in (("two points", 2, 5.0), ("pushed", 30, -7.0)):
        source.sendall(frame(1e9, count, tension_in_N=tension, id=name))
        replies += reader.until("id", name)
        assert "rejected" in replies[-1]
    stale = next((one for one in replies if "silent_s" in one), None) or reader.next()
    assert (stale["t"], stale["seq"]) == (0.1, before["seq"])
    for time, name in ((0.2, "after"), (0.15, "back")):
        source.sendall(frame(time, id=name))
        reply = reader.until("id", name)[-1]
        assert ("rejected" in reply) == (name == "back")


def test_a_sender_that_connects_anew_has_a_clock_of_its_own(stream, source, reader):
    source.sendall(frame(1000.0, id="old"))
    reader.until("id", "old")
    with stream.source() as other:
        other.sendall(frame(1.0, id="new"))
        assert "rejected" not in reader.until("id", "new")[-1]


def test_a_last_line_without_its_end_is_answered(stream, reader):
    with stream.source() as other:
        other.sendall(frame(1.0, id="whole") + frame(2.0, id="last").rstrip())
    assert "segments" in reader.until("id", "last")[-1]
    with stream.source() as other:
        other.sendall(b'{"t": 3.0, "unit": "mm"')
    reply = reader.answer()
    assert "write one JSON object a line" in reply["rejected"]


def test_the_number_of_points_may_change_with_each_frame(source, reader):
    for i, n in enumerate((30, 200, 12, 80, 7, 500)):
        source.sendall(frame(float(i), n, id=f"n{n}"))
        assert "rejected" not in reader.until("id", f"n{n}")[-1]


def test_of_frames_that_come_at_once_the_newest_is_answered_and_the_others_are_counted(source, reader):
    source.sendall(frame(0.0, id="start"))
    start = reader.until("id", "start")[-1]
    burst = b"".join(frame(1.0 + i, id=f"b{i}") for i in range(200))
    source.sendall(burst)
    replies = reader.until("id", "b199")
    answered = [one for one in replies if "segments" in one]
    assert replies[-1]["seq"] == start["seq"] + 200
    assert len(answered) + replies[-1]["dropped"] - start["dropped"] == 200
    assert replies[-1]["dropped"] > start["dropped"]


def test_silence_gets_one_line_until_frames_return(source, reader):
    source.sendall(frame(0.0, id="last"))
    last = reader.until("id", "last")[-1]
    stale = reader.next()
    assert stale["stale"] is True
    assert (stale["t"], stale["seq"]) == (last["t"], last["seq"])
    assert stale["silent_s"] >= 0.2
    reader.sock.settimeout(0.6)  # three times the silence before a stale line
    with pytest.raises(TimeoutError):
        reader.next()
    reader.sock.settimeout(60.0)
    source.sendall(frame(1.0, id="back"))
    assert reader.until("id", "back")[-1]["stale"] is False


def test_frames_that_cannot_be_fitted_do_not_hide_the_silence_of_good_ones(source, reader):
    source.sendall(frame(0.0, id="good"))
    good = reader.until("id", "good")[-1]
    for i in range(1, 9):
        source.sendall(line([[1.0, 1.0, 1.0]] * 5, float(i), id=f"bad {i}"))
        sleep(0.05)
    stale = [reply for reply in reader.until("id", "bad 8") if reply.get("stale")]
    assert [(reply["t"], reply["seq"]) for reply in stale] == [(good["t"], good["seq"])]


def test_a_long_text_of_a_bad_frame_is_cut_short(source, reader):
    source.sendall(b'{"t":1,"unit":"%s","points":[[0,0,0]],"id":"%s"}\n' % (b"k" * 90_000, b"i" * 90_000))
    reply = reader.answer()
    assert len(reply["rejected"]) < 1000
    assert len(reply.get("id", "")) < 1000


def test_datagrams_are_frames_and_answers_are_datagrams(shared):
    with shared.stream.source("udp") as sock:
        reply = {}
        time = 0.0
        while reply.get("id") != "by udp" or "rejected" in reply:
            time += 1.0
            sock.send(frame(time, id="by udp"))
            reply = json.loads(shared.datagrams.recv(1 << 16))
    assert reply["total_angle_rad"] > 0
