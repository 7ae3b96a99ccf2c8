"""Frames of an endoscope that moves, as lines of JSON, and lines that are none."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np

from benchmarks.routes import PIECEWISE, of_arcs, truth
from tssgeom.route.synthetic import Course

_SWAY = 0.02  # of all curvatures, to both sides
_PERIOD, _PULLS = 2.0, 3.0  # s of the route and of the tension
_DIGITS = 4  # after the point, in mm

_WRONG = {
    "truncated JSON": b'{"t": 1.0, "unit": "mm", "points": [[1,2,3],[4,5',
    "NaN": b'{"t": 1.0, "unit": "mm", "points": [[NaN,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "too large a number": b'{"t": 1.0, "unit": "mm", "points": [[1e999,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "infinite time": b'{"t": 1e999, "unit": "mm", "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "wrong unit": b'{"t": 1.0, "unit": "inch", "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "no unit": b'{"t": 1.0, "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "no time": b'{"unit": "mm", "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "no points": b'{"t": 1.0, "unit": "mm", "points": []}',
    "ragged points": b'{"t": 1.0, "unit": "mm", "points": [[1,2,3],[4,5],[7,8,9],[1,1,1]]}',
    "text for a number": b'{"t": "now", "unit": "mm", "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "negative tension": None,
    "deep nesting": b'{"t": 1.0, "unit": "mm", "x": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    "binary noise": np.random.default_rng(0).bytes(400).replace(b"\n", b" "),
    "no object": b"[1, 2, 3]",
    "too many points": b'{"t": 1.0, "unit": "m", "points": [' + b"[0,0,0]," * 60_000 + b"[1,1,1]]}",
}


def points_mm(n: int, time: float, seed: int = 0, noise: float = 5e-4) -> np.ndarray:
    """Noisy points [n, 3] of seven pieces that sway [mm]; `noise` of each coordinate [m]."""
    course = truth(PIECEWISE[-1], np.random.default_rng(0)).course
    assert course is not None
    sway = 1.0 + _SWAY * np.sin(2 * np.pi * time / _PERIOD)
    route = of_arcs(Course(course.length, sway * course.bend), piecewise=True)
    places = route.place(np.linspace(0.0, course.total_length, n))
    return 1e3 * (places + noise * np.random.default_rng(seed).standard_normal((n, 3)))


def line(points: np.ndarray, time: float, **more: object) -> bytes:
    """Write one frame, with the tension of a slow pull and release unless `more` brings a drive."""
    pull = round(8.0 + 6.0 * float(np.sin(2 * np.pi * time / _PULLS)), 4)
    told = {"t": round(time, 6), "points": np.round(points, _DIGITS).tolist(), "unit": "mm"}
    told |= {"tension_in_N": pull} | more
    return json.dumps(told, separators=(",", ":")).encode() + b"\n"


def lines(n: int, count: int, rate: float) -> list[bytes]:
    """Frames at a rate [Hz], the first at time 0."""
    return [line(points_mm(n, i / rate, i), i / rate) for i in range(count)]


def retimed(text: bytes, time: float) -> bytes:
    """Return a frame of `line` with another time [s]."""
    return b'{"t":%.6f,' % time + text.partition(b",")[2]


def malformed() -> Iterator[tuple[str, bytes]]:
    """Yield each kind of bad line with its name."""
    good = line(points_mm(30, 0.0), 1.0, tension_in_N=-3.0)
    for name, text in _WRONG.items():
        yield name, (good.rstrip() if text is None else text)
