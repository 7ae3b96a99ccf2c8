"""How the angle of a smooth route is spread within its pieces of constant curvature; docs/model.md (283)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, read_only
from tssgeom.route.pieces import Arcs
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.spline.spline import Spline

_PIECES = 40
"""Pieces at least [1]; chosen: as many as a machine has bars, `MachineFitSettings.fine`."""


def finer_pieces(fit: RouteFit) -> Arcs:
    """Return a route as short pieces, with the covariance of their lengths and angles; docs/model.md (283).

    The pieces of a smooth fit are as few as its points prove, and their covariance is that of their sums: as
    though each were bent evenly. A chain of arcs is its pieces, and stays as it is.

    Parameters
    ----------
    fit
        A route as fitted.

    Examples
    --------
    >>> from tssgeom import clean, measure
    >>> import numpy as np
    >>> s = np.linspace(0.0, 0.5, 80)  # a bend that grows evenly along half a metre
    >>> turn = 3.0 * s**2
    >>> step = np.diff(s, prepend=0.0)[:, None]
    >>> points = np.cumsum(step * np.column_stack((np.cos(turn), np.sin(turn), 0.0 * s)), axis=0)
    >>> fit = measure(clean(points + np.random.default_rng(1).normal(0.0, 2e-4, points.shape)))
    >>> len(finer_pieces(fit).length) > len(fit.arcs.length)
    True
    """
    arcs, spline = fit.arcs, fit.spline
    if arcs.method != "spline" or spline is None or len(fit.profile.s) != len(spline.route.s):
        return arcs
    joints = _finer(spline)
    first = np.searchsorted(joints, spline.joints)
    piece = np.repeat(np.arange(len(first) - 1), np.diff(first))  # in which each finer one lies
    length, angle = np.diff(fit.profile.s[joints]), np.diff(fit.profile.phi[joints])
    count, sums = len(length), np.equal.outer(np.arange(len(first) - 1), piece).astype(float)
    own = _angle_covariance(spline, joints)
    shared = own @ sums.T
    by_piece = np.zeros((2 * count, 2 * len(sums)))  # how lengths and angles follow those of their pieces
    by_piece[:count, : len(sums)] = (length / (sums @ length)[piece])[:, None] * sums.T
    by_piece[count:, len(sums) :] = shared @ np.linalg.pinv(sums @ shared, hermitian=True)
    covariance = by_piece @ arcs.covariance @ by_piece.T
    covariance[count:, count:] += own - by_piece[count:, len(sums) :] @ shared.T
    return replace(
        arcs,
        length=read_only(length),
        angle=read_only(np.maximum(angle, 0.0)),
        covariance=read_only(covariance),
    )


def _finer(spline: Spline) -> np.ndarray:
    """Return the nodes at which finer pieces meet, those of the pieces among them."""
    s = spline.route.s
    wanted = np.linspace(s[0], s[-1], _PIECES + 1)[1:-1]
    return np.union1d(spline.joints, np.searchsorted(s, wanted)).astype(spline.joints.dtype)


def _angle_covariance(spline: Spline, joints: np.ndarray) -> Matrix:
    """Return the posterior covariance of the angles between some nodes of a smooth fit [k, k] [rad²]."""
    route, k = spline.route, len(joints) - 1
    covariance = core.curvature_profile(
        *(route.s, route.tangent, route.curvature_vector, spline.covariance, spline.gain, spline.freedom),
        *(route.noise, spline.stations_known, spline.shared_angle_error, spline.tangent_share, route.station),
        joints,
    )[2]
    return np.asarray(covariance[k:, k:], dtype=np.float64)
