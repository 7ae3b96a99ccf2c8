"""Routes whose truth is known: chains of arcs, helices, sample shapes of them, and what a rig states."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.errors import ShapeError
from tssgeom.mechanism import GivenRoute

_CELLS = 4000  # arcs that stand for a smooth route


class StatedRoute(NamedTuple):
    """Points that stand for the route of a rig in frames without a shape. All are chosen."""

    parts: int = 16
    """Equal parts of an even bend, and of bends that nobody knows, each with a share of the angle [1]: with
    eight the play of a pair that bends behind a straight sixteenth of its sheath was 18 standard errors
    off."""
    turn: float = 0.3
    """By how much the plane turns from part to part [rad]: a route of many turns does not meet itself."""


STATED = StatedRoute()
_POINTS = 8 * STATED.parts + 1  # eight chords a part: curvature is read off seven points within it


@dataclass(frozen=True, slots=True)
class Course:
    """A route as a chain of circular arcs, tangent-continuous, in a frame carried without twist."""

    length: Vector
    """Length of each arc [m]."""
    bend: Points
    """Curvature vector of each arc in the carried frame, [k, 2] [1/m]."""

    @property
    def total_length(self) -> float:
        """Length of the whole route [m]."""
        return float(self.length.sum())

    @property
    def total_angle(self) -> float:
        """Accumulated curve angle of the whole route [rad]."""
        return float(np.linalg.norm(self.bend, axis=1) @ self.length)


def chain(length: Vector, kappa: Vector, plane: Vector | float = 0.0) -> Course:
    """Chain of arcs of the given lengths [m], curvatures [1/m] and bending planes about the tangent [rad]."""
    kappa, plane = np.broadcast_arrays(np.atleast_1d(kappa), plane)
    return Course(np.atleast_1d(length), kappa[:, None] * np.column_stack((np.cos(plane), np.sin(plane))))


def frames(course: Course) -> tuple[Points, np.ndarray]:
    """Positions [k+1, 3] and axes [k+1, 3 axes, 3] (tangent and two normals) at the joints of a route."""
    positions, axes = np.zeros((len(course.length) + 1, 3)), np.zeros((len(course.length) + 1, 3, 3))
    axes[0] = np.eye(3)
    for i, (length, bend) in enumerate(zip(course.length, course.bend, strict=True)):
        step, turn = _along(np.array([length]), bend)
        positions[i + 1] = positions[i] + step[0] @ axes[i]
        axes[i + 1] = turn[0] @ axes[i]
    return positions, axes


def _along(s: Vector, bend: Vector) -> tuple[Points, np.ndarray]:
    """Return positions [n, 3] and axes [n, 3, 3] at arc lengths `s` of one arc, in the axes at its start."""
    kappa = float(np.linalg.norm(bend))
    way = bend / kappa if kappa > 0 else np.array([1.0, 0.0])
    angle = kappa * s
    forward = s * np.sinc(angle / np.pi)
    aside = 0.5 * kappa * s * s * np.sinc(0.5 * angle / np.pi) ** 2
    position = np.column_stack((forward, aside[:, None] * way))
    cos, sin = np.cos(angle), np.sin(angle)
    axes = np.empty((len(s), 3, 3))
    axes[:, 0] = np.column_stack((cos, sin[:, None] * way))
    for i in range(2):
        axes[:, i + 1, 0] = -sin * way[i]
        axes[:, i + 1, 1:] = np.eye(2)[i] + (cos - 1.0)[:, None] * way[i] * way
    return position, axes


def positions(course: Course, s: Vector) -> Points:
    """Return positions of a route at arc lengths `s` [n] [m]."""
    joints, axes = frames(course)
    begin = np.concatenate(([0.0], np.cumsum(course.length)))
    piece = np.clip(np.searchsorted(begin, s, side="right") - 1, 0, len(course.length) - 1)
    out = np.empty((len(s), 3))
    for i in np.unique(piece):
        here = piece == i
        out[here] = joints[i] + _along(s[here] - begin[i], course.bend[i])[0] @ axes[i]
    return out


def half_circle(length: float = 0.5) -> Course:
    """Half circle of the paper's section III-B."""
    return chain(np.array([length]), np.array([np.pi / length]))


def setup_a() -> Course:
    """Half circle, then a full loop, of the radii that the paper's Fig. 6 implies (docs/model.md)."""
    return chain(np.array([np.pi * 0.0847, 2 * np.pi * 0.0372]), 1.0 / np.array([0.0847, 0.0372]))


def setup_b() -> Course:
    """Full loop, then the half circle: setup A the other way round."""
    return _reversed(setup_a())


def setup_a_remedy() -> Course:
    """Return setup A behind the remedy of the paper, a loop of curvature 40/m at the proximal end."""
    a = setup_a()
    return Course(np.concatenate(([2 * np.pi / 40.0], a.length)), np.vstack(([40.0, 0.0], a.bend)))


def _reversed(course: Course) -> Course:
    return Course(course.length[::-1], course.bend[::-1])


def helix(radius: float, pitch: float, s: Vector) -> Points:
    """Return positions of a helix [m] at arc lengths `s` [m]; its curvature is r/(r² + c²), c = pitch/2π."""
    c = pitch / (2 * np.pi)
    angle = s / np.hypot(radius, c)
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), c * angle))


COLON_LENGTH = 1.3
_FLEXURES = (
    (0.16, 0.045, 15.0),
    (0.36, 0.05, 13.0),
    (0.58, 0.04, 16.0),
    (0.86, 0.045, 14.0),
    (1.12, 0.05, 12.0),
)


def colon(depth: float = COLON_LENGTH, outside: float = 0.0) -> Course:
    """Colon-like route: gentle curves between flexures, each in a bending plane of its own.

    Parameters
    ----------
    depth
        How far the route reaches in [m].
    outside
        Length of the gentle curve before the entrance [m].
    """
    edges = np.linspace(-outside, depth, _CELLS + 1)
    s = 0.5 * (edges[1:] + edges[:-1])
    kappa = np.full_like(s, 3.0)
    for centre, width, height in _FLEXURES:
        kappa += height * np.exp(-0.5 * ((s - centre) / (0.6 * width)) ** 2) * (s > -0.1)
    return chain(np.diff(edges), kappa, 1.2 * np.sin(5.0 * np.maximum(s, 0.0)))


@dataclass(frozen=True, slots=True)
class Sample:
    """A sample shape or recording with its truth, in SI."""

    name: str
    text: str
    """What it is, in a few words."""
    points: np.ndarray
    """Sensed points [n, 3], or [frames, n, 3] for a recording [m]."""
    noise: float
    """Standard deviation of each coordinate [m]."""
    total_length: float
    """True length, of the last frame for a recording [m]."""
    total_angle: float
    """True accumulated curve angle, of the last frame for a recording [rad]."""
    time: Vector | None = None
    """Time of each frame [s]."""
    tension_in: Vector | None = None
    """Proximal tension of each frame [N]."""


@dataclass(frozen=True, slots=True)
class Tube:
    """A lumen as a triangle mesh with normals towards the route."""

    name: str
    vertices: Points
    """[v, 3] [m]."""
    faces: np.ndarray
    """[f, 3]."""


def samples() -> tuple[Sample, ...]:
    """Return all sample shapes, the same at every call."""
    return (
        _sample("half_circle", "half circle of section III-B, exact points", half_circle(), 101, 0.0, 1),
        _sample("setup_a", "setup A of Fig. 2: half circle, then loop", setup_a(), 200, 2e-4, 2),
        _sample("setup_b", "setup B of Fig. 2: loop, then half circle", setup_b(), 200, 2e-4, 3),
        _sample("setup_a_remedy", "setup A behind a loop of 40/m (Fig. 7)", setup_a_remedy(), 260, 2e-4, 4),
        _helix_sample(),
        _sample("colon_fibre", "colon-like route as a shape-sensing fibre sees it", colon(), 200, 2e-4, 6),
        _sample("colon_markers", "the same route as 24 markers", colon(), 24, 5e-4, 7),
        _insertion(),
    )


def _sample(name: str, text: str, course: Course, n: int, noise: float, seed: int) -> Sample:
    points = positions(course, np.linspace(0.0, course.total_length, n))
    return Sample(name, text, _noisy(points, noise, seed), noise, course.total_length, course.total_angle)


def _noisy(points: np.ndarray, noise: float, seed: int) -> np.ndarray:
    return points + noise * np.random.default_rng(seed).standard_normal(points.shape)


def _helix_sample() -> Sample:
    radius, pitch = 0.03, 0.04
    per_turn = 2 * np.pi * np.hypot(radius, pitch / (2 * np.pi))
    length, kappa = 2.25 * per_turn, radius / (radius**2 + (pitch / (2 * np.pi)) ** 2)
    points = helix(radius, pitch, np.linspace(0.0, length, 150))
    text = "helix of radius 30 mm and pitch 40 mm"
    return Sample("helix", text, _noisy(points, 2e-4, 5), 2e-4, length, kappa * length)


def _insertion() -> Sample:
    """Endoscope of 1.2 m sliding into the colon in 20 s at 30 Hz, the tendon cycling between 0 and 15 N."""
    scope, time = 1.2, np.arange(600) / 30.0
    reach = 0.15 + 0.75 * (0.5 - 0.5 * np.cos(np.pi * time / time[-1]))
    way = colon(float(reach[-1]), scope - float(reach[0]))
    begin = reach - reach[0]
    s = begin[:, None] + np.linspace(0.0, scope, 60)
    points = positions(way, s.ravel()).reshape(*s.shape, 3)
    last = Course(way.length, way.bend * (np.cumsum(way.length) > begin[-1])[:, None])
    return Sample(
        name="insertion",
        text="insertion of an endoscope of 1.2 m, 20 s at 30 Hz, the tendon cycling between 0 and 15 N",
        points=_noisy(points, 3e-4, 8),
        noise=3e-4,
        total_length=scope,
        total_angle=last.total_angle,
        time=time,
        tension_in=15.0 * (1.0 - np.abs(1.0 - (time / 2.0) % 2.0)),
    )


def colon_lumen() -> Tube:
    """Lumen around the colon-like route, with haustra."""
    around, along = 24, 160
    course = colon()
    joints, axes = frames(course)
    pick = np.linspace(0, len(joints) - 1, along).round().astype(int)
    s = pick / len(joints) * course.total_length
    radius = 0.021 + 0.003 * np.sin(2 * np.pi * s / 0.035)
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.cos(turn)[:, None, None] * axes[pick, 1] + np.sin(turn)[:, None, None] * axes[pick, 2]
    vertices = (joints[pick] + radius[:, None] * ring).transpose(1, 0, 2).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij"))
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.vstack((np.column_stack((a, b, a + around)), np.column_stack((b, b + around, a + around))))
    return Tube("colon_lumen", vertices, faces[:, ::-1])


@lru_cache(maxsize=8)
def stated_points(given: GivenRoute) -> Points:
    """Return points on a route with the length, the angle and the bends that a rig states [n, 3] [m]."""
    if given.length_m is None or given.angle_rad is None:
        raise ShapeError("no points: give them, or [route] length_m and angle_rad in the rig")
    share = np.array(given.bends or (1.0,) * STATED.parts)
    part = np.full(len(share), given.length_m / len(share))
    bent = chain(
        part,
        given.angle_rad * share / share.sum() / part,
        STATED.turn * np.arange(len(share), dtype=np.float64),
    )
    return read_only(positions(bent, np.linspace(0.0, given.length_m, _POINTS)))
