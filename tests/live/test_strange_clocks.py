"""Frames whose time or drive makes no sense: they change nothing for others, and each is in the warnings."""

import json
from pathlib import Path
from time import sleep

import numpy as np
import pytest

from tests.live.peers import half_circle
from tests.live_process import PATIENCE, line, live, points_mm
from tssgeom.engine import Engine
from tssgeom.io.formats.states import read_state, write_state
from tssgeom.rig import Rig, read_rig
from tssgeom.stream import Frame

PULL = 9.0  # N
TCP = ("--source", "tcp://127.0.0.1:0", "--sink", "tcp://127.0.0.1:0")


def stated(time: float, **more: object) -> bytes:
    """Return a frame of exact points, whose noise is stated: else they are as if smoothed."""
    return line(half_circle(), time, noise_m=1e-5, **more)


@pytest.fixture
def creeping(tmp_path: Path) -> Path:
    rig = tmp_path / "rig.toml"
    rig.write_text('[[effects]]\nname = "creep"\nratio = 0.1\ntime_s = 10\n')
    return rig


def piped(frames: list[bytes], *arguments: str | Path) -> list[dict]:
    """Answers of a stream to frames on its standard input."""
    with live("--sink", "-", *arguments) as stream:
        stream.input.write(b"".join(frames))
        stream.input.close()
        answers = [json.loads(text) for text in stream.output.read().splitlines()]
        assert stream.process.wait(PATIENCE) == 0
    return [one for one in answers if not one.get("stale")]


def test_a_new_connection_and_turns_of_two_senders_are_no_pause_of_one():
    step = 1e-3  # s
    with live(*TCP) as stream, stream.source() as first:
        reader = stream.reader()

        def sent(source, begin: float, name: str, count: int = 40) -> None:
            for i in range(count):
                source.sendall(stated(begin + step * i, id=f"{name} {i}"))
                assert "warnings" not in reader.until("id", f"{name} {i}")[-1]

        sent(first, 0.0, "first")
        with stream.source() as other:
            sleep(0.5)  # of the clock here; by the clocks of both senders there is none
            sent(other, 700.0, "other")
        sent(first, 40 * step, "first again", 1)
        first.close()
        sleep(0.5)
        with stream.source() as third:
            sent(third, 0.0, "third")
        reader.sock.close()


def test_the_filter_in_time_of_a_sender_goes_by_its_own_clock():
    def angles(step: float | None) -> list[float]:
        """Φ of a noisy route that sways [rad], beside a sender whose clock makes such steps [s]."""
        answered = list[float]()
        with live(*TCP) as stream, stream.source() as source, stream.source() as other:
            reader = stream.reader()
            for i in range(12):
                source.sendall(line(points_mm(40, 0.01 * i, i), 0.01 * i, id=i))
                answered.append(reader.until("id", i)[-1]["total_angle_rad"])
                if step is not None:
                    other.sendall(stated(step * i, id=f"other {i}"))
                    reader.until("id", f"other {i}")
            reader.sock.close()
        return answered

    assert angles(1.0) == angles(None)


@pytest.mark.parametrize("strange", [1.7e18, 1e13, 1e300])
def test_a_frame_of_another_client_far_in_the_future_changes_no_answer_to_the_first(
    tmp_path, creeping, strange
):
    state = tmp_path / "tendon.json"
    with live(*TCP, "--rig", creeping, "--state", state) as stream, stream.source() as source:
        reader = stream.reader()
        tensions = []
        for i in range(8):
            if i == 4:
                with stream.source() as other:
                    other.sendall(stated(strange, tension_in_N=PULL, id="other"))
                    answer = reader.until("id", "other")[-1]
                    assert answer["t"] == strange
                    assert "send seconds of one clock" in answer["warnings"][0]
            source.sendall(stated(10 + 0.1 * i, tension_in_N=PULL, id=i))
            answer = reader.until("id", i)[-1]
            assert "warnings" not in answer
            tensions.append(answer["tension_out_N"])
        assert np.ptp(tensions) < 0.1  # a leap lets it creep by 1.2 N
        reader.sock.close()
        assert stream.stop() == 0
    with live("--rig", creeping, "--state", state) as again:
        again.input.close()
        assert again.process.wait(PATIENCE) == 0


@pytest.mark.parametrize("at", [0, 3])
def test_a_sender_whose_clock_is_wrong_in_one_frame_is_answered_after_it(creeping, at):
    times = [10.0 + 0.1 * i for i in range(8)]
    usual = piped([stated(one, tension_in_N=PULL) for one in times], "--rig", creeping)
    times[at] = 1.7e18
    times.append(10.0)  # of an earlier frame
    *answers, again = piped([stated(one, tension_in_N=PULL) for one in times], "--rig", creeping)
    assert ["warnings" in one for one in answers] == [i == at for i in range(8)]
    assert "comes after 10.7 s" in again["rejected"]
    tensions = [one["tension_out_N"] for one in answers]
    assert tensions == pytest.approx([one["tension_out_N"] for one in usual], abs=0.1)  # N; a leap: 1.2 N


@pytest.mark.parametrize("start", [1.7e18, 1e13])
def test_a_clock_that_begins_or_leaps_far_in_the_future_leaves_a_state_that_is_read(
    tmp_path, creeping, start
):
    state, ends = tmp_path / "tendon.json", ("--rig", creeping, "--state", tmp_path / "tendon.json")
    frames = [stated(start + k * 1e9, tension_in_N=PULL) for k in (0, 1)]
    first, leaps = piped(frames, *ends)
    assert "begins at 0 s" in first["warnings"][0]
    assert "later than the last frame: it counts as" in leaps["warnings"][0]
    assert 0.0 < read_state(state).time <= 60.0
    (answer,) = piped([stated(1.0, tension_in_N=PULL)], *ends)
    assert answer["tension_out_N"] > 0.0


@pytest.mark.parametrize("temperature", [None, 1e15])
def test_a_state_of_any_time_is_read_as_it_was_written(tmp_path, creeping, temperature):
    points = 1e-3 * half_circle()
    for rig in (Rig(), read_rig(creeping)):
        engine = Engine(rig, tension_in=PULL)
        for time in (0.0, 1e13, 1.7e18):
            engine.push(Frame(points, time, tension_in=PULL, temperature=temperature))
        write_state(tmp_path / "tendon.json", engine.state)
        assert read_state(tmp_path / "tendon.json").time == engine.state.time == 1.7e18


@pytest.mark.parametrize("follows", [(), ("--adapt",)])
def test_a_position_of_the_drive_that_makes_no_sense_is_rejected(follows):
    moves = (2e-3, 1000.0, 2e-3)  # m
    frames = [json.loads(stated(0.1 * i)) for i in range(len(moves))]
    for one, position in zip(frames, moves, strict=True):
        del one["tension_in_N"]
        one["displacement_in_m"] = position
    answers = piped([json.dumps(one).encode() + b"\n" for one in frames], *follows)
    named = ["displacement_in_m is 1000 m" in one.get("rejected", "") for one in answers]
    assert named == [False, True, False]
