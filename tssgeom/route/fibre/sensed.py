"""A multicore fibre with gratings: from curvatures at stations to the route, its angle and its pieces.

The errors of a fibre are white in curvature, so those of the positions grow along it; everything is therefore
estimated from the curvatures themselves, and the route follows by integration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only, rows_at
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError, ShapeError
from tssgeom.route.agreement import AGREEMENT
from tssgeom.route.fibre.draws import sampled
from tssgeom.route.fibre.models import Kinds, Sensed, kinds_of, partitions
from tssgeom.route.fibre.noise import LEVELS, LastNoise, noises
from tssgeom.route.fibre.route import fit_of_draws, fit_of_pieces
from tssgeom.route.geometry import Method
from tssgeom.route.observations import Shape, require_increasing
from tssgeom.route.route_fit import LOST, RouteFit

MIN_GRATINGS = 3
_MOST_CELLS = 200  # values for the estimators, whose time is quadratic; of more, neighbours are averaged
_MORE = (2.0, 4.0)  # of a stated noise, tried beside it [1]; chosen: one has more evidence from 1.5 times on
_CONTRADICTED = (
    "the curvatures have a noise of {:.3g} /m and not the {:.3g} /m that are stated: the former is used; "
    "check curvature_noise_per_m"
)
_MOST_TURN = math.pi  # from grating to grating, beyond which the unit must be wrong [rad]


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


@dataclass(frozen=True, slots=True)
class FibreFit:
    """Route of a fibre, its noise in curvature and the probabilities of both models."""

    fit: RouteFit
    curvature_noise: float
    """Standard deviation of one curvature component, known or estimated [1/m]."""
    curvature_noise_se: float
    """Its standard error; 0 where it is known [1/m]."""
    probability: dict[str, float]
    """Posterior probability that no piece is smooth ("arcs"), and that one is ("spline")."""

    compared: int = 0
    """Frames since the noise was estimated, or compared with the curvatures where it is stated [1]."""

    @property
    def start(self) -> LastNoise | None:
        """Noise from which the next frame starts; None where Φ was lost."""
        if self.fit.arcs.total_angle_se >= LOST:
            return None
        se = self.curvature_noise_se / self.curvature_noise
        return LastNoise(self.curvature_noise, se, self.compared + 1)


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
    _refuse_full_turns(bend, s)
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
    require_increasing(s, np.diff(s) <= 0.0)
    return s


def _refuse_wrong_unit(bend: Matrix, s: Vector) -> None:
    turn = float(np.median(np.hypot(*bend.T)) * np.median(np.diff(s)))
    if turn > _MOST_TURN:
        raise ShapeError(
            f"the fibre turns by {turn:.3g} rad from grating to grating: "
            "check the units of curvature and station"
        )


def _refuse_full_turns(bend: Matrix, s: Vector) -> None:
    """Refuse a grating whose curvature is more than a full turn over the distance to its neighbour."""
    size, spacing = np.hypot(*bend.T), np.diff(s)
    turn = size * np.minimum(np.append(spacing, np.inf), np.append(np.inf, spacing))
    wrong = np.flatnonzero(turn > 2.0 * math.pi)  # missing ones are NaN
    if wrong.size:
        i = int(wrong[0])
        raise ShapeError(
            f"grating {i} has a curvature of {size[i]:.3g} per m, more than a full turn to its neighbour: "
            "leave a wrong reading empty"
        )


def fit_fibre(
    fibre: Fibre, noise: float | None = None, method: Method = "auto", last: LastNoise | None = None
) -> FibreFit:
    """Estimate the route of a fibre, in pieces that are straight, of constant curvature, or smooth.

    The fibre begins at the origin along z; κ_x bends it towards x, κ_y towards y. Φ and its standard error
    are those of all partitions and noises that count; docs/model.md (38).

    Parameters
    ----------
    fibre
        Validated curvatures.
    noise
        Known standard deviation of a curvature component [1/m]; estimated where left out, and where the
        curvatures contradict it, with a warning; docs/model.md (228).
    method
        "arcs" for constant curvature in pieces, "spline" for smooth curvature, "auto" for both; (36).
    last
        Noise that the last frame of a stream gave, as `FibreFit.start`, times what it has changed by since.

    Raises
    ------
    FitError
        Where the curvatures give no finite route, or do not determine Φ.
    """
    sensed = _sensed(fibre, noise)
    kinds = kinds_of(sensed, smooth=method != "arcs", pieces=method != "spline")
    levels = noises(sensed, kinds, last)
    draws, estimate = sampled(sensed, kinds, levels), levels.estimate
    if not math.isfinite(draws.log_evidence):
        raise FitError("the curvatures give no finite route: check them and their stations")
    compared = 0 if last is None or last.frames >= LEVELS.every else last.frames
    if noise is not None and compared == 0 and _is_contradicted(sensed, kinds, draws.log_evidence):
        free = fit_fibre(fibre, None, method)
        if free.curvature_noise > noise:
            text = _CONTRADICTED.format(free.curvature_noise, noise)
            return replace(free, fit=free.fit.warned(text))
    smooth = float(np.mean(draws.smooth))
    if smooth < 0.5:
        likeliest = partitions(sensed, kinds_of(sensed, smooth=False), estimate)
        fit = fit_of_pieces(sensed, likeliest, estimate, fibre.stations, draws)
    else:
        fit = fit_of_draws(sensed, draws, estimate, fibre.stations)
    if not fit.arcs.total_angle_se <= AGREEMENT.largest_angle_se:
        raise FitError("the curvatures do not determine how far the fibre turns: check for a wrong one")
    se = estimate * levels.relative_se
    return FibreFit(fit, estimate, se, {"arcs": 1.0 - smooth, "spline": smooth}, compared)


def _is_contradicted(sensed: Sensed, kinds: Kinds, log_evidence: float) -> bool:
    """Whether more noise than the stated one has far more evidence; docs/model.md (228)."""
    more = max(partitions(sensed, kinds, times * sensed.noise).log_evidence for times in _MORE)
    return 2.0 * (more - log_evidence) > CHANCE.never**2


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
    before, after = s[0] > 0.0, s[-1] < fibre.length
    blank = np.zeros((1, 2))
    bend = np.vstack((blank[: int(before)], bend, blank[: int(after)]))
    count = np.concatenate((np.zeros(int(before)), count, np.zeros(int(after))))
    s = np.concatenate((np.zeros(int(before)), s, np.full(int(after), fibre.length)))
    return Sensed(s, bend, count, 0.0 if noise is None else noise)
