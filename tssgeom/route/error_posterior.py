"""What a fitted route may be without errors that neighbouring points share; docs/model.md (230) to (232).

A fit follows errors that are longer than its points are apart. Its nodes are the route plus such errors, both
normal with unknown sizes. These are averaged over, by what the shape itself shows of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.route.resolution import LIMITS as RESOLUTION
from tssgeom.route.resolution import left_of_waves, without_twist
from tssgeom.route.route import Route
from tssgeom.statistics import EVEN, HELD, NORMAL_95
from tssgeom.threads import single_threaded


@dataclass(frozen=True, slots=True)
class PosteriorGrid:
    """On which sizes and lengths of the errors, and on how sharp a route, it is averaged."""

    nodes: int = 48
    """Nodes along the route. Chosen: a tenth of the route has five."""
    draws: int = 128
    """Draws of the errors, by which their spread is known to 6 %. Chosen."""
    shortest: float = 0.01
    """Shortest length over which errors are alike, over that of the route [1]. Chosen: below the nodes."""
    longest: float = 0.5
    """Longest one [1]. Chosen: longer errors move and turn the route."""
    size_deviation: float = 0.8
    """Standard deviation of the logarithm of the size [1]. Chosen: nine in ten within a factor of four."""
    sizes: tuple[float, ...] = (-2.0, -1.0, 0.0, 1.0, 2.0)
    """Sizes that are tried, on either side of the median [standard deviations]. Chosen: a factor of 2.2
    apart."""
    gentlest: float = 1e-3
    """Least intensity of the curvature, times the length of the route [rad²]. Chosen: it turns by 2°."""
    sharpest: float = 3e3
    """Greatest one [rad²]. Chosen: the curvature changes by 50 rad over the route."""
    sharper: float = 100.0
    """Intensity of the next derivative over that of the last one [1]. Derived: waves of 0.6 of the route."""
    finest: float = 0.1
    """Least detail of a shape that counts as evidence, over the median size of the errors [1]. Chosen: below
    it neither a route nor its errors are like their models."""

    @property
    def intensities(self) -> int:
        """Intensities between both, each as likely: two to a decade."""
        return 1 + round(2.0 * math.log10(self.sharpest / self.gentlest))

    @property
    def lengths(self) -> int:
        """Lengths between both, each as likely: as far apart as the sizes."""
        return 1 + round(math.log(self.longest / self.shortest) / self.size_deviation)


GRID = PosteriorGrid()
_ORDERS = (3, 5)
"""Derivatives of the route that may be white noise, each as likely: the curvature changes at once, or is as
smooth as the errors are."""


class ErrorPosterior(NamedTuple):
    """What errors that neighbours share mean for a fitted route."""

    angle_share: float
    """Mean of Φ without them over Φ as fitted [1]."""
    angle: float
    """Standard deviation of Φ [rad]."""
    length: float
    """Root mean square error of the length as fitted [m]."""
    least_angle: float = 0.0
    """Least standard error of Φ, which that of white noise may exceed and does not join [rad]."""


NO_POSTERIOR = ErrorPosterior(angle_share=1.0, angle=0.0, length=0.0)


class _Kernel(NamedTuple):
    """Route and errors of one size and length as independent components; docs/model.md (230)."""

    ratio: Vector
    """Variance of each component of a route of intensity 1 over that of the errors [n - 3]."""
    components: Matrix
    """From the nodes to the components [n - 3, n]."""
    errors: Matrix
    """From the components to the errors at the nodes [n, n - 3]."""
    hidden: Matrix
    """Errors that no shape shows, for three standard normal numbers [n, 3]."""
    log_prior: float
    """ln of the prior probability [1]; -inf of the kernel without errors, to which all are compared."""
    log_volume: float
    """ln of the determinant of the covariance of the errors' components [1]."""


@cache
def _kernels() -> tuple[_Kernel, ...]:
    u = np.linspace(0.0, 1.0, GRID.nodes)
    basis = np.linalg.qr(np.column_stack((np.ones_like(u), u, u * u)), mode="complete")[0]
    lengths = np.geomspace(GRID.shortest, GRID.longest, GRID.lengths)
    alike = [np.exp(-0.5 * ((u[:, None] - u) / length) ** 2) for length in lengths]
    routes = [_integrated(u, order) for order in _ORDERS]
    none = ((route, np.zeros_like(route), -math.inf) for route in routes)
    with single_threaded():  # matrices are small
        return tuple(_kernel(*one, basis) for one in (*none, *product(routes, alike, GRID.sizes)))


def _integrated(u: Vector, order: int) -> Matrix:
    """Covariance of white noise of intensity 1 that was integrated so many times from 0 [n, n]."""
    cells = 8 * len(u)
    x = (np.arange(cells) + 0.5) / cells
    part = np.maximum(u[:, None] - x, 0.0) ** (order - 1) / math.factorial(order - 1)
    return GRID.sharper ** (order - 3) / cells * part @ part.T


def _kernel(route: Matrix, alike: Matrix, size: float, basis: Matrix) -> _Kernel:
    hidden, identifiable = basis[:, :3], basis[:, 3:]
    errors = math.exp(2.0 * GRID.size_deviation * size) * alike + GRID.finest**2 * np.eye(len(alike))
    root = np.linalg.cholesky(identifiable.T @ errors @ identifiable)
    back = np.linalg.inv(root)
    ratio, turned = np.linalg.eigh(back @ (identifiable.T @ route @ identifiable) @ back.T)
    components = turned.T @ back @ identifiable.T
    within = np.linalg.inv(hidden.T @ np.linalg.solve(errors, hidden))
    volume = 2.0 * float(np.log(np.diag(root)).sum())
    moved = hidden @ np.linalg.cholesky(within)
    return _Kernel(np.maximum(ratio, 0.0), components, errors @ components.T, moved, -0.5 * size**2, volume)


def error_posterior(route: Route, size: float, resolution: float) -> ErrorPosterior:
    """Return what errors of about a size [m] mean for Φ at a resolution and for the length [m].

    Parameters
    ----------
    route
        A route as fitted to its points.
    size
        Median of the standard deviation of such an error of a coordinate, a priori [m].
    resolution
        Length of the shortest wave that counts [m]; 0 where all do.

    Notes
    -----
    Source: docs/model.md (230) to (232).
    """
    length, nodes = float(route.s[-1]), _even(route)
    errors = [size * one for one in _errors(nodes / size, size / length, proven=True)]
    sampled, mean = (nodes - one for one in errors)
    longer = _chords(sampled) - _chords(nodes)
    axes, at = _axes(nodes), resolution / length
    angle, of_mean = _angle(sampled, axes, at), float(_angle(mean, axes, at).mean())
    finer, coarser = (
        _angle(sampled, axes, at * x).mean() for x in (1.0 / RESOLUTION.octave, RESOLUTION.octave)
    )
    middle, own = 0.5 * (float(angle.mean()) + of_mean), float(_angle(nodes, axes, at))
    hidden = max(middle - own, 0.0)  # more than half of the angle is no share of what was sensed
    share, hidden = (1.0, hidden) if hidden >= 0.5 * middle else (middle / own, 0.0)
    return ErrorPosterior(
        angle_share=share,
        angle=math.hypot(float(angle.std()), middle - of_mean, float(finer - coarser), hidden),
        length=math.hypot(float(np.sqrt(np.mean(longer**2))), length * _excess(nodes, axes, at)),
    )


def possible_errors(route: Route, size: float, probability: float) -> ErrorPosterior:
    """Return what errors of about a size [m] mean that a shape may exclude, and never proves; (317).

    Parameters
    ----------
    route, size
        As of `error_posterior`.
    probability
        That there are any [1]. The standard error of Φ is of the interval that holds 95 % of all cases, and
        does not join that of white noise; that of the length does.
    """
    nodes, held = _even(route), 1.0 - (1.0 - HELD) / max(probability, 1.0 - HELD)
    errors = [size * one for one in _errors(nodes / size, size / float(route.s[-1]), proven=False)]
    sampled, mean = (nodes - one for one in errors)
    axes = _axes(nodes)
    angle = _angle(sampled, axes, 0.0)
    known = 0.5 * (_angle(mean, axes, 0.0).mean() - angle.mean()) - _angle(nodes, axes, 0.0)
    longer = np.mean((_chords(sampled) - _chords(nodes)) ** 2)
    alone = probability * float(longer) + EVEN * 2.0 * route.noise**2 * math.exp(2.0 * GRID.size_deviation**2)
    least = float(np.quantile(np.abs(angle + known), held)) / NORMAL_95
    return NO_POSTERIOR._replace(length=math.sqrt(alone), least_angle=least)


def _chords(nodes: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(nodes, axis=-2), axis=-1).sum(axis=-1)


def _errors(nodes: Matrix, relative: float, *, proven: bool) -> list[np.ndarray]:
    """Draw the errors of nodes, both over the median size, and their mean for each draw [draws, n, 3].

    The median size is `relative` to the length.
    """
    kernels = _kernels()
    parts = [kernel.components @ nodes for kernel in kernels]
    intensity = np.geomspace(GRID.gentlest, GRID.sharpest, GRID.intensities) / relative**2
    log_p = np.array([_log_evidence(*one, intensity) for one in zip(kernels, parts, strict=True)])
    p = _probability(log_p, np.array([kernel.log_prior for kernel in kernels]), proven=proven)
    rng = np.random.default_rng(0)
    count = rng.multinomial(GRID.draws, (p / p.sum()).ravel()).reshape(p.shape)
    sampled = [
        _sampled(kernels[i], parts[i], float(intensity[k]), int(count[i, k]), rng)
        for i, k in np.argwhere(count)
    ]
    return [np.concatenate(one) for one in zip(*sampled, strict=True)]


def _probability(log_evidence: Matrix, log_prior: Vector, *, proven: bool) -> Matrix:
    """Probability of each kernel and intensity; (231).

    A bend that the models of the route lack would be taken for an error. So half of it is by evidence that
    only excludes errors, and half by evidence as it is.
    """
    most = log_evidence.max(axis=1, keepdims=True)
    within = np.exp(log_evidence - most)
    evidence = most[:, 0] + np.log(within.sum(axis=1))
    none = evidence[np.isneginf(log_prior)].max()
    counted = (np.minimum(evidence, none), evidence)[: 1 + proven]
    weight = [np.exp(one + log_prior - np.max(one + log_prior)) for one in counted]
    probability = np.sum([one / one.sum() for one in weight], axis=0)
    return probability[:, None] * within / within.sum(axis=1, keepdims=True)


def _log_evidence(kernel: _Kernel, part: Matrix, intensity: Vector) -> Vector:
    """Log likelihood of the nodes for each intensity of the route; (231)."""
    total = 1.0 + intensity[:, None] * kernel.ratio
    square = np.sum(part**2, axis=1)
    log_volume = np.log(total).sum(axis=-1) + kernel.log_volume
    return -0.5 * (3.0 * log_volume + (square / total).sum(axis=-1))


def _sampled(
    kernel: _Kernel, part: Matrix, intensity: float, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draws of the errors at one size, length and intensity, and their mean for each."""
    share = 1.0 / (1.0 + intensity * kernel.ratio)
    known = rng.standard_normal((count, len(share), 3)) * np.sqrt(1.0 - share)[:, None]
    unknown = rng.standard_normal((count, 3, 3))
    mean = kernel.errors @ (share[:, None] * part)
    return mean + kernel.errors @ known + kernel.hidden @ unknown, np.broadcast_to(mean, (count, *mean.shape))


def _even(route: Route) -> Matrix:
    """Positions at even nodes, by cubics between those of the route [n, 3] [m]."""
    at = np.linspace(0.0, float(route.s[-1]), GRID.nodes)
    i = np.clip(np.searchsorted(route.s, at, side="right") - 1, 0, len(route.s) - 2)
    step = np.maximum(route.s[i + 1] - route.s[i], 1e-300)
    t = ((at - route.s[i]) / step)[:, None]
    first, second = route.position[i], route.position[i + 1]
    out, into = step[:, None] * route.tangent[i], step[:, None] * route.tangent[i + 1]
    way = t * t * (3.0 - 2.0 * t)
    return _in_own_axes(first + way * (second - first) + t * (1.0 - t) * ((1.0 - t) * out - t * into))


def _in_own_axes(nodes: Matrix) -> Matrix:
    """Return nodes [n, 3] [m] in axes that turn and are mirrored with them, so that draws of errors are."""
    off, s = nodes - nodes[0], np.linspace(0.0, 1.0, len(nodes))
    axes, along = np.linalg.qr(np.column_stack((off[1], off.mean(axis=0), s * s @ off)))
    return off @ (axes * np.copysign(1.0, np.diag(along)))


def _axes(nodes: Matrix) -> np.ndarray:
    """Two axes at the inner nodes that are carried along without twist [n - 2, 2, 3]."""
    tangent = nodes[2:] - nodes[:-2]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.stack(without_twist(tangent), axis=1)


def _turns(nodes: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return the turns of the chords between nodes, along two axes [..., n - 2, 2] [rad]."""
    chord = np.diff(nodes, axis=-2)
    chord = chord / np.linalg.norm(chord, axis=-1, keepdims=True)
    return np.einsum("...ic,iac->...ia", np.diff(chord, axis=-2), axes)


def _waves(turns: np.ndarray) -> np.ndarray:
    return np.fft.rfft(np.concatenate((turns, turns[..., ::-1, :]), axis=-2), axis=-2)


def _angle(nodes: np.ndarray, axes: np.ndarray, resolution: float) -> np.ndarray:
    """Φ of routes through nodes at a resolution over their length [draws]; (163)."""
    turns = _turns(nodes, axes)
    if resolution > 0.0:
        waves = _waves(turns)
        waves *= left_of_waves(waves.shape[-2], resolution)[:, None]
        turns = np.fft.irfft(waves, axis=-2)[..., : len(axes), :]
    return np.linalg.norm(turns, axis=-1).sum(axis=-1)


def _excess(nodes: Matrix, axes: np.ndarray, resolution: float) -> float:
    """Share of the length that waves below a resolution add, both over the length [1]; (233)."""
    square = np.sum(np.abs(_waves(_turns(nodes, axes))) ** 2, axis=1)
    k = np.arange(1, len(square))
    shorter = 1.0 - left_of_waves(len(square), resolution)[1:] ** 2
    return float(0.25 * np.sum(square[1:] * shorter / (math.pi * k) ** 2))
