"""From a shape to everything the tendon asks of it: route, curvature profile and pieces."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Literal

import numpy as np
from numba import njit

from tssgeom.arrays import Vector, read_only
from tssgeom.errors import FitError
from tssgeom.route.agreement import is_folded, refuse_folded, refuse_lost, winds
from tssgeom.route.arcs.chain import Chain, Data
from tssgeom.route.arcs.corners import cornered
from tssgeom.route.arcs.fit import fit_fixed_pieces
from tssgeom.route.arcs.moves import fit_chain, without_piece, without_short_pieces
from tssgeom.route.arcs.outliers import refitted_with_tangents, with_tangents, without_outliers
from tssgeom.route.arcs.summary import ChainOutline, chain_pieces
from tssgeom.route.curvature import CurvatureProfile, curvature_profile
from tssgeom.route.directions import direction_warnings
from tssgeom.route.known_length import of_known_length
from tssgeom.route.model_choice import lead, margin
from tssgeom.route.observations import Shape, order_warnings, stray_warnings
from tssgeom.route.outline import Outline
from tssgeom.route.pieces import Arcs, constant_curvature_pieces, normals, parallel_components
from tssgeom.route.route import Route
from tssgeom.route.spline.fit import Spline, fit
from tssgeom.route.stations import spacing_of_pieces, summed

Method = Literal["auto", "spline", "arcs"]
HOPELESS = -40.0
"""Lead of a first chain over the spline that merging and splitting will not make up [1]."""

_FEWEST_FOR_CHAIN = 6
_MOST_OVER_CHORD = 2.8  # turn for which a chord is made longer [rad]
_FROM_CHORDS = "the points do not tell their stations: taken from the chords between them"
_QUICK_MOVES = 8
_DOUBTFUL = 0.03  # relative standard error of Φ above which a smooth fit may be one of kinks
_FAR_OFF = 3.0  # spacings that points lie off a fit, above which it may have lost them
_CLOSE_CALL = 12.0  # -2 ln evidence within which the loser still counts for the standard error
_CLOSE_BY_JOINT = 0.3  # by which that grows with every joint
_SHORT = 3.0  # spacings: pieces shorter than this hold too few points for a bend, if they hold it badly
_UNKNOWN = 3.0  # the same of any piece [rad]
_UNTOLD = 0.3  # standard error of the bend of such a piece from which on it is none [rad]


@dataclass(frozen=True, slots=True)
class Geometry:
    """What was found out about one route."""

    outline: Outline | ChainOutline
    arcs: Arcs
    spline: Spline | None = None
    """The smooth fit, where one was made."""
    chain: Chain | None = None
    """The chain of arcs, where it was taken."""

    @property
    def route(self) -> Route:
        """The route on its nodes."""
        return self.outline.route

    @property
    def profile(self) -> CurvatureProfile:
        """Curvature on the same nodes."""
        return self.outline.profile

    def bare(self) -> Geometry:
        """Return it without what only the next fit needs."""
        return Geometry(self.outline, self.arcs)


def measure(shape: Shape, noise: float | None = None, method: Method = "auto") -> Geometry:
    """Fit a route to a shape and cut it into pieces.

    Parameters
    ----------
    shape
        Validated points.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.
    method
        Estimator: the spline, the chain of arcs, or the one that the points speak for; docs/model.md (34).

    Raises
    ------
    FitError
        Where the points give no finite curve.
    """
    try:
        return checked(told_length(_measured(shape, noise, method), shape), shape)
    except FitError:
        if shape.stations is not None:
            raise
    stations = _arcs_over_chords(shape, noise)
    sure = replace(shape, stations=stations)
    found = checked(told_length(_measured(sure, noise, method), shape), shape)
    return replace(found, outline=found.outline.warned(_FROM_CHORDS))


def _arcs_over_chords(shape: Shape, noise: float | None) -> Vector:
    """Stations by the chords between points, each made longer by the turn in a fit on chords alone [m]."""
    chord = np.linalg.norm(np.diff(shape.points, axis=0), axis=1)
    first = by_spline(fit(replace(shape, stations=read_only(summed(chord))), noise))
    turn = np.diff(np.interp(first.route.station, first.profile.s, first.profile.phi))
    return read_only(summed(chord / np.sinc(np.minimum(turn, _MOST_OVER_CHORD) / (2.0 * math.pi))))


def checked(geometry: Geometry, shape: Shape) -> Geometry:
    """Return a geometry, unless its route lost its points.

    Points that share errors with their neighbours are left alone: those are longer than the noise tells.

    Raises
    ------
    FitError
        Where it lost them.
    """
    if geometry.spline is None or geometry.spline.angle_doubt == 0.0:
        refuse_lost(shape.points, geometry.outline.weight, geometry.outline.noise, geometry.arcs)
    return geometry


def told_length(geometry: Geometry, shape: Shape) -> Geometry:
    """Take the length of the whole route into account, where it is known."""
    if shape.length is None:
        return geometry
    found = (geometry.route, geometry.profile, geometry.arcs)
    route, profile, arcs = of_known_length(*found, shape.length, shape.length_noise)
    return replace(geometry, outline=Outline(route, profile), arcs=arcs)


def _measured(shape: Shape, noise: float | None, method: Method) -> Geometry:
    spline = fit(shape, noise)
    smooth = by_few(by_spline(spline), shape)
    if method == "spline" or not may_be_chain(shape, spline):
        refuse_folded(spline.route)
        return smooth
    data = fit_data(shape, noise, spline)
    must = method == "arcs" or is_folded(spline.route)
    tried = list(_chains(data, smooth, spline, must=must))
    sound = [one for one in tried if not _winds(*one)]
    found = [(margin(*one, spline), *one) for one in sound or (tried if method == "arcs" else ())]
    if not found:
        return smooth
    ahead, data, chain = max(found, key=itemgetter(0))
    arcs = by_chain(shape, *without_outliers(data, chain))
    return arcs if must else chosen(smooth, arcs, ahead)


def _chains(data: Data, smooth: Geometry, spline: Spline, *, must: bool) -> Iterator[tuple[Data, Chain]]:
    """Chains from every first guess, before and after moves."""
    for given, first in _starts(data, smooth):
        chain: Chain | None = fit_fixed_pieces(given, first)
        if not must and given is data:
            chain = _promising(given, chain, spline)
        for one in () if chain is None else (fit_chain(given, chain), chain):
            weighed, fitted = refitted_with_tangents(given, one)
            fitted, _, _ = _told(weighed, fitted)
            yield weighed, fitted


def _winds(data: Data, chain: Chain) -> bool:
    """Whether a chain winds out of sight between its points."""
    edge = np.append(chain.joints, chain.stations.max())  # the last piece has no joint behind it
    turned = np.interp(chain.stations, edge, summed(np.linalg.norm(chain.bend, axis=1) * np.diff(edge)))
    return winds(data.points, data.weight, chain.stations, turned)


def _starts(data: Data, smooth: Geometry) -> Iterator[tuple[Data, Chain]]:
    """First guesses of a chain: the pieces of the smooth fit, and where that is in doubt, corners."""
    yield data, started(data, smooth)
    told = smooth.arcs.total_angle_se <= _DOUBTFUL * smooth.arcs.total_angle
    if not told or smooth.route.noise > _FAR_OFF * data.spacing:
        guess = cornered(data, smooth.route)
        if guess is not None:
            yield guess


def by_spline(spline: Spline) -> Geometry:
    """Profile and pieces of a smooth fit."""
    profile = curvature_profile(spline)
    return Geometry(Outline(spline.route, profile), constant_curvature_pieces(spline, profile), spline)


def by_few(smooth: Geometry, shape: Shape) -> Geometry:
    """Doubt a smooth fit to points too few for a chain by their turns; docs/model.md (34)."""
    if len(shape.points) >= _FEWEST_FOR_CHAIN:
        return smooth
    step = np.diff(shape.points, axis=0)
    size = np.linalg.norm(step, axis=1)
    turns = np.arccos(np.clip(np.einsum("ij,ij->i", step[1:], step[:-1]) / (size[1:] * size[:-1]), -1.0, 1.0))
    told = size.sum() - 0.5 * (size[0] + size[-1])  # the outer halves go on alike
    whole = turns.sum() * size.sum() / told
    return doubted(smooth, float(whole - smooth.arcs.total_angle) ** 2)


def by_chain(shape: Shape, data: Data, chain: Chain) -> Geometry:
    """Route, profile and pieces of a fitted chain."""
    warnings = stray_warnings(shape, data.weight)
    if data.tangents is not None:
        used = np.where(data.tangents.variance[:, None] > 0.0, data.tangents.unit, np.nan)
        warnings += direction_warnings(shape.directions, used, shape.index)
    chain, arcs, noise = _told(data, chain)
    if data.free:
        warnings += order_warnings(shape, data.weight, chain.stations, noise)
    return Geometry(ChainOutline(data, chain, noise, warnings), arcs, chain=chain)


def _told(data: Data, chain: Chain) -> tuple[Chain, Arcs, float]:
    """Leave out pieces whose bend the points do not tell; returns also the pieces, and the noise [m]."""
    while True:
        arcs, noise = chain_pieces(data, chain)
        untold = _untold(arcs.length, arcs.covariance, data.spacing)
        if untold < 0:
            return chain, arcs, noise
        chain = without_piece(data, chain, untold)


@njit(cache=True, nogil=True)
def _untold(length: np.ndarray, covariance: np.ndarray, gap: float) -> int:
    """Return a short piece whose bend its points do not tell, such as the one beyond a last joint, or -1."""
    k, worst, error = len(length), -1, _UNTOLD
    for j in range(k):
        variance = covariance[k + j, k + j]
        least = error if length[j] < _SHORT * gap else max(error, _UNKNOWN)
        if not math.sqrt(max(variance, 0.0)) < least:
            worst, error = j, math.sqrt(max(variance, 0.0))
    return worst if k > 1 else -1


def fit_data(shape: Shape, noise: float | None, spline: Spline) -> Data:
    """Points as the chain wants them, weighted as in a route that was fitted to them."""
    variance, route = 0.0 if noise is None else noise * noise, spline.route
    spacing = spacing_of_pieces(shape.points, float(route.s[-1]))
    data = Data(shape.points, np.array(route.weight), shape.stations is None, variance, spacing)
    if shape.directions is None:
        return data
    kappa = np.interp(route.station, route.s, np.linalg.norm(route.curvature_vector, axis=1))
    return with_tangents(data, spline.memory[0].tangents, shape.direction_noise**2, kappa, route.noise**2)


def may_be_chain(shape: Shape, spline: Spline) -> bool:
    """Whether there are points enough, with errors of their own."""
    return len(shape.points) >= _FEWEST_FOR_CHAIN and spline.angle_doubt == 0.0


def _promising(data: Data, chain: Chain, spline: Spline) -> Chain | None:
    """Return the chain after a few moves, or None where it stays far behind the spline."""
    for _ in range(_QUICK_MOVES):
        if lead(data, chain, spline) >= HOPELESS:
            return chain
        chain = fit_chain(data, chain, 1)
    return chain if lead(data, chain, spline) >= HOPELESS else None


def started(data: Data, smooth: Geometry) -> Chain:
    """First guess of a chain from a smooth fit; directions tell even pieces of few points."""
    chain = _first_chain(smooth.route, smooth.arcs)
    return chain if data.tangents is None else without_short_pieces(chain, data)


def _first_chain(route: Route, arcs: Arcs) -> Chain:
    """Chain with the joints of the spline's pieces, and the mean curvature vector of each."""
    tangent = route.tangent[0]
    first, second = normals(tangent)
    parts = parallel_components(route.tangent, route.curvature_vector)
    at = np.searchsorted(route.s, np.append(arcs.s_start, route.s[-1]))
    bend = np.array([parts[a : max(b, a + 1)].mean(axis=0) for a, b in itertools.pairwise(at)])
    return Chain(
        start=np.array(route.position[0]),
        axes=np.array([tangent, first, second]),
        joints=np.array(arcs.s_start),
        bend=bend,
        curved=np.ones(len(bend), dtype=np.bool_),
        stations=np.array(route.station),
        matrix=np.zeros((0, 0)),
        cost=0.0,
        square=np.zeros(0),
    )


def chosen(smooth: Geometry, arcs: Geometry, ahead: float) -> Geometry:
    """Take the likelier; the nearer the call, the more of the difference goes into the standard error."""
    taken = replace(arcs if ahead > 0 else smooth, spline=smooth.spline)
    return doubted(taken, doubt(smooth, arcs, ahead))


def undecided(ahead: float, pieces: int) -> bool:
    """Whether a lead is so small that the loser still counts, for a chain of so many pieces."""
    return abs(ahead) <= _CLOSE_CALL * _blur(pieces)


def _blur(pieces: int) -> float:
    return 1.0 + _CLOSE_BY_JOINT * (pieces - 1)


def doubt(smooth: Geometry, arcs: Geometry, ahead: float) -> float:
    """Return the variance of Φ that comes from not knowing which of the two is right [rad²]."""
    pieces = len(arcs.arcs.length)
    if not undecided(ahead, pieces):
        return 0.0
    weight = 1.0 / (1.0 + math.exp(0.5 * abs(ahead) / _blur(pieces)))
    gap = smooth.profile.total_angle - arcs.profile.total_angle
    return weight * gap * gap


def doubted(geometry: Geometry, variance: float) -> Geometry:
    """Add a variance of Φ [rad²], spread over profile and pieces as the angle is."""
    if variance == 0.0:
        return geometry
    arcs = geometry.arcs
    k = len(arcs.length)
    part = arcs.angle / max(arcs.total_angle, 1e-300)
    covariance = np.array(arcs.covariance)
    covariance[k:, k:] += variance * np.outer(part, part)
    return replace(
        geometry,
        outline=geometry.outline.doubted(variance),
        arcs=replace(arcs, covariance=read_only(covariance)),
    )
