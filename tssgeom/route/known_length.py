"""A route whose whole length is known: its ends give way, and a length that cannot be right is named."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route

_UNBELIEVABLE = 4.0  # standard errors between stated and sensed length
_ROUNDING = 1e-9  # of the length


def of_known_length(
    route: Route, profile: CurvatureProfile, arcs: Arcs, length: float, noise: float
) -> tuple[Route, CurvatureProfile, Arcs]:
    """Posterior of lengths and angles, given the length of the whole route; docs/model.md (95), (96).

    Parameters
    ----------
    route, profile, arcs
        What was found without it.
    length, noise
        The length and its standard deviation [m]. One that is off by more than four standard errors changes
        nothing and is named in a warning of the route.
    """
    k = len(arcs.length)
    shared = arcs.covariance[:, :k].sum(axis=1)  # of all lengths and angles with the whole length
    own = max(float(shared[:k].sum()), 0.0)
    variance = own + noise**2
    off, rounding = length - arcs.total_length, _ROUNDING * length
    if abs(off) > _UNBELIEVABLE * math.sqrt(variance) + rounding:
        warning = _warning(-off, length, math.sqrt(variance))
        return replace(route, warnings=(*route.warnings, warning)), profile, arcs
    if own <= rounding**2:
        return route, profile, arcs
    gain = shared / variance  # docs/model.md (95)
    moved = _stepped(arcs, gain * off, arcs.covariance - np.outer(gain, shared))
    return _on_other_ends(route, arcs, moved), _profile(profile, arcs, moved), moved


def _warning(longer: float, length: float, se: float) -> str:
    return (
        f"the route is {1e3 * abs(longer):.3g} mm {'longer' if longer > 0 else 'shorter'} "
        f"than the stated length of {1e3 * length:.6g} mm, with a standard error of {1e3 * se:.2g} mm: "
        "look for points beyond the ends, a wrong unit or a wrong length"
    )


def _stepped(arcs: Arcs, step: Vector, covariance: Matrix) -> Arcs:
    """Pieces with other lengths and angles, of which none becomes negative."""
    k = len(arcs.length)
    return replace(
        arcs,
        length=read_only(np.maximum(arcs.length + step[:k], 1e-3 * arcs.length)),
        angle=read_only(np.maximum(arcs.angle + step[k:], 0.0)),
        covariance=read_only(covariance),
    )


def _joints(arcs: Arcs) -> Vector:
    return np.append(arcs.s_start, arcs.total_length)


def _on_other_ends(route: Route, arcs: Arcs, moved: Arcs) -> Route:
    """Route with both end pieces stretched along their tangents."""
    was, now = _joints(arcs), _joints(moved)
    first = (now[1] - was[1]) / (2.0 if len(was) == 2 else 1.0)  # a single piece grows at both ends
    s, station = np.interp(route.s, was, now), np.interp(route.station, was, now)
    along, foot_along = s - route.s - first, station - route.station - first
    tangent = np.column_stack([np.interp(route.station, route.s, route.tangent[:, c]) for c in range(3)])
    return replace(
        route,
        s=read_only(s),
        position=read_only(route.position + along[:, None] * route.tangent),
        station=read_only(station),
        residual=read_only(route.residual - foot_along[:, None] * tangent),
    )


def _profile(profile: CurvatureProfile, arcs: Arcs, moved: Arcs) -> CurvatureProfile:
    """Profile whose length and angle are those of the moved pieces."""
    was = _joints(arcs)
    s = np.interp(profile.s, was, _joints(moved))
    piece = np.clip(np.searchsorted(was, profile.s, side="right") - 1, 0, len(arcs.angle) - 1)
    more = np.cumsum(moved.angle - arcs.angle)
    grown = (moved.angle - arcs.angle)[piece] * (profile.s - was[piece]) / arcs.length[piece]
    phi = profile.phi + np.concatenate(([0.0], more))[piece] + grown
    phi[-1] = moved.total_angle
    share = moved.total_angle_se / max(profile.total_angle_se, 1e-300)
    return replace(profile, s=read_only(s), phi=read_only(phi), phi_se=read_only(profile.phi_se * share))
