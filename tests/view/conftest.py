"""Results of a real analysis: a static bend with an outlier, and a growing route under a changing tension."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult
from tssgeom.view.scene.recording import write_recording

NOISE = 1e-4


@pytest.fixture(autouse=True)
def _strict_rerun() -> Iterator[None]:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def arc(count: int, angle: float = math.pi, radius: float = 0.1) -> np.ndarray:
    """Noisy points on an arc in a tilted plane [m]."""
    turn = np.linspace(0.0, angle, count)
    flat = radius * np.column_stack([np.sin(turn), 1 - np.cos(turn), 0.2 * turn])
    return flat + np.random.default_rng(count).normal(0.0, NOISE, flat.shape)


def analysed(frames: list[Frame]) -> list[FrameResult]:
    results = list(process(frames, Rig(), tension_in=15.0))
    assert all(isinstance(result, FrameResult) for result in results)
    return [result for result in results if isinstance(result, FrameResult)]


@pytest.fixture(scope="session")
def still() -> list[FrameResult]:
    points = arc(60)
    points[30] += [0.0, 0.0, 0.01]
    return analysed([Frame(points)])


@pytest.fixture(scope="session")
def moving() -> list[FrameResult]:
    """Seven frames of 30 to 60 points; the tension rises to 12 N and falls again."""
    tensions = (2.0, 6.0, 10.0, 12.0, 9.0, 5.0, 1.0)
    frames = [
        Frame(arc(30 + 5 * number, 1.0 + 0.4 * number), 0.25 * number, tension_in=tension)
        for number, tension in enumerate(tensions)
    ]
    return analysed(frames)


@pytest.fixture(scope="session")
def still_file(still: list[FrameResult], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("still") / "still.rrd"
    write_recording(path, "still", still, timed=False)
    return path


@pytest.fixture(scope="session")
def moving_file(moving: list[FrameResult], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("moving") / "moving.rrd"
    write_recording(path, "moving", moving, timed=True)
    return path
