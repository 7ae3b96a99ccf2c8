"""Points from two or more views by weighted least squares, every view checked; docs/model.md (131)-(133)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.stats import chi2

from tssgeom.arrays import Points, Vector
from tssgeom.vision.cameras import Eyes

_STEPS = 10
_STILL = 1e-10  # of the depth: a smaller step is the last
_CHANCE = 1e-4  # of a true point to be taken for a wrong one
_LEAST_ANGLE = 2e-2  # between rays: below, depth is noise alone [rad]


@dataclass(frozen=True, slots=True)
class Triangulated:
    """Points in space, and how well their views agree."""

    points: Points
    """A row of NaN where no point could be placed [n, 3] [m]."""
    covariance: np.ndarray
    """[n, 3, 3] [m²]."""
    square: Vector
    """Sum of the squared, weighted reprojection errors; NaN with the point [n]."""
    used: np.ndarray
    """The views that count, [v, n] bool."""

    @property
    def freedom(self) -> Vector:
        """Degrees of freedom of `square` [n]."""
        return 2.0 * self.used.sum(axis=0) - 3.0


def gates(views: int, scale: float = 1.0) -> Vector:
    """Squares that chance exceeds once in ten thousand, by the number of views [views + 1].

    Parameters
    ----------
    views
        Largest number of views.
    scale
        Pixel noise over what the detections state [1].
    """
    free = 2 * np.arange(views + 1) - 3
    return np.where(free > 0, chi2.isf(_CHANCE, np.maximum(free, 1)), 0.0) * scale**2


def triangulate(eyes: Eyes, slope: np.ndarray, weight: np.ndarray, gate: Vector) -> Triangulated:
    """Place points that several cameras see; docs/model.md (132).

    Parameters
    ----------
    eyes
        Poses of the cameras.
    slope
        Directions of sight x/z, y/z; NaN where a camera does not see the point [v, n, 2].
    weight
        Inverse covariance of each direction [v, n, 2, 2].
    gate
        Largest square by the number of views, from `gates`; one view beyond it may be left out where
        two others agree.
    """
    views, count = slope.shape[:2]
    points, covariance = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    square, used = np.full(count, np.nan), np.zeros((views, count), np.bool_)
    _triangulate_all(eyes.rotation, eyes.shift, slope, weight, gate, points, covariance, square, used)
    return Triangulated(points, covariance, square, used)


@njit(cache=True, nogil=True)
def _triangulate_all(
    rotation: np.ndarray,
    shift: np.ndarray,
    slope: np.ndarray,
    weight: np.ndarray,
    gate: np.ndarray,
    points: np.ndarray,
    covariance: np.ndarray,
    square: np.ndarray,
    used: np.ndarray,
) -> None:
    views, count = slope.shape[0], slope.shape[1]
    visible, best = np.empty(views, np.bool_), np.empty(views, np.bool_)
    for i in range(count):
        sights = 0
        for v in range(views):
            visible[v] = math.isfinite(slope[v, i, 0])
            sights += 1 if visible[v] else 0
        if sights < 2:
            continue
        x, c, q = intersection(rotation, shift, slope[:, i], weight[:, i], visible)
        best[:] = visible
        if sights > 2 and not q <= gate[sights]:
            q, left = math.inf, -1
            for v in range(views):
                if visible[v]:
                    visible[v] = False
                    x1, c1, q1 = intersection(rotation, shift, slope[:, i], weight[:, i], visible)
                    visible[v] = True
                    if q1 < q:
                        x, c, q, left = x1, c1, q1, v
            if left >= 0:
                best[left] = False
            sights -= 1
        if q <= gate[sights]:
            points[i], covariance[i], square[i] = x, c, q
            used[:, i] = best


@njit(cache=True, nogil=True)
def intersection(
    rotation: np.ndarray, shift: np.ndarray, slope: np.ndarray, weight: np.ndarray, visible: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Place one point by Gauss-Newton; return position, covariance and square, infinite on failure."""
    x, ok = _first_guess(rotation, shift, slope, visible)
    nothing = np.full((3, 3), np.nan)
    if not ok or not _wide_enough(rotation, shift, slope, visible):
        return x, nothing, math.inf
    normal, inverse = np.empty((3, 3)), nothing
    for _ in range(_STEPS):
        pull, _, deep = _equations(rotation, shift, slope, weight, visible, x, normal)
        if not deep > 0.0:
            return x, nothing, math.inf
        inverse = _inverse(normal)
        step = inverse @ pull
        x = x + step
        if not np.abs(step).max() > _STILL * deep:
            break
    _, square, deep = _equations(rotation, shift, slope, weight, visible, x, normal)
    if not (deep > 0.0 and math.isfinite(square)):
        return x, nothing, math.inf
    return x, _inverse(normal), square


@njit(cache=True, nogil=True)
def _equations(
    rotation: np.ndarray,
    shift: np.ndarray,
    slope: np.ndarray,
    weight: np.ndarray,
    visible: np.ndarray,
    x: np.ndarray,
    normal: np.ndarray,
) -> tuple[np.ndarray, float, float]:
    """Fill the normal equations at a position; return their right side, the square and the least depth."""
    normal[:] = 0.0
    pull, square, deep = np.zeros(3), 0.0, math.inf
    jac, weighted = np.empty((2, 3)), np.empty((2, 3))
    for v in range(len(visible)):
        if not visible[v]:
            continue
        r, w = rotation[v], weight[v]
        depth = r[2, 0] * x[0] + r[2, 1] * x[1] + r[2, 2] * x[2] + shift[v, 2]
        deep = min(deep, depth)
        if not depth > 0.0:
            break
        a = (r[0, 0] * x[0] + r[0, 1] * x[1] + r[0, 2] * x[2] + shift[v, 0]) / depth
        b = (r[1, 0] * x[0] + r[1, 1] * x[1] + r[1, 2] * x[2] + shift[v, 1]) / depth
        ea, eb = slope[v, 0] - a, slope[v, 1] - b
        for c in range(3):
            jac[0, c] = (r[0, c] - a * r[2, c]) / depth  # docs/model.md (132)
            jac[1, c] = (r[1, c] - b * r[2, c]) / depth
            weighted[0, c] = w[0, 0] * jac[0, c] + w[0, 1] * jac[1, c]
            weighted[1, c] = w[1, 0] * jac[0, c] + w[1, 1] * jac[1, c]
        square += ea * (w[0, 0] * ea + w[0, 1] * eb) + eb * (w[1, 0] * ea + w[1, 1] * eb)
        for c in range(3):
            pull[c] += weighted[0, c] * ea + weighted[1, c] * eb
            for d in range(3):
                normal[c, d] += jac[0, c] * weighted[0, d] + jac[1, c] * weighted[1, d]
    return pull, square, deep


@njit(cache=True, nogil=True)
def _first_guess(
    rotation: np.ndarray, shift: np.ndarray, slope: np.ndarray, visible: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Return the point nearest to all rays."""
    normal, pull = np.zeros((3, 3)), np.zeros(3)
    for v in range(len(visible)):
        if not visible[v]:
            continue
        ray, centre = _ray(rotation[v], shift[v], slope[v])
        for c in range(3):
            for d in range(3):
                across = (1.0 if c == d else 0.0) - ray[c] * ray[d]
                normal[c, d] += across
                pull[c] += across * centre[d]
    x = _inverse(normal) @ pull
    return x, bool(np.isfinite(x).all())


@njit(cache=True, nogil=True)
def _wide_enough(rotation: np.ndarray, shift: np.ndarray, slope: np.ndarray, visible: np.ndarray) -> bool:
    """Whether two of the rays differ by an angle that determines depth."""
    least = math.cos(_LEAST_ANGLE)
    for v in range(len(visible)):
        for u in range(v):
            if visible[v] and visible[u]:
                one, _ = _ray(rotation[v], shift[v], slope[v])
                other, _ = _ray(rotation[u], shift[u], slope[u])
                if one[0] * other[0] + one[1] * other[1] + one[2] * other[2] < least:
                    return True
    return False


@njit(cache=True, nogil=True)
def _ray(rotation: np.ndarray, shift: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit vector of a sight and the centre of its camera, in the common frame."""
    ray, centre = np.empty(3), np.empty(3)
    for c in range(3):
        ray[c] = rotation[0, c] * slope[0] + rotation[1, c] * slope[1] + rotation[2, c]
        centre[c] = -(rotation[0, c] * shift[0] + rotation[1, c] * shift[1] + rotation[2, c] * shift[2])
    return ray / math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2), centre


@njit(cache=True, nogil=True)
def _inverse(m: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix [3, 3], NaN where it has none."""
    a, b, c, d, e, f = m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = d * f - e * e, c * e - b * f, b * e - c * d
    out[1, 1], out[1, 2], out[2, 2] = a * f - c * c, b * c - a * e, a * d - b * b
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    whole = a * out[0, 0] + b * out[0, 1] + c * out[0, 2]
    return out / (whole if whole != 0.0 else math.nan)


def pixel_scale(square: Vector, freedom: Vector) -> float:
    """Pixel noise that reprojection errors show, over the stated one, by their median [1]; (133)."""
    kept = np.isfinite(square) & (freedom > 0)
    if not kept.any():
        return 1.0
    return math.sqrt(float(np.median(square[kept] / chi2.median(freedom[kept]))))


def weights(slope_by_pixel: np.ndarray, noise: Vector) -> np.ndarray:
    """Inverse covariance of directions whose pixels have the standard deviation `noise` [px]; (131)."""
    spread = slope_by_pixel * noise[:, None, None]
    return np.linalg.inv(spread @ spread.transpose(0, 2, 1))


def mean_of(points: np.ndarray, covariance: np.ndarray) -> tuple[Points, np.ndarray]:
    """Return the middle of the corners [n, k, 3] of each marker, and its covariance."""
    corners = points.shape[1]
    return points.mean(axis=1), covariance.sum(axis=1) / corners**2
