"""A short day of a stream, and what its measure says of a stream that does grow."""

import subprocess
import sys
import time

import numpy as np
import pytest

from tests import live_process
from tests.attack import day as a_day
from tests.attack.day import DAY, RATE, Trend, judged, lived, trend
from tests.live_process import PATIENCE, line, live, points_mm

_GROWING = (
    "from pipelines.live.session import Session; kept = []; answer = Session._answer; "
    "Session._answer = lambda *all: (answer(*all), kept.append((bytearray(1 << 18), open('/dev/null')))); "
)
"""A stream that keeps 256 KiB and a file of each frame."""


@pytest.mark.parametrize("more", [(), ("--adapt",)])
def test_a_short_day_has_no_fault(more):
    command = [sys.executable, "-m", "tests.attack.day", "--seconds", "10", *more]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "\n0 faults" in done.stdout


def test_a_stream_that_grows_is_detected(tmp_path, monkeypatch):
    monkeypatch.setattr(live_process, "START", [*live_process.START])
    live_process.START[2] = _GROWING + live_process.START[2]
    day, _ = lived(3.0, tmp_path)
    first, last = day.samples[0], day.samples[-1]
    assert last["open files"] - first["open files"] > 0.9 * (last["frames"] - first["frames"]) - 50  # clients
    assert last["memory"] - first["memory"] > 0.2 * (last["frames"] - first["frames"])
    assert {("memory", "grows"), ("open files", "grows")} <= set(judged(day, least=0))


def test_a_day_of_a_slower_sensor_ends_after_as_many_frames_as_it_has(tmp_path, monkeypatch):
    monkeypatch.setattr(a_day, "DAY", 3.0)
    day, faults = lived(PATIENCE, tmp_path, rate=30.0)
    assert (day.frames, day.hours, faults) == (90, pytest.approx(3.0 / 3600.0), [])


def test_clients_that_have_gone_leave_nothing(tmp_path, monkeypatch):
    counted = tmp_path / "counted"
    counting = (
        "import gc; from pathlib import Path; from pipelines.live.session import Session; "
        "house = Session._keep_house; left = lambda: [type(one).__name__ for one in gc.get_objects()]; "
        f"write = lambda: Path({str(counted)!r}).write_text(str(left().count('Peer')) + ' '); "
        "Session._keep_house = lambda self: (house(self), write()); "
    )
    monkeypatch.setattr(live_process, "START", [*live_process.START])
    live_process.START[2] = counting + live_process.START[2]

    def comes_to(number: int) -> bool:
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            if counted.exists() and counted.read_text().split() == [str(number)]:
                return True
            time.sleep(0.1)
        return False

    with live("--source", "tcp://127.0.0.1:0", "--sink", "none") as stream:
        clients = [stream.source() for _ in range(10)]
        for client in clients:
            client.sendall(line(points_mm(12, 0.0), 1.0))
        assert comes_to(10)
        time.sleep(2.5)  # they outlive two rounds of the collection of what is no longer used
        for client in clients:
            client.close()
        assert comes_to(0)


def test_the_slope_is_that_of_what_grows_and_its_error_that_of_noise_that_lasts():
    rng, frames = np.random.default_rng(4), np.arange(0.0, 1e6, 1e3)
    slopes = list[float]()
    errors = list[float]()
    for _ in range(200):
        lasting = np.repeat(rng.standard_normal(100), 10)  # ten samples in a row err alike
        made = trend(frames.tolist(), (5.0 * frames / 1e6 + lasting).tolist())
        slopes.append(made.slope)
        errors.append(made.error)
    assert np.mean(slopes) == pytest.approx(5.0, abs=0.2)  # four standard errors of 200 trials
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.std(slopes), rel=0.25)


def test_what_comes_before_the_stream_is_warm_counts_for_nothing():
    frames = np.arange(0.0, 1e6, 1e4)
    assert trend(frames.tolist(), np.minimum(frames, 4e5).tolist()).slope == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("slope", "error", "verdict"), [(2.0, 0.1, "grows"), (0.5, 0.1, "flat"), (1.0, 0.3, "open")]
)
def test_what_the_samples_do_not_decide_stays_open(slope, error, verdict):
    assert Trend(slope, error).verdict(1e-6 * DAY * RATE) == verdict
    assert Trend(slope, error).verdict(1e-6 * DAY * 30.0, rate=30.0) == verdict


def test_too_few_samples_decide_nothing():
    assert trend(list(range(1000)), list(range(1000))).verdict(1.0) == "open"
