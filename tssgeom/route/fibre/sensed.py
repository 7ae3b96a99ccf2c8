"""A multicore fibre with gratings: from curvatures at stations to the route, its angle and its pieces.

The errors of a fibre are white in curvature, so those of the positions grow along it; everything is therefore
estimated from the curvatures themselves, and the route follows by integration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only, rows_at
from tssgeom.errors import ShapeError
from tssgeom.route.fibre.models import (
    Partition,
    Prior,
    Sensed,
    angle_of_pieces,
    angle_of_wander,
    average_partitions,
    log_evidence,
    posterior,
    spectrum,
    wander_nodes,
)
from tssgeom.route.fibre.route import fit_of_pieces, fit_of_wander
from tssgeom.route.geometry import Method
from tssgeom.route.model_choice import log_sum, mixture_variance, model_probabilities
from tssgeom.route.observations import Shape
from tssgeom.route.route_fit import RouteFit

MIN_GRATINGS = 3
_MOST_CELLS = 200  # values for the estimators, whose time is quadratic; of more, neighbours are averaged
_MOST_TURN = math.pi  # from grating to grating, beyond which the unit must be wrong [rad]


@dataclass(frozen=True, slots=True)
class PriorGrid:
    """Priors over which each model of a fibre is averaged; docs/model.md (36), (37)."""

    joints: tuple[float, ...] = (0.3, 1.0, 3.0, 8.0, 20.0, 50.0)
    """Joints expected on a fibre. Chosen: even in their logarithm."""
    wander: tuple[float, ...] = tuple(2.0**k for k in range(-2, 6))
    """Change of a component over the fibre, in typical curvatures [1]. Chosen: even in their logarithm."""
    noise: tuple[float, float] = (1e-3, 1.5)
    """Bounds of an unknown noise, in typical curvatures [1]. Chosen: three decades."""
    noise_levels: int = 9
    """Levels of the coarse grid of the noise. Chosen."""
    noise_tolerance: float = 0.03
    """Error of ln of the likeliest noise [1]. Chosen: far below its standard error."""
    negligible: float = 0.02
    """Probability over that of the likeliest prior, below which a prior is left out [1]. Chosen: by speed."""
    nodes: int = 80
    """Fewest nodes on which a smooth curvature is averaged. Chosen."""


GRID = PriorGrid()


@dataclass(frozen=True, slots=True)
class Fibre:
    """Sensed curvatures that can be integrated, proximal to distal."""

    curvatures: Matrix
    """Components κ_x, κ_y in the frame that the fibre carries without twist, [n, 2] [1/m]."""
    stations: Vector
    """Arc length of each grating from where the fibre begins [m]."""
    length: float
    """Length of the fibre [m]."""
    index: Vector
    """Row of each grating among the sensed ones."""
    warnings: tuple[str, ...]


class Candidate(NamedTuple):
    """One model of the curvatures, averaged over its priors."""

    log_evidence: float
    """ln of the evidence, averaged over the priors."""
    angle: float
    """Φ of the likeliest prior [rad]."""
    mean: float
    """Φ averaged over the priors [rad]."""
    variance: float
    """Variance of Φ [rad²]."""
    noise: float
    """Standard deviation of a curvature component [1/m]."""
    prior: Prior
    partition: Partition | None


@dataclass(frozen=True, slots=True)
class FibreFit:
    """Route of a fibre, its noise in curvature and the probabilities of both models."""

    fit: RouteFit
    curvature_noise: float
    """Standard deviation of one curvature component, known or estimated [1/m]."""
    probability: dict[str, float]
    """Posterior probability of pieces ("arcs"), and of smooth curvature ("spline")."""


def clean_fibre(curvatures: Matrix, stations: Vector | None) -> Fibre:
    """Check sensed curvatures.

    Parameters
    ----------
    curvatures
        Components κ_x, κ_y, [n, 2]; a row of NaN is a grating that was not read, or, first or last, a mark of
        where the fibre begins or ends [1/m].
    stations
        Arc length of each row, increasing; the route runs from the first to the last [m].

    Raises
    ------
    ShapeError
        Fewer than three gratings, infinite values, stations missing or not increasing, bends beyond reason.
    """
    bend = np.asarray(curvatures, dtype=np.float64)
    if bend.ndim != 2 or bend.shape[1] != 2:
        raise ShapeError(f"curvatures have shape {bend.shape}: give one row of κ_x, κ_y for each grating")
    s = _checked_stations(bend, stations)
    if np.isinf(bend).any():
        row = int(np.argmax(np.isinf(bend).any(axis=1)))
        raise ShapeError(f"curvature {row} is infinite: leave a grating that was not read empty or NaN")
    observed = np.flatnonzero(~np.isnan(bend).any(axis=1))
    if len(observed) < MIN_GRATINGS:
        raise ShapeError(f"{len(observed)} gratings read: a fibre needs at least {MIN_GRATINGS}")
    _refuse_wrong_unit(bend[observed], s[observed])
    missing = int(observed[-1] - observed[0] + 1 - len(observed))
    return Fibre(
        read_only(bend[observed]),
        read_only(s[observed] - s[0]),
        float(s[-1] - s[0]),
        read_only(observed.astype(np.float64)),
        (f"{missing} gratings not read, bridged",) if missing else (),
    )


def _checked_stations(bend: Matrix, stations: Vector | None) -> Vector:
    if stations is None:
        raise ShapeError("curvatures without stations: give the arc length of each grating, s_mm or s_m")
    s = np.asarray(stations, dtype=np.float64)
    if s.shape != (len(bend),):
        raise ShapeError(f"{s.size} stations for {len(bend)} gratings: give one station for each grating")
    if not np.isfinite(s).all():
        raise ShapeError(
            f"the station of grating {int(np.argmin(np.isfinite(s)))} is missing: give its arc length"
        )
    wrong = np.flatnonzero(np.diff(s) <= 0.0)
    if wrong.size:
        i = int(wrong[0])
        raise ShapeError(
            f"stations do not increase: {s[i + 1]:g} m follows {s[i]:g} m; "
            "give arc length from the proximal end"
        )
    return s


def _refuse_wrong_unit(bend: Matrix, s: Vector) -> None:
    turn = float(np.median(np.linalg.norm(bend, axis=1)) * np.median(np.diff(s)))
    if turn > _MOST_TURN:
        raise ShapeError(
            f"the fibre turns by {turn:.3g} rad from grating to grating: "
            "check the units of curvature and station"
        )


def fibre_of_points(points: Points, stations: Vector) -> Fibre:
    """Turn points that a shape-sensing box integrated from curvatures back into them; docs/model.md (39).

    The errors of such points grow along the fibre and neighbours share them; those of the curvatures behind
    them are white. The points should stand at the gratings, and curvature is taken to run straight between
    them: points in between repeat the gratings, and their errors are then underestimated.

    Parameters
    ----------
    points
        Positions, proximal to distal, none missing [m].
    stations
        Known arc length of each [m].

    Raises
    ------
    ShapeError
        As `clean_fibre`.
    """
    chord = np.diff(np.asarray(points, dtype=np.float64), axis=0)
    way = chord / np.maximum(np.linalg.norm(chord, axis=1), 1e-300)[:, None]
    turn = way[1:] - way[:-1]
    half = 0.5 * np.linalg.norm(turn, axis=1)
    angle = 2.0 * np.arcsin(np.minimum(half, 1.0))
    tangent = way[1:] + way[:-1]
    tangent = tangent / np.linalg.norm(tangent, axis=1)[:, None]
    turned = core.parallel_components(tangent, turn * (angle / np.maximum(2.0 * half, 1e-300))[:, None])
    bend = np.full((len(points), 2), np.nan)
    bend[1:-1] = _unmixed(turned, np.diff(stations))
    return clean_fibre(bend, stations)


def _unmixed(turned: Matrix, step: Vector) -> Matrix:
    """Curvatures at the inner points [n-2, 2] from the turns between chords [rad] and the steps [m]; (39)."""
    from scipy.linalg import solve_banded

    before, after = step[:-1] / 6.0, step[1:] / 6.0
    middle = 2.0 * (before + after)
    middle[0] += before[0]  # beyond the last inner point curvature stays as it is
    middle[-1] += after[-1]
    band = np.vstack((np.append(0.0, after[:-1]), middle, np.append(before[1:], 0.0)))
    return solve_banded((1, 1), band, turned)


def measure_fibre(fibre: Fibre, noise: float | None = None, method: Method = "auto") -> RouteFit:
    """Route, curvature profile and pieces of a fibre; see `fit_fibre`."""
    return fit_fibre(fibre, noise, method).fit


def fit_fibre(fibre: Fibre, noise: float | None = None, method: Method = "auto") -> FibreFit:
    """Estimate the route of a fibre, as pieces of constant curvature or smooth, whichever is likelier.

    The fibre begins at the origin along z; κ_x bends it towards x, κ_y towards y. The standard error
    of Φ holds all models, not only the selected one; docs/model.md (38).

    Parameters
    ----------
    fibre
        Validated curvatures.
    noise
        Known standard deviation of a curvature component [1/m]; estimated where left out.
    method
        "arcs" for pieces, "spline" for a smooth curvature, "auto" for the likelier; docs/model.md (38).
    """
    sensed = _sensed(fibre, noise)
    pieces = [as_pieces(sensed)] if method != "spline" else []
    smooth = [as_wander(sensed, order) for order in (1, 2)] if method != "arcs" else []
    models = pieces + smooth
    probability = model_probabilities(np.array([one.log_evidence for one in models]))
    best = models[int(np.argmax(probability))]
    moments = np.array([(one.mean, one.variance) for one in models])
    square = mixture_variance(probability, moments[:, 0], moments[:, 1], best.angle)
    fit = (
        fit_of_pieces(sensed, best.partition, best.noise, fibre.stations, square, best.log_evidence)
        if best.partition is not None
        else fit_of_wander(sensed, best.prior, fibre.stations, square, best.log_evidence)
    )
    share = float(probability[: len(pieces)].sum())
    return FibreFit(fit, best.noise, {"arcs": share, "spline": 1.0 - share})


def as_pieces(sensed: Sensed) -> Candidate:
    """Model the curvatures by pieces of constant curvature; docs/model.md (36)."""
    expected = [m for m in GRID.joints if m <= max(len(sensed.s) - 1, 1)]
    rates = [m / sensed.length for m in expected]

    def score(noise: float) -> float:
        return max(average_partitions(sensed, noise, rate).log_evidence for rate in rates[1::3])

    noises, share = _noises(sensed, score)
    tried = [(noise, rate, average_partitions(sensed, noise, rate)) for noise in noises for rate in rates]
    conditional = np.array([each.log_evidence for _, _, each in tried])
    joint = conditional + np.repeat(share, len(rates)) - math.log(len(rates))
    probability = model_probabilities(joint)
    noise, rate, best = tried[int(np.argmax(conditional))]
    angle, beyond = angle_of_pieces(sensed, best, noise, rate)
    moments = np.array([(each.mean, each.variance) for _, _, each in tried])
    mean = float(probability @ moments[:, 0])
    variance = mixture_variance(probability, moments[:, 0], moments[:, 1], mean) + beyond
    return Candidate(log_sum(joint), angle, mean, variance, noise, Prior(0, 0.0, noise), best)


def as_wander(sensed: Sensed, order: int) -> Candidate:
    """Model the curvatures by smooth wander; docs/model.md (37)."""
    sizes = np.array(GRID.wander) * sensed.typical
    spectra = [spectrum(sensed, order, size) for size in sizes]
    noises, share = _noises(sensed, lambda noise: max(log_evidence(one, noise) for one in spectra))
    priors = [Prior(order, size, noise) for noise in noises for size in sizes]
    conditional = np.array([log_evidence(one, noise) for noise in noises for one in spectra])
    joint = conditional + np.repeat(share, len(sizes)) - math.log(len(sizes))
    probability = model_probabilities(joint)
    used = np.flatnonzero(probability > GRID.negligible * probability.max())
    nodes = wander_nodes(sensed, GRID.nodes)
    angles = np.array([angle_of_wander(posterior(sensed, priors[i], nodes)) for i in used])
    probability = model_probabilities(joint[used])
    mean = float(probability @ angles[:, 0])
    variance = mixture_variance(probability, angles[:, 0], angles[:, 1], mean)
    best = int(np.argmax(conditional[used]))
    prior = priors[used[best]]
    return Candidate(log_sum(joint), float(angles[best, 0]), mean, variance, prior.noise, prior, None)


def _noises(sensed: Sensed, score: Callable[[float], float]) -> tuple[Vector, Vector]:
    """Noise levels that count [1/m] and the ln of their prior shares: the known one, else a grid.

    A priori the logarithm of the noise is even over three decades; the grid is fine about the likeliest.
    """
    from scipy.optimize import minimize_scalar

    if sensed.noise > 0.0:
        return np.array([sensed.noise]), np.zeros(1)
    coarse = np.log(np.geomspace(*GRID.noise, GRID.noise_levels) * sensed.typical)
    best = coarse[int(np.argmax([score(math.exp(x)) for x in coarse]))]
    step = coarse[1] - coarse[0]
    bounds = (best - step, best + step)
    options = {"xatol": GRID.noise_tolerance}
    peak = minimize_scalar(lambda x: -score(math.exp(x)), bounds=bounds, method="bounded", options=options).x
    near = peak + np.arange(-2, 3) / math.sqrt(len(sensed.s))
    far = coarse[(coarse < near[0]) | (coarse > near[-1])]
    level = np.sort(np.concatenate((far, near)))
    share = np.gradient(level)
    return np.exp(level), np.log(share / share.sum())


def sensed_shape(fibre: Fibre, fit: RouteFit) -> Shape:
    """Return the positions of the gratings on the route, as a shape [m]."""
    route = fit.route
    positions = rows_at(fibre.stations, route.s, route.position)
    return Shape(read_only(positions), fibre.index, fibre.stations, fibre.warnings)


def _sensed(fibre: Fibre, noise: float | None) -> Sensed:
    """Curvatures for the estimators, neighbours averaged where there are very many."""
    n = len(fibre.stations)
    edge = np.unique(np.linspace(0, n, min(n, _MOST_CELLS) + 1).round().astype(np.int64))
    count = np.diff(edge).astype(np.float64)
    bend = np.add.reduceat(fibre.curvatures, edge[:-1]) / count[:, None]
    s = np.add.reduceat(fibre.stations, edge[:-1]) / count
    return Sensed(s, bend, count, fibre.length, 0.0 if noise is None else noise)
