"""Errors that neighbouring points share, by the source of the points; docs/model.md (164)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Points
from tssgeom.core.constants_route import POINTS
from tssgeom.rig import Source
from tssgeom.route.bounds import LIMITS as BOUNDS
from tssgeom.route.bounds import polygon
from tssgeom.route.error_posterior import NO_POSTERIOR, ErrorPosterior, error_posterior
from tssgeom.route.observations import NOISE_PRIOR
from tssgeom.route.resolution import (
    LIMITS,
    SharedErrors,
    angle_over_resolution,
    at_resolution,
    share_of_short_bends,
    without_errors,
)
from tssgeom.route.route_fit import RouteFit

_LAGS = 10  # neighbours before a point that its residual is compared with; chosen: two turns of five points
_ALIKE = 0.5  # of the power of residuals, shared at a lag [1]; chosen: white noise has at most 0.27


@dataclass(frozen=True, slots=True)
class SourceErrors:
    """What neighbouring points of a source share."""

    size_share: float = 0.0
    """Median of the standard deviation of such an error of a coordinate, of the length of the route [1]; 0
    where there is none. Chosen: 0.7 mm on half a metre, as scans and trackers have."""
    angle_share: float = 0.0
    """Standard error of Φ, of Φ itself [1]."""
    angle: float = 0.0
    """Standard error of Φ beside that [rad]."""
    length_share: float = 0.0
    """Standard error of the length, of the length itself [1]."""
    resolution_share: float = 0.0
    """Resolution where none is stated, of the length of the route [1]; 0 where Φ is given as fitted."""


SOURCES: dict[Source, SourceErrors] = {
    "markers": SourceErrors(),
    # chosen: distortion of a tracker's volume, 1 mm over 100 mm
    "em": SourceErrors(size_share=1.5e-3, angle_share=0.01, length_share=0.005),
    # measured: points rebuilt from a fibre's spectrum, three recordings of one fibre
    "fbg": SourceErrors(size_share=1.5e-3, angle_share=0.2, angle=0.1, length_share=0.02),
    # chosen: ten waves on a route are more than a sheath has bends
    "centreline": SourceErrors(size_share=1.5e-3, resolution_share=0.1),
    "smoothed": SourceErrors(size_share=1.5e-3, resolution_share=0.1),
}


def with_shared_errors(
    fit: RouteFit, source: Source | None, resolution: float | None, known: ErrorPosterior | None = None
) -> tuple[RouteFit, SharedErrors]:
    """Return a fit at a resolution, and the errors beside its own that its source brings; (163), (164).

    Parameters
    ----------
    fit
        A route as fitted to its points, which counts their errors as independent.
    source
        Where the points come from; None where that is not known.
    resolution
        Length of the shortest wave that counts [m]; that of the source where None.
    known
        What errors that neighbours share mean for the fit, where that is known already.
    """
    errors, length = SOURCES[source or "markers"], fit.arcs.total_length
    at = errors.resolution_share * length if resolution is None else resolution
    if known is None:
        known = posterior_of_source(fit, source, resolution)
    fit, slope = at_resolution(fit, at) if at > 0.0 else (fit, 0.0)
    fit = without_errors(fit, known.angle_share)
    if at > 0.0 and resolution is None:
        fit = fit.warned(
            f"source {source}: short bends may be errors, Φ counts none shorter than {1e3 * at:.3g} mm, "
            "a tenth of the route: state [shape] resolution_mm"
        )
    of_waves = slope if errors.size_share == 0.0 else 0.0  # else the posterior holds it
    angle = math.hypot(errors.angle_share * fit.arcs.total_angle, errors.angle, of_waves, known.angle)
    return fit, SharedErrors(angle**2, math.hypot(errors.length_share * length, known.length) ** 2)


def posterior_of_source(fit: RouteFit, source: Source | None, resolution: float | None) -> ErrorPosterior:
    """Return what the errors of a source mean for a fit; arguments as in `with_shared_errors`."""
    errors, length = SOURCES[source or "markers"], fit.arcs.total_length
    if errors.size_share == 0.0:
        return NO_POSTERIOR
    at = errors.resolution_share * length if resolution is None else resolution
    known = error_posterior(fit.route, errors.size_share * length, at)
    if at > 0.0 or fit.chain is not None:
        return known
    return known._replace(angle=math.hypot(known.angle, _in_short_bends(fit)))


def _in_short_bends(fit: RouteFit) -> float:
    """Return the angle in bends that are shorter than a smoothed line has [rad]."""
    at = SOURCES["smoothed"].resolution_share * fit.arcs.total_length
    return max(fit.arcs.total_angle - float(angle_over_resolution(fit, np.array([at]))[0]), 0.0)


def _unlike_noise(fit: RouteFit, points: Points) -> tuple[RouteFit, ErrorPosterior] | None:
    """Return the fit with a warning, and what its residuals may hide; None where they resemble noise; (227).

    Residuals so large that the polygon through the points bounds nothing are noise only if neighbours differ.
    """
    through = polygon(points, fit.weight)
    chords = float(through.chord.sum())
    few = len(through.chord) < POINTS.few
    if few or fit.noise * len(through.chord) < BOUNDS.small_noise * chords:
        return None
    off = fit.route.residual[fit.weight > 0.0]
    off = off - off.mean(axis=0)
    alike = [float(np.sum(off[lag:] * off[:-lag])) for lag in range(1, _LAGS + 1)]
    if max(np.abs(alike)) < _ALIKE * float(np.sum(off**2)):
        return None
    hidden = max(float(through.turn.sum()) - fit.arcs.total_angle, 0.0)
    warned = fit.warned(
        f"the points leave the route by {1e3 * fit.noise:.3g} mm, and neighbours alike, as noise does not: "
        f"± Φ holds the {math.degrees(hidden):.3g}° by which their polygon turns more; check their order, "
        "and give more points to each bend"
    )
    return warned, ErrorPosterior(1.0, hidden, max(chords - fit.arcs.total_length, 0.0))


def with_hidden_errors(fit: RouteFit, points: Points, sensed_noise: float) -> tuple[RouteFit, ErrorPosterior]:
    """Return what errors may mean for a route through points [n, 3] of no stated source, and a warning.

    There are none where the points are few, where their noise is that of a sensor and short bends are few,
    and where the estimator counts errors that neighbours share itself.
    """
    if (unlike := _unlike_noise(fit, points)) is not None:
        return unlike
    smooth = fit.chain is None and fit.spline is not None and fit.spline.shared_angle_error == 0.0
    length, angle = fit.arcs.total_length, fit.arcs.total_angle
    if not smooth or len(fit.weight) < POINTS.few or angle <= 0.0:
        return fit, NO_POSTERIOR
    at = SOURCES["smoothed"].resolution_share * length
    noiseless = sensed_noise < LIMITS.noiseless * length
    if not noiseless and share_of_short_bends(fit, at) <= LIMITS.hidden:
        return fit, NO_POSTERIOR
    hidden = _in_short_bends(fit)
    why = (
        "the points have no noise, as if smoothed by a program"
        if noiseless
        else "the route has many short bends"
    )
    fit = fit.warned(
        f"{why}: ± Φ holds the {math.degrees(hidden):.2g}° of bends shorter than {1e3 * at:.3g} mm, which "
        "may be errors of the points: state [shape] source"
    )
    errors = error_posterior(fit.route, NOISE_PRIOR.typical * length, 0.0)
    less = angle * (1.0 - errors.angle_share)
    return fit, ErrorPosterior(1.0, math.hypot(hidden, errors.angle, less), errors.length)
