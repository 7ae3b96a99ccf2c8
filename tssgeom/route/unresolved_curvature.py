"""What the angle of a chain owes to its form where no point shows it; docs/model.md (263), (266), (267).

The arcs of a chain meet sharply at its joints, and bend to the very ends. Bends may as well pass into one
another over some length, and an end may be straight: the points are moved by less than their noise, and Φ
changes by many of its standard errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.route.arcs.chain import Chain, Data, first_joint_column, noise_variance, value_count
from tssgeom.route.model_choice import model_probabilities
from tssgeom.route.route import across


@dataclass(frozen=True, slots=True)
class UnresolvedForms:
    """Which lengths of blended joints and straight ends are tried."""

    lengths: int = 16
    """Lengths of each kind, of which 64 give the same to 3 %. Chosen: their roots are evenly spaced and as
    likely, since a tip of two centimetres is hardly rarer on a longer piece."""
    longest_end: float = 0.5
    """Longest straight end, over the piece that it is cut from [1]. Chosen: a longer one is a piece that the
    fit finds."""


FORMS = UnresolvedForms()
_STEPS = 64  # along a joint, for its mean curvature; numerical: to 1e-4
_STEP = 1e-6  # of each parameter, in its unit, for derivatives; numerical: between rounding and curvature


class _Kind(NamedTuple):
    """How a chain changes by one kind of form, over lengths [g] that are equally likely."""

    moved: np.ndarray
    """Displacements of the points [g, n, 3] [m]."""
    turned: np.ndarray
    """Changes of the tangents there [g, n, 3] [1]."""
    angle: Vector
    """Change of Φ, the parameters of the chain as they are [g] [rad]."""


class _Rows(NamedTuple):
    """Values that a chain is fitted to, in units of the noise of a coordinate [m]."""

    data: Data
    tangent: Points
    """Tangents at the points [n, 3]."""

    def of(self, moved: np.ndarray, turned: np.ndarray) -> Matrix:
        """Rows of displacements and changes of tangents [..., n, 3]; across the chain where it is free."""
        tangents, free = self.data.tangents, self.data.free
        rows = [(across(moved, self.tangent) if free else moved) * np.sqrt(self.data.weight)[:, None]]
        if tangents is not None:
            rows.append(across(turned, self.tangent) * np.sqrt(tangents.weight)[:, None])
        return np.concatenate([one.reshape(*one.shape[:-2], -1) for one in rows], axis=-1)


def unresolved_angle_variance(data: Data, chain: Chain) -> float:
    """Mean square by which Φ may differ from that of a chain for blended joints and straight ends [rad²].

    Parameters
    ----------
    data, chain
        Points, and a chain that was fitted to them. It is not fitted again: all changes are taken to first
        order.

    Notes
    -----
    Source: docs/model.md (263), (266), (267).
    """
    position, frame = core.along_chain(chain.stations, chain.form)
    ends = (_straight_end(chain, frame, first=first) for first in (True, False))
    kinds = [kind for kind in (_blended_joints(chain), *ends) if kind is not None]
    if not kinds:
        return 0.0
    every = _refitted(
        data, chain, position, frame[:, 0], _Kind(*map(np.concatenate, zip(*kinds, strict=True)))
    )
    return sum(map(_mean_square, *(one.reshape(len(kinds), -1) for one in every)))


def _refitted(
    data: Data, chain: Chain, position: Points, tangent: Points, kind: _Kind
) -> tuple[Vector, Vector]:
    """Gain [ln] and change of Φ [rad] by each length of a kind after a fit of the other parameters; (266)."""
    rows = _Rows(data, tangent)
    slopes = rows.of(*_derivatives(data, chain, position, tangent))
    scale = np.maximum(np.linalg.norm(slopes, axis=1), 1e-300)
    slopes /= scale[:, None]
    sensed = tangent if data.tangents is None else data.tangents.unit
    residual = rows.of(data.points - position, np.nan_to_num(sensed - tangent))
    moved = rows.of(kind.moved, kind.turned)
    shared = moved @ slopes.T
    equations = slopes @ slopes.T + ROUNDING.exact * np.eye(len(slopes))  # a parameter may do what others do
    of_angle = _derivatives_of_angle(data, chain) / scale
    fitted = np.linalg.solve(equations, np.column_stack((shared.T, of_angle)))
    squares = np.einsum("ij,ij->i", moved, moved) - np.einsum("ij,ji->i", shared, fitted[:, :-1])
    gain = (moved @ residual - 0.5 * squares) / max(noise_variance(data, chain), 1e-300)
    if data.variance == 0.0:  # the noise is estimated from what is left
        left = max(value_count(data) - len(slopes), 1)
        gain = -0.5 * left * np.log(np.maximum(1.0 - 2.0 * gain / left, 1.0 / left))
    return gain, kind.angle - shared @ fitted[:, -1]


def _mean_square(gain: Vector, angle: Vector) -> float:
    """Mean square of changes of Φ [g] [rad] that gain so much [ln]: all together as likely as none; (267)."""
    none = math.log(len(gain))
    return float(model_probabilities(np.append(gain, none))[:-1] @ angle**2)


def _lengths(longest: float) -> Vector:
    """Lengths of one kind [g] [m], denser where they are shorter."""
    return longest * ((np.arange(FORMS.lengths) + 0.5) / FORMS.lengths) ** 2


def _blended_joints(chain: Chain) -> _Kind | None:
    """Joints over whose length the curvature passes from one piece to the next one evenly; (263)."""
    if len(chain.bend) == 1:
        return None
    edge = chain.edges
    room = np.minimum(np.diff(edge)[:-1], np.diff(edge)[1:])
    length = np.minimum(_lengths(float(room.max())), room[:, None])
    _, frame = core.along_chain(edge[1:-1], chain.form)
    change = np.einsum("jc,jcd->jd", np.diff(chain.bend, axis=0), frame[:, 1:])
    u = np.clip((chain.stations - edge[1:-1, None])[:, None] / length[..., None], -0.5, 0.5)
    half, passed = (u + 0.5) ** 2, np.maximum(u, 0.0)
    moved = length[..., None] ** 2 * (half * (u + 0.5) / 6.0 - 0.5 * passed**2)
    turned = length[..., None] * (0.5 * half - passed)
    lost = 0.5 * (np.linalg.norm(chain.bend[:-1], axis=1) + np.linalg.norm(chain.bend[1:], axis=1))
    lost -= np.linalg.norm(_between(chain.bend), axis=2).mean(axis=0)
    return _Kind(np.tensordot(moved, change, (0, 0)), np.tensordot(turned, change, (0, 0)), -lost @ length)


def _between(bend: Points) -> np.ndarray:
    """Curvature components on the way from each piece to the next one [steps, k - 1, 2] [1/m]."""
    share = (np.arange(_STEPS) + 0.5)[:, None, None] / _STEPS
    return bend[:-1] + share * np.diff(bend, axis=0)


def _straight_end(chain: Chain, frame: np.ndarray, *, first: bool) -> _Kind | None:
    """Straight end instead of the last part of a bend, by the axes at the points [n, 3, 3]; (263)."""
    j = 0 if first else len(chain.bend) - 1
    if not chain.curved[j]:
        return None
    edge = chain.edges
    length = _lengths(FORMS.longest_end * float(edge[j + 1] - edge[j]))
    inward = chain.stations - edge[0] if first else edge[-1] - chain.stations
    past = np.maximum(length[:, None] - inward, 0.0)[..., None]
    bend = np.einsum("c,ncd->nd", chain.bend[j], frame[:, 1:])
    return _Kind(
        -0.5 * past**2 * bend,
        (past if first else -past) * bend,
        -length * float(np.linalg.norm(chain.bend[j])),
    )


def _derivatives(
    data: Data, chain: Chain, position: Points, tangent: Points
) -> tuple[np.ndarray, np.ndarray]:
    """Differentiate positions and tangents at the points by the parameters of a chain [m, n, 3]."""
    normals, curved = chain.axes[1:], np.flatnonzero(chain.curved)
    forms = [
        *(_changed(chain.form, 0, axis) for axis in (normals if data.free else np.eye(3))),
        *(_changed(chain.form, slice(1, 4), turn) for turn in np.cross(normals[:, None], chain.axes)),
        *(_changed(chain.form, (4 + j, 0), 1.0) for j in range(1, len(chain.bend))),
        *(_changed(chain.form, (int(4 + j), 1 + c), 1.0) for j in curved for c in (0, 1)),
    ]
    changed = [core.along_chain(chain.stations, form) for form in forms]
    return (
        np.array([at - position for at, _ in changed]) / _STEP,
        np.array([frame[:, 0] - tangent for _, frame in changed]) / _STEP,
    )


def _changed(form: Points, at: int | slice | tuple[int, int], by: Vector | float) -> Points:
    """Form of a chain after a small step of one parameter."""
    form = form.copy()
    form[at] += _STEP * by
    return form


def _derivatives_of_angle(data: Data, chain: Chain) -> Vector:
    """Differentiate Φ by the same parameters [m]: a joint that moves leaves more to the piece before it."""
    kappa = np.linalg.norm(chain.bend, axis=1)
    unit = chain.bend / np.maximum(kappa, 1e-300)[:, None]
    of_bends = (unit * np.diff(chain.edges)[:, None])[chain.curved]
    of_start = np.zeros(first_joint_column(data.free))
    return np.concatenate((of_start, -np.diff(kappa), of_bends.ravel()))
