"""A smooth route through noisy points, with the covariance of everything that follows from it."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace
from functools import partial

from tssgeom import core
from tssgeom.core.constants import CHANCE
from tssgeom.route.observations import Shape
from tssgeom.route.spline.cells import (
    CELLS,
    clustered,
    correlation_of_innovations,
    merged,
    on_all_points,
    raw_angle,
)
from tssgeom.route.spline.posterior import PARAMETERS, posterior_in_steps
from tssgeom.route.spline.spline import Spline, joints_of, spline_of
from tssgeom.route.spline.warm import warm
from tssgeom.route.steps import at_once


def fit(shape: Shape, noise: float | None = None, last: Spline | None = None) -> Spline:
    """Fit a smooth route.

    Parameters
    ----------
    shape
        Validated points.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.
    last
        Fit of the same route a moment ago, as in a stream: where it still holds, one pass that begins with
        it is enough.

    Returns
    -------
    Spline
        The route as position, tangent and curvature at knots [m, 1, 1/m], with covariances.

    Raises
    ------
    FitError
        Where the points give no finite curve.

    Notes
    -----
    Source: docs/model.md (20) to (22).

    Examples
    --------
    >>> from tssgeom import clean, fit
    >>> import numpy as np
    >>> angle = np.linspace(0.0, np.pi, 40)  # a half circle of 0.5 m
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> round(float(fit(clean(points), noise=1e-4).route.s[-1]), 4)  # [m]
    0.5
    """
    return at_once(fit_in_steps(shape, noise, last))


def fit_in_steps(
    shape: Shape, noise: float | None, last: Spline | None = None
) -> Generator[float, None, Spline]:
    """Do as `fit`, with a stop after each pass."""
    if last is not None and last.shared_angle_error == 0.0:
        moved = warm(shape, noise, last)
        if moved is not None:
            return moved
        yield PARAMETERS * len(shape.points)
    spline, correlation = yield from _fit_white(shape, noise)
    alone = noise is None and shape.stations is None and shape.directions is None
    if alone and clustered(shape.points, spline.route.noise) and correlation() < -CHANCE.rare:
        return _fit_cells(shape, spline)
    return spline


def _fit_white(
    shape: Shape, noise: float | None
) -> Generator[float, None, tuple[Spline, Callable[[], float]]]:
    """Fit a route as if all errors were white; returns also a function that fits their correlation."""
    spacing = _mean_spacing(shape)
    problem, solution = yield from posterior_in_steps(shape, spacing, noise)
    return spline_of(shape, problem, solution, spacing), partial(
        correlation_of_innovations, problem, solution
    )


def _mean_spacing(shape: Shape) -> float:
    if shape.stations is not None:
        return float(shape.stations[-1]) / (len(shape.stations) - 1)
    return core.mean_spacing(shape.points)


def _fit_cells(shape: Shape, spline: Spline) -> Spline:
    """Merge points that share their errors into cells, the smallest tried that leave white errors; (28).

    The angle still depends on the size of the cells: half of what changes between cells of half and of double
    the area is taken as its standard error.
    """
    cell = CELLS.growth**3 * float(spline.route.s[-1]) / len(shape.points)
    while True:
        coarse, cell_of = merged(shape, cell)
        if len(coarse.points) < CELLS.fewest_cells:
            return spline
        fitted, correlation = at_once(_fit_white(coarse, None))
        if correlation() >= -CHANCE.rare:
            break
        cell *= CELLS.growth
    finer, coarser = (_angle_in_cells(shape, cell * x) for x in (0.5**0.5, 2**0.5))
    error = 0.5 * abs(finer - coarser) / raw_angle(fitted.route)
    warning = f"neighbouring points share their errors: merged into cells of {cell * 1e3:.3g} mm"
    return replace(
        fitted,
        route=on_all_points(shape, fitted.route, cell_of),
        joints=joints_of(fitted.route, fitted.covariance, fitted.freedom, len(shape.points)),
        shared_angle_error=error,
        warnings=(warning,),
    )


def _angle_in_cells(shape: Shape, cell: float) -> float:
    return raw_angle(at_once(_fit_white(merged(shape, cell)[0], None))[0].route)
