"""A fit that takes long delays neither other senders nor the end, and each sender has fits of its own."""

import json
import os
import signal
import time
from dataclasses import replace
from threading import Event, Thread

import numpy as np
import pytest

from tests.attack.live_lines import helix
from tests.live.peers import frame
from tests.live_process import PATIENCE, START, line, live, points_mm, retimed
from tssgeom.engine import Engine, Track, process
from tssgeom.rig import Rig
from tssgeom.route.route_fit import Deferred
from tssgeom.sensed_route import SensedRoute
from tssgeom.stream import Frame, FrameResult, Rejected

LONG = line(helix(10_000, 200.0), 2.0, id="long")  # about 2 s
TCP = ("--source", "tcp://127.0.0.1:0")


def shared(seconds: float) -> float:
    """The time that something takes which would take so many seconds, were the cores ours alone."""
    return seconds * max(os.getloadavg()[0], 1.0)


def test_a_fit_that_takes_long_is_late_and_others_are_answered_meanwhile():
    with (
        live(*TCP, "--sink", "-", "--deadline-ms", "20") as stream,
        stream.source() as slow,
        stream.source() as other,
    ):
        other.sendall(frame(0.0, id="first"))
        while (json.loads(stream.output.readline())).get("id") != "first":
            pass
        slow.sendall(LONG)
        lines = [json.loads(stream.output.readline())]
        other.sendall(frame(0.1, id="second"))
        while lines[-1].get("id") != "long":
            lines.append(json.loads(stream.output.readline()))
        assert stream.stop() == 0
    late = next(one for one in lines if "late" in one)
    assert (late["t"], late["seq"], late["late"], late["stale"]) == (0.0, 0, 1, True)
    assert 0.02 <= late["silent_s"] < shared(0.5)
    assert "second" in [one.get("id") for one in lines[:-1]]
    assert lines[-1]["seq"] == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_is_heard_while_a_fit_takes_long(number):
    with live(*TCP, "--sink", "none") as stream, stream.source() as slow:
        slow.sendall(LONG)
        time.sleep(0.3)
        begun = time.monotonic()
        assert stream.stop(number) == 0
        assert time.monotonic() - begun < shared(0.5)


def test_a_stream_ends_without_python_ending_the_thread_of_a_fit_within_c(monkeypatch):
    begin = "import atexit, os; atexit.register(os.write, 2, b'finalised\\n'); "
    python, option, program, *command = START
    monkeypatch.setattr("tests.live_process.START", [python, option, begin + program, *command])
    with live(*TCP, "--sink", "none") as stream, stream.source() as source:
        source.sendall(LONG)
        time.sleep(0.3)
        assert stream.stop(signal.SIGINT) == 0
    assert "finalised" not in stream.errors


def test_frames_of_standard_input_wait_for_long_fits_and_none_is_lost():
    walk = np.cumsum(5.0 * np.random.default_rng(0).standard_normal((1000, 3)), axis=0)
    with live() as stream:
        for i in range(6):
            stream.input.write(line(walk if i % 2 else points_mm(40, 0.0), float(i)))
        stream.input.close()
        lines = [json.loads(text) for text in stream.output.read().splitlines()]
        assert stream.process.wait(PATIENCE) == 0
    answers = [one for one in lines if not one.get("stale")]
    assert [one["seq"] for one in answers] == list(range(6))
    assert answers[-1]["dropped"] == 0


def _frames(seed: int) -> list[Frame]:
    return [Frame(1e-3 * points_mm(40, 0.02 * k, seed + k), 0.02 * k, tension_in=9.0) for k in range(40)]


def test_senders_that_take_turns_have_the_fits_that_each_has_alone():
    rest = [Frame(1.3 * one.points[:, ::-1], one.time + 0.01, tension_in=9.0) for one in _frames(500)]
    streams, tracks = (_frames(0), rest), (Track(), Track())
    alone = [list(process(frames, Rig(), tension_in=9.0)) for frames in streams]
    engine = Engine(Rig(), tension_in=9.0)
    for k in range(40):
        for frames, track, wanted in zip(streams, tracks, alone, strict=True):
            result, expected = engine.push(frames[k], track=track), wanted[k]
            engine.idle(track)
            assert isinstance(result, FrameResult)
            assert isinstance(expected, FrameResult)
            assert result.arcs.total_angle == expected.arcs.total_angle
            assert result.tracked.sensed_over_fitted == expected.tracked.sensed_over_fitted


def test_a_route_that_was_sensed_before_gives_the_same_result():
    frames, engine, track = _frames(0), Engine(Rig(), tension_in=9.0), Track()
    wanted = process(frames, Rig(), tension_in=9.0)
    for one, expected in zip(frames, wanted, strict=True):
        sensed = engine.sense(one, track)
        assert isinstance(sensed, SensedRoute)
        result = engine.push(one, track=track, sensed=sensed)
        assert isinstance(result, FrameResult)
        assert isinstance(expected, FrameResult)
        assert result.transmission == expected.transmission
    assert isinstance(engine.sense(Frame(np.zeros((2, 3))), track), Rejected)


@pytest.mark.parametrize("hard", ["helix", "walk"])
def test_a_frame_that_shows_nothing_leaves_the_next_one_as_it_is_alone(hard):
    walk = np.cumsum(5.0 * np.random.default_rng(0).standard_normal((1000, 3)), axis=0)
    points = {"helix": helix(200, 10.0), "walk": walk}[hard]
    good = Frame(1e-3 * points_mm(len(points), 0.0), 0.1)
    alone, after = Engine(Rig(), tension_in=9.0), Engine(Rig(), tension_in=9.0)
    nothing, wanted = after.push(Frame(1e-3 * points, 0.0)), alone.push(good)
    assert isinstance(nothing, FrameResult)
    assert nothing.arcs.total_angle_se > 2.0 * np.pi
    for _ in range(3):
        result = after.push(good)
        assert isinstance(result, FrameResult)
        assert isinstance(wanted, FrameResult)
        assert result.arcs.total_angle == wanted.arcs.total_angle
        assert result.arcs.total_angle_se == wanted.arcs.total_angle_se
        good, wanted = replace(good, time=good.time + 0.1), alone.push(replace(good, time=good.time + 0.1))


def test_a_fit_that_goes_on_is_made_at_once_and_one_from_nothing_is_left_to_the_caller():
    frames, engine, track = _frames(0), Engine(Rig(), tension_in=9.0), Track()
    assert engine.sense_warm(frames[0], track) is None
    wanted = process(frames, Rig(), tension_in=9.0)
    for one, expected in zip(frames, wanted, strict=True):
        sensed = engine.sense_warm(one, track) or engine.sense(one, track)
        assert isinstance(sensed, SensedRoute)
        result = engine.push(one, track=track, sensed=sensed)
        engine.idle(track)
        assert isinstance(result, FrameResult)
        assert isinstance(expected, FrameResult)
        assert result.transmission == expected.transmission
    walk = np.cumsum(5e-3 * np.random.default_rng(0).standard_normal((40, 3)), axis=0)
    assert engine.sense_warm(Frame(walk, 0.9), track) is None
    assert isinstance(engine.sense(Frame(walk, 0.9), track), SensedRoute | Rejected)


def test_the_second_frame_of_a_sender_with_long_fits_is_not_made_by_the_stream_itself():
    with (
        live(*TCP, "--sink", "tcp://127.0.0.1:0") as stream,
        stream.source() as slow,
        stream.source() as other,
    ):
        reader, sent, silent = stream.reader(), dict[str, float](), 0.0
        for k in range(150):
            if k in (10, 20, 30):
                slow.sendall(retimed(LONG, 2.0 + k))
            sent[f"good {k}"] = time.monotonic()
            other.sendall(frame(0.02 * k, id=f"good {k}"))
            reader.until("id", f"good {k}")
            silent = max(silent, time.monotonic() - sent[f"good {k}"]) if k > 1 else 0.0
            time.sleep(0.02)
        reader.sock.close()
        assert silent < shared(0.25)


def test_threads_that_compute_different_values_do_not_wait_for_each_other():
    begun, may_end = Event(), Event()

    def slow():
        begun.set()
        return may_end.wait(PATIENCE)

    one = Deferred(slow)
    thread = Thread(target=lambda: one.value)
    thread.start()
    begun.wait(PATIENCE)
    assert Deferred(lambda: 3).value == 3
    may_end.set()
    thread.join()
    assert one.value is True


@pytest.mark.parametrize("turns", [1, 2, 4])
def test_a_smooth_route_of_another_kind_leaves_no_interval_to_the_frames_after_it(turns):
    """Frames after a helix without noise went on from its spline: Φ ± 0.13 rad, where it is ± 0.002."""
    engine, errors = Engine(Rig(), tension_in=9.0), dict[int, float]()
    for k in range(8):
        points = helix(60, turns) if k == 3 else points_mm(60, 0.0, k, noise=5e-5)
        result = engine.push(Frame(1e-3 * points, 0.02 * k, tension_in=9.0))
        engine.idle()
        assert isinstance(result, FrameResult)
        errors[k] = result.arcs.total_angle_se
    assert max(errors[k] for k in range(4, 8)) < 1.2 * errors[0]
