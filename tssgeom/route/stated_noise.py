"""Noise that is stated of points, which contradict it; docs/model.md (223)."""

from __future__ import annotations

from typing import NamedTuple

from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.route.geometry import measure
from tssgeom.route.observations import Shape, are_few
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.spline.fit import fit


class StatedNoise(NamedTuple):
    """When readings decide about their noise, not who states it."""

    far_less: float = 1.5
    """Noise that points, or the readings of a channel, have over the stated one, from which it is
    contradicted [1]; chosen: what is nearer changes a bar by less than a half."""


STATED = StatedNoise()


def contradicted(shape: Shape, stated: float, alone: RouteFit | None) -> RouteFit | None:
    """Return the fit by the noise of the points themselves, where they contradict a stated one; else None.

    Parameters
    ----------
    shape
        Validated points; few of them contradict nothing, since a curve with more bends explains as much.
    stated
        Standard deviation of each coordinate that is stated [m].
    alone
        Fit by the stated noise; None where there is none.

    Notes
    -----
    Source: docs/model.md (223).
    """
    if are_few(shape.points):
        return None
    try:
        free = fit(shape, None)
        if free.shared_angle_error > 0.0 or free.route.noise < STATED.far_less * stated:
            return None
        if alone is not None and -2.0 * alone.log_evidence - free.deviance < CHANCE.never**2:
            return None
        result = measure(shape, None)
    except FitError:
        return None
    if result.noise < STATED.far_less * stated:
        return None
    return result.warned(
        f"the points have a noise of {1e3 * result.noise:.3g} mm and not the {1e3 * stated:.3g} mm that are "
        "stated: the former is used; check noise_mm"
    )
