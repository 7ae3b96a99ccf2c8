"""The statistics of a stream, as one object and as one line on a terminal."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.live.processes import TokenBucket
from pipelines.live.status import Statistics, status_text
from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult

TURN = np.linspace(0.0, np.pi, 40)
POINTS = 0.1 * np.column_stack((np.sin(TURN), 1 - np.cos(TURN), 0 * TURN))


@pytest.fixture(scope="module")
def result() -> FrameResult:
    (result,) = process([Frame(POINTS, 2.0, tension_in=10.0)], Rig(), tension_in=10.0)
    assert isinstance(result, FrameResult)
    return result


def test_latencies_are_those_since_the_last_time_and_counts_those_since_the_start(result):
    statistics = Statistics()
    for latency in (100.0, 200.0, 300.0):
        statistics.add(result, latency)
    first = statistics.over_interval({"dropped": 4})
    assert (first["latency_p50_us"], first["answered"], first["dropped"]) == (200.0, 3, 4)
    second = statistics.over_interval({"dropped": 4})
    assert (second["latency_p50_us"], second["rate_hz"], second["answered"]) == (None, 0.0, 3)


def test_the_status_line_fits_a_terminal_and_has_all_numbers(result):
    statistics = Statistics()
    statistics.add(result, 450.0)
    report = statistics.over_interval({"dropped": 1})
    line = status_text(report).plain
    assert len(line) <= 80
    for part in ("Hz", "0.45/0.45 ms", "dropped 1", "rejected 0", "Φ 180.0°", "T_out 6.34 N", "δ "):
        assert part in line
    assert "stale" in status_text(report | {"stale": True}).plain


def test_a_frame_without_a_drive_is_noted(result):
    statistics = Statistics()
    statistics.add(result, 450.0)
    assert not statistics.undriven
    statistics.add(replace(result, frame=replace(result.frame, tension_in=None)), 450.0)
    statistics.add(result, 450.0)
    assert statistics.undriven


def test_pictures_are_allowed_all_at_first_and_then_at_their_rate():
    bucket = TokenBucket(rate=8.0, burst=5.0)
    now = bucket._since
    assert [bucket.take(now) for _ in range(7)] == [True] * 5 + [False] * 2
    assert [bucket.take(now + k / 16) for k in range(1, 9)].count(True) == 4
