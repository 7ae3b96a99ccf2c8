"""Routes of a sheath in space, of pieces in planes of their own, and points sensed on them."""

from dataclasses import dataclass

import numpy as np

from tests.lumped import Path, from_pieces

CELLS = 120


@dataclass(frozen=True, slots=True)
class Route:
    """Pieces of constant curvature, proximal to distal, with a common tangent where they meet."""

    name: str
    lengths: np.ndarray
    """[k] m."""
    angles: np.ndarray
    """[k] Turn of each piece [rad], 0 for a straight one."""
    planes: np.ndarray
    """[k] Direction of bending about the tangent, in the frame that goes along without twist [rad]."""


def half_circle(length: float, rng: np.random.Generator) -> Route:
    return Route("half circle", np.array([length]), np.array([np.pi]), rng.uniform(0.0, 6.28, 1))


def half_and_loop(length: float, rng: np.random.Generator) -> Route:
    """Setup A of the paper: a half circle of 84.7 mm, then a loop of 37.2 mm, scaled to the length."""
    share = np.array([84.7, 2 * 37.2]) / (84.7 + 2 * 37.2)
    plane = rng.uniform(0.0, 6.28)
    return Route(
        "half and loop", share * length, np.array([1.0, 2.0]) * np.pi, np.array([plane, plane + 0.4])
    )


def chain(length: float, rng: np.random.Generator) -> Route:
    """Four to six pieces, one of them straight, in planes that differ by a radian and more."""
    count = int(rng.integers(4, 7))
    lengths = rng.uniform(0.6, 1.6, count)
    angles = rng.uniform(0.5, 2.0, count)
    angles[rng.integers(0, count)] = 0.0
    planes = np.cumsum(rng.uniform(1.0, 2.2, count))
    return Route("chain", lengths * length / lengths.sum(), angles, planes)


def path(route: Route, times: np.ndarray, sway_rad: float) -> Path:
    """Return the route for the simulator; with a sway, its widest turn swings by that twice a run."""
    if sway_rad == 0.0:
        return from_pieces(route.lengths, route.angles, CELLS)
    frames = np.linspace(times[0], times[-1], 81)
    angles = np.tile(route.angles, (len(frames), 1))
    widest = int(np.argmax(route.angles))
    angles[:, widest] += sway_rad * np.sin(4 * np.pi * (frames - frames[0]) / (frames[-1] - frames[0]))
    return from_pieces(route.lengths, angles, CELLS, frames)


def positions(route: Route, stations: np.ndarray, angle_gain: float) -> np.ndarray:
    """Return the points [n, 3] [m] at stations [m], all turns sensed `angle_gain` times as wide."""
    edges = np.concatenate(([0.0], np.cumsum(route.lengths)))
    which = np.clip(np.searchsorted(edges, stations, side="right") - 1, 0, len(route.lengths) - 1)
    origin, frame = np.zeros(3), np.eye(3)  # rows: tangent and two normals
    points = np.empty((len(stations), 3))
    for k, (length, angle, plane) in enumerate(
        zip(route.lengths, angle_gain * route.angles, route.planes, strict=True)
    ):
        way = np.cos(plane) * frame[1] + np.sin(plane) * frame[2]
        inside = which == k
        points[inside] = origin + _along(stations[inside] - edges[k], angle / length, frame[0], way)
        origin = origin + _along(np.array([length]), angle / length, frame[0], way)[0]
        frame = frame @ _turn(np.cross(frame[0], way), angle)
    return points


def _along(s: np.ndarray, curvature: float, tangent: np.ndarray, way: np.ndarray) -> np.ndarray:
    """[n, 3] Steps from the start of an arc to its points at s [m]."""
    turn = curvature * s[:, None]
    half = np.sinc(0.5 * turn / np.pi)
    return s[:, None] * (np.sinc(turn / np.pi) * tangent + 0.5 * turn * half * half * way)


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Matrix that turns row vectors about a unit axis."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return (np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross).T
