"""Points from two or more views by weighted least squares, every view checked; docs/model.md (131)-(133)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
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
    """A row of NaN where no point could be triangulated [n, 3] [m]."""
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
    """Locate points that several cameras see; docs/model.md (132).

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
    used = np.isfinite(slope[..., 0])
    sights = used.sum(axis=0)
    points, covariance, square = intersections(eyes, slope, weight, used)
    beyond = (sights > 2) & ~(square <= gate[sights])
    square[beyond], whole = np.inf, used.copy()
    for v in range(len(slope)) if beyond.any() else ():
        tried = np.flatnonzero(beyond & whole[v])
        rest = whole[:, tried]
        rest[v] = False
        x, c, q = intersections(eyes, slope[:, tried], weight[:, tried], rest)
        better = q < square[tried]
        at = tried[better]
        points[at], covariance[at], square[at], used[:, at] = x[better], c[better], q[better], rest[:, better]
    good = (sights >= 2) & (square <= gate[sights - beyond])
    points[~good], covariance[~good], square[~good], used[:, ~good] = np.nan, np.nan, np.nan, False
    return Triangulated(points, covariance, square, used)


def intersections(
    eyes: Eyes, slope: np.ndarray, weight: np.ndarray, visible: np.ndarray
) -> tuple[Points, np.ndarray, Vector]:
    """Triangulate each point by Gauss-Newton from the views to which it is `visible` [v, n].

    Returns
    -------
    tuple of ndarray
        Positions [n, 3], covariances [n, 3, 3], and squares [n], infinite where there is no point.
    """
    slope = np.where(visible[..., None], slope, 0.0)
    weight = np.where(visible[..., None, None], weight, 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # points that cannot be triangulated
        ray = np.einsum("vic,vni->vnc", eyes.rotation[:, :2], slope) + eyes.rotation[:, None, 2]
        ray /= np.sqrt(np.einsum("vnc,vnc->vn", ray, ray))[..., None]
        x = _first_guess(eyes, ray, visible)
        moving = _wide_enough(ray, visible) & np.isfinite(x).all(axis=1)
        good = moving.copy()
        for _ in range(_STEPS):
            at = np.flatnonzero(moving)
            if not len(at):
                break
            at = slice(None) if len(at) == len(x) else at
            views = slope[:, at], weight[:, at], visible[:, at]
            pull, normal, _, deep = _equations(eyes, *views, x[at])
            step = np.einsum("nij,nj->ni", _inverse(normal), pull)
            x[at] = np.where(deep[:, None] > 0.0, x[at] + step, x[at])
            good[at] = deep > 0.0
            moving[at] = (deep > 0.0) & (np.abs(step).max(axis=1) > _STILL * deep)
        _, normal, square, deep = _equations(eyes, slope, weight, visible, x)
        good &= (deep > 0.0) & np.isfinite(square)
        covariance = _inverse(normal)
    return x, np.where(good[:, None, None], covariance, np.nan), np.where(good, square, np.inf)


def _equations(
    eyes: Eyes, slope: np.ndarray, weight: np.ndarray, visible: np.ndarray, x: Points
) -> tuple[np.ndarray, np.ndarray, Vector, Vector]:
    """Return right side and matrix of the normal equations at positions, the squares and the least depths."""
    local = x @ eyes.rotation.transpose(0, 2, 1) + eyes.shift[:, None]
    depth = np.where(visible, local[..., 2], 1.0)
    at = local[..., :2] / depth[..., None]
    error = slope - at
    turned = eyes.rotation[:, None, :2] - at[..., None] * eyes.rotation[:, None, 2:]
    jac = turned / depth[..., None, None]  # docs/model.md (132)
    weighted = weight @ jac
    pull = np.einsum("vnic,vni->nc", weighted, error)
    normal = np.einsum("vnic,vnid->ncd", jac, weighted)
    square = np.einsum("vni,vnij,vnj->n", error, weight, error)
    return pull, normal, square, np.where(visible, depth, np.inf).min(axis=0)


def _first_guess(eyes: Eyes, ray: np.ndarray, visible: np.ndarray) -> Points:
    """Return the points nearest to all rays, whose unit vectors are [v, n, 3]."""
    across = np.where(visible[..., None, None], np.eye(3) - ray[..., :, None] * ray[..., None, :], 0.0)
    centre = -np.einsum("vij,vi->vj", eyes.rotation, eyes.shift)
    pull = np.einsum("vnij,vj->ni", across, centre)
    return np.einsum("nij,nj->ni", _inverse(across.sum(axis=0)), pull)


def _wide_enough(ray: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Whether two of the rays differ by an angle that determines depth [n] bool."""
    together = np.einsum("vni,uni->vun", ray, ray)
    return ((together < math.cos(_LEAST_ANGLE)) & visible[:, None] & visible).any(axis=(0, 1))


def _inverse(m: np.ndarray) -> np.ndarray:
    """Inverse of symmetric matrices [n, 3, 3], not finite where there is none."""
    a, b, c, d, e, f = (m[:, i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    entries = d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b
    whole = a * entries[0] + b * entries[1] + c * entries[2]
    return np.array(entries)[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3) / whole[:, None, None]


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


def noise_across(points: Points, covariance: np.ndarray) -> float | None:
    """Return the root mean square standard deviation of the points across the route [m]; docs/model.md (143).

    Parameters
    ----------
    points
        Positions in the order of the route, a row of NaN for a point not detected [n, 3] [m].
    covariance
        Of each position [n, 3, 3] [m²].

    Returns
    -------
    float or None
        None where fewer than two points were detected.
    """
    visible = np.isfinite(points).all(axis=1)
    if np.count_nonzero(visible) < 2:
        return None
    tangent = np.gradient(points[visible], axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    spread = covariance[visible]
    along = np.einsum("ni,nij,nj->n", tangent, spread, tangent)
    across = 0.5 * (np.trace(spread, axis1=1, axis2=2) - along)
    return float(np.sqrt(np.mean(across)))
