"""Errors that neighbouring points share, by the source of the points; docs/model.md (164)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Points
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_route import POINTS
from tssgeom.rig import Source
from tssgeom.route.bounds import LIMITS as BOUNDS
from tssgeom.route.bounds import polygon
from tssgeom.route.error_posterior import NO_POSTERIOR, ErrorPosterior, error_posterior, possible_errors
from tssgeom.route.observations import NOISE_PRIOR, Shape
from tssgeom.route.resolution import (
    LIMITS,
    angle_over_resolution,
    at_resolution,
    share_of_short_bends,
    without_errors,
)
from tssgeom.route.route_fit import RouteFit, SharedErrors
from tssgeom.statistics import EVEN

_LAGS = 10  # neighbours before a point that its residual is compared with; chosen: two turns of five points
_ALIKE = 0.5  # of the power of residuals, shared at a lag [1]; chosen: white noise has at most 0.27


@dataclass(frozen=True, slots=True)
class SmoothedPrior:
    """How often points of no stated source were smoothed, and what noise that leaves; docs/model.md (316)."""

    share: float = 0.25
    """Share of such points [1]. Chosen: one source in four."""
    decades: float = 6.0
    """Decades below a sensor's typical noise in which theirs lies, each as likely [1]. Chosen: what is
    stored of a millimetre has up to six digits."""
    worth_a_word: float = 0.5
    """What it adds to the standard error of Φ over that error, from which on it is named [1]. Chosen: the
    error is an eighth more."""


SMOOTHED = SmoothedPrior()


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
    fit: RouteFit,
    source: Source | None,
    resolution: float | None,
    known: ErrorPosterior | None = None,
    gain: float = 0.0,
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
    gain
        Standard deviation of the scale of its angles, where it is stated: it replaces that of the source [1].
    """
    errors, length = SOURCES[source or "markers"], fit.arcs.total_length
    at = errors.resolution_share * length if resolution is None else resolution
    if known is None:
        known = posterior_of_source(fit, source, resolution)
    fit, slope = at_resolution(fit, at) if at > 0.0 else (fit, 0.0)
    fit = fit if known.angle_share == 1.0 else without_errors(fit, known.angle_share)
    if at > 0.0 and resolution is None:
        fit = fit.warned(
            f"source {source}: short bends may be errors, Φ counts none shorter than {1e3 * at:.3g} mm, "
            "a tenth of the route: state [shape] resolution_mm"
        )
    of_waves = slope if errors.size_share == 0.0 else 0.0  # else the posterior holds it
    share = gain if gain > 0.0 and errors.angle_share > 0.0 else errors.angle_share
    angle = math.hypot(share * fit.arcs.total_angle, errors.angle, of_waves, known.angle)
    wider = max(angle**2, known.least_angle**2 - fit.arcs.total_angle_se**2)
    return fit, SharedErrors(wider, math.hypot(errors.length_share * length, known.length) ** 2)


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


def with_hidden_errors(fit: RouteFit, shape: Shape, noise: float | None) -> tuple[RouteFit, ErrorPosterior]:
    """Return what errors may mean for a route through points of no stated source, and a warning; (316).

    Parameters
    ----------
    fit
        A route as fitted to its points, which counts their errors as independent.
    shape
        The points.
    noise
        Standard deviation of a coordinate of the points as sensed, estimated [m]; None where it is stated.
    """
    if (unlike := _unlike_noise(fit, shape.points)) is not None:
        return unlike
    length, angle = fit.arcs.total_length, fit.arcs.total_angle
    counted = fit.spline is not None and fit.spline.shared_angle_error > 0.0
    if counted or angle <= 0.0:
        return fit, NO_POSTERIOR
    at = SOURCES["smoothed"].resolution_share * length
    many = fit.chain is None and len(fit.weight) >= POINTS.few
    bends = many and share_of_short_bends(fit, at) > LIMITS.hidden
    probability = 1.0 if bends else _probability_of_smoothed(fit, noise)
    if probability == 0.0:
        return fit, NO_POSTERIOR
    size = NOISE_PRIOR.typical * length
    if probability > EVEN:
        known, hidden = error_posterior(fit.route, size, 0.0), 0.0 if fit.chain else _in_short_bends(fit)
        share = math.sqrt(probability)
        shared = share * math.hypot(hidden, known.angle, angle * (1.0 - known.angle_share))
        errors = ErrorPosterior(1.0, shared, share * known.length)
        why = "the route has many short bends" if bends else "the points have less noise than sensors"
        if shared > SMOOTHED.worth_a_word * fit.arcs.total_angle_se:
            fit = fit.warned(
                f"{why}, as if smoothed by a program: ± Φ holds {math.degrees(shared):.2g}° for errors that "
                "neighbours share: state [shape] source"
            )
    else:
        errors = possible_errors(fit.route, size, probability)
    measured = shape.length is not None or shape.stations is not None
    return fit, errors._replace(length=0.0) if measured else errors


def _probability_of_smoothed(fit: RouteFit, noise: float | None) -> float:
    """Return how likely a program smoothed points that have an estimated noise [m]; (316).

    Those of a stated noise are as stated; arcs through points up to rounding were computed.
    """
    relative = 0.0 if noise is None else noise / fit.arcs.total_length
    if noise is None or (fit.chain is not None and relative < ROUNDING.relative):
        return 0.0
    smoothed = SMOOTHED.share / SMOOTHED.decades
    off = min(math.log10(max(relative, 1e-300) / NOISE_PRIOR.typical), 0.0) / NOISE_PRIOR.decades
    density = math.exp(-0.5 * off**2) / (math.sqrt(2.0 * math.pi) * NOISE_PRIOR.decades)
    return smoothed / (smoothed + (1.0 - SMOOTHED.share) * density)
