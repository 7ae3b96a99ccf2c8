"""The pipeline that the stages are timed against: scipy's splprep, curvature by numpy, pieces by ruptures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import cycle

import numpy as np
import ruptures
from scipy.interpolate import splev, splprep

from benchmarks.stages import NOISE, Stage
from tssgeom.arrays import Points, Vector
from tssgeom.stream import Frame

_CURVATURE_NOISE = 1.0  # what ruptures shall take for noise [1/m]
_PER_PIECE = 3.0  # times ln N, as in the criterion of this project


def _curvature(frame: Frame) -> Vector:
    """Curvature at the stations [1/m], from the quintic with the residual that the noise leaves."""
    points: Points = frame.points
    tck, u = splprep(points.T, u=frame.stations, k=5, s=points.size * NOISE**2)
    first, second = (np.array(splev(u, tck, order)).T for order in (1, 2))
    return np.linalg.norm(np.cross(first, second), axis=1) / np.linalg.norm(first, axis=1) ** 3


def _penalty(n: int) -> float:
    return _PER_PIECE * np.log(n) * _CURVATURE_NOISE**2


def pelt(frame: Frame) -> Sequence[int]:
    """Cut the route where the curvature changes, by PELT with the l2 cost (Python)."""
    kappa = _curvature(frame)
    return ruptures.Pelt(model="l2").fit(kappa).predict(_penalty(len(kappa)))


def kernel(frame: Frame) -> Sequence[int]:
    """Cut the route where the curvature changes, by KernelCPD with the linear kernel (C)."""
    kappa = _curvature(frame)[:, None]
    return ruptures.KernelCPD(kernel="linear").fit(kappa).predict(pen=_penalty(len(kappa))) or []


def _calls(
    pipeline: Callable[[Frame], Sequence[int]],
) -> Callable[[Sequence[Frame]], Iterator[Callable[[], object]]]:
    return lambda seen: cycle([partial(pipeline, frame) for frame in seen])


PIPELINES = (
    Stage("scipy + ruptures PELT", _calls(pelt)),
    Stage("scipy + ruptures kernel", _calls(kernel)),
)
"""The same, with the usual and with the fastest search of ruptures."""
