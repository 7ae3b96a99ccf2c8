"""The route of a fibre from frame to frame: its curvatures are filtered in time, their noise goes on."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.route.fibre.models import stretches
from tssgeom.route.fibre.noise import LastNoise
from tssgeom.route.fibre.sensed import clean_fibre, fit_fibre, sensed_shape
from tssgeom.route.noise import noise_left
from tssgeom.route.observations import Shape
from tssgeom.route.time_filter import PointFilter, begun, filtered
from tssgeom.route.tracking import TrackedFit, noise_growth


class FibreReading(NamedTuple):
    """What a fibre sensed in a frame."""

    curvatures: Matrix
    """Components κ_x, κ_y, NaN where a grating was not read [n, 2] [1/m]."""
    stations: Vector | None
    """Arc length of each grating [n] [m]."""
    time: float
    """Time of the frame [s]."""
    noise: float | None
    """Stated standard deviation of a component [1/m]."""


def follow_fibre(
    reading: FibreReading,
    last: TrackedFit | None = None,
    now: PointFilter | None = None,
    *,
    time_filter: bool = True,
) -> tuple[Shape, TrackedFit]:
    """Return gratings and fitted route of a fibre, from those of the last frame on; docs/model.md (242).

    Parameters
    ----------
    reading
        What was sensed.
    last
        Result of the last frame.
    now
        Curvatures that are filtered in time already, as those of a recording.
    time_filter
        Whether to filter them by the frames before, where `now` is not given.

    Raises
    ------
    ShapeError
        Where the curvatures cannot be those of a route.
    FitError
        Where they give no finite route, or do not determine Φ.
    """
    stated, start = reading.noise, None if last is None else last.fibre_noise
    before = None if last is None or not _same_gratings(reading, last) else last.filtered
    if now is None and time_filter and before is not None and start is not None:
        now = filtered(before, reading.curvatures, start.noise, reading.time)
    fibre = clean_fibre(reading.curvatures if now is None else now.points[:, :2], reading.stations)
    known = None if last is not None and last.noise_contradicted else stated
    if now is not None:
        known = noise_left(now, known)
    fitted = fit_fibre(fibre, known, last=_carried(start, before, now))
    share = 1.0 if now is None else now.sensed_noise / now.noise
    if now is None and time_filter:
        cell = None if reading.stations is None else stretches(reading.stations)
        now = begun(reading.curvatures, known or fitted.curvature_noise, reading.time, cell)
    estimated, fit = fitted.curvature_noise_se > 0.0, fitted.fit
    if now is not None and now.turning is not None:
        more = max(now.turning.noise**2 - now.noise**2, 0.0)
        fit = fit.with_angle_variance(now.turning.size**2 * more)
    tracked = TrackedFit(
        fit,
        fibre.index,
        filtered=now,
        sensed_over_fitted=share,
        noise_contradicted=stated is not None and estimated and fitted.curvature_noise * share > stated,
        fibre_noise=fitted.start,
    )
    shape = sensed_shape(fibre, fit)
    return shape if now is None else replace(shape, warnings=shape.warnings + now.warnings), tracked


def _same_gratings(reading: FibreReading, last: TrackedFit) -> bool:
    """Whether the gratings of the last frame are where they were."""
    if reading.stations is None or last.index[-1] >= len(reading.stations):
        return False
    s = np.asarray(reading.stations, dtype=np.float64)
    return np.array_equal(s[last.index.astype(np.int64)] - s[0], last.fit.route.station)


def _carried(
    start: LastNoise | None, before: PointFilter | None, now: PointFilter | None
) -> LastNoise | None:
    """Return the noise that the fit is expected to find; docs/model.md (255)."""
    if start is None:
        return None
    return start._replace(noise=start.noise * noise_growth(start.noise, before, now))
