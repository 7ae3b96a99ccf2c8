"""A fitted route on nodes, and lengths along a route: arc length, spacing of points, stations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points, Vector
from tssgeom.errors import ShapeError
from tssgeom.plausibility.limits import LIMITS
from tssgeom.result import Result


@dataclass(frozen=True, slots=True)
class StationLimits:
    """Whether known stations and points can belong to each other."""

    chords: int = 8
    """Chords into which a route is cut for the comparison. Chosen: so few that noise lengthens none."""
    refusal: float = 2.0
    """Chords over their stations, the length by stations or by a fit over the path from point to point, and
    that path over the shortest one, above which the frame is refused [1]. Chosen: a wrong unit or column, or
    an arc of 3.8 rad on a chord; of 540 routes of 5 to 40 points in order only helices of more than two turns
    on a few points reach it, which no fit gets right."""
    most_turn_over_chord: float = 2.8
    """Turn up to which a chord is lengthened to its arc [rad]. Chosen: just below half a turn."""


STATIONS = StationLimits()


@dataclass(frozen=True, slots=True, repr=False)
class Route(Result):
    """A route on nodes along its arc length, and how the sensed points lie about it."""

    s: Vector
    """Arc length at the nodes, from 0 [m]."""
    position: Points
    """Positions of the nodes [m]."""
    tangent: Points
    """Unit tangents [1]."""
    curvature_vector: Points
    """Change of the unit tangent with arc length, normal to it [1/m]."""
    noise: float
    """Standard deviation of one coordinate of the points, known or estimated [m]."""
    weight: Vector
    """Weight of each sensed point: 1, or 0 for an outlier."""
    station: Vector
    """Arc length of the foot of each sensed point [m]."""
    residual: Points
    """Sensed point less its foot [m]."""


def summed(step: Vector) -> Vector:
    """Sum of the steps before each node, from 0."""
    return np.concatenate(([0.0], np.cumsum(step)))


def across(off: Points, unit: Points) -> Points:
    """Part of `off` [..., n, 3] that is normal to the unit vectors `unit` [n, 3]."""
    return off - np.einsum("...ij,ij->...i", off, unit)[..., None] * unit


def carried(tangent: Points, axis: Vector) -> Points:
    """Return a unit vector normal to the first of unit tangents [n, 3], carried along them without twist."""
    before, after = tangent[:-1], tangent[1:]
    cosine = np.einsum("ij,ij->i", before, after)[:, None, None]
    x, y, z = np.cross(before, after).T
    none = np.zeros(len(x))
    sine = np.array([[none, -z, y], [z, none, -x], [-y, x, none]]).transpose(2, 0, 1)
    # the least turn from each tangent to the next, then the product of all up to each
    turn = np.eye(3) + sine + sine @ sine / np.maximum(1.0 + cosine, 1e-9)
    step = 1
    while step < len(turn):
        turn[step:] = turn[step:] @ turn[:-step]
        step *= 2
    return np.vstack((axis, turn @ axis))


def step_lengths(points: Points) -> Vector:
    """Distances from point to point [n - 1] [m]."""
    step = np.diff(points, axis=0)
    return np.sqrt(np.einsum("ij,ij->i", step, step))


def arcs_over_chords(points: Points) -> Vector:
    """Return stations of points by circular arcs over the chords between them, from 0 [n] [m].

    Each chord turns by the mean curvature of the polygon at its two ends; docs/model.md (152).
    """
    chord = np.diff(points, axis=0)
    size = step_lengths(points)
    turn = np.arctan2(
        np.linalg.norm(np.cross(chord[:-1], chord[1:]), axis=1), np.einsum("ij,ij->i", chord[:-1], chord[1:])
    )
    curvature = 2.0 * turn / (size[:-1] + size[1:])
    ends = np.concatenate((curvature[:1], curvature, curvature[-1:]))
    turned = np.minimum(0.5 * size * (ends[:-1] + ends[1:]), STATIONS.most_turn_over_chord)
    return summed(size / np.sinc(turned / (2.0 * np.pi)))


def station_warnings(points: Points, known: Vector) -> tuple[str, ...]:
    """Compare stations, from 0 [m], with the path between the points, which cannot be longer.

    Raises ShapeError where they cannot belong to each other.
    """
    path, over, _ = core.against_stations(points, known, max(len(points) // STATIONS.chords, 1))
    if known[-1] > STATIONS.refusal * path or over > STATIONS.refusal:
        raise ShapeError(
            f"stations over {known[-1]:.3g} m for points along {path:.3g} m: check the unit of the stations"
        )
    if over > 1.0 + LIMITS.slight:
        return (f"the points lie {over - 1:.0%} farther apart than their stations: check both",)
    return ()


def stretched(route: Route) -> str | None:
    """Return a warning where stations lie farther apart than the route of many points goes along them."""
    path, length = float(np.sum(step_lengths(route.position))), float(route.s[-1])
    if length <= (1.0 + LIMITS.slight) * path:
        return None
    return f"the stations lie {length / path - 1.0:.0%} farther apart than their points: check both"
