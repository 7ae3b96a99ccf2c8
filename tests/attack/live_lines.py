"""Frames that hurt: hard to fit, far from the truth, of a strange time, or no frames at all."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

import numpy as np

from tests.attack.live_target import Target
from tests.live_process import line, malformed, points_mm

_T = 50.0  # s, of a frame by its own clock


def _walk(count: int) -> np.ndarray:
    return np.cumsum(5.0 * np.random.default_rng(count).standard_normal((count, 3)), axis=0)


def helix(count: int, turns: float) -> np.ndarray:
    turn = np.linspace(0.0, 2.0 * np.pi * turns, count)
    return np.column_stack((10.0 * np.cos(turn), 10.0 * np.sin(turn), 0.2 * turn))


def _zigzag(count: int) -> np.ndarray:
    k = np.arange(count)
    return np.column_stack((k, 10.0 * (k % 2), 0.0 * k))


def _ball(count: int) -> np.ndarray:
    return 100.0 * np.random.default_rng(count).standard_normal((count, 3))


def _there_and_back(count: int) -> np.ndarray:
    k = np.arange(count)
    return np.column_stack((np.minimum(k, count - k), 0.0 * k, 0.0 * k)).astype(float)


KINDS: dict[str, Callable[[int], np.ndarray]] = {
    "random walk": _walk,
    "helix of 20 turns": lambda count: helix(count, 20.0),
    "helix of 200 turns": lambda count: helix(count, 200.0),
    "ball": _ball,
    "zigzag": _zigzag,
}
"""Points [mm] that are hard to fit, by their number."""
HARD: dict[str, Callable[[], np.ndarray]] = {
    "random walk of 500 points": lambda: _walk(500),
    "random walk of 1000 points": lambda: _walk(1000),
    "random walk of 3000 points": lambda: _walk(3000),
    "helix of 200 turns, 1000 points": lambda: helix(1000, 200.0),
    "helix of 200 turns, 10 000 points": lambda: helix(10_000, 200.0),
    "helix of 20 turns": lambda: helix(400, 20.0),
    "10 000 noisy points": lambda: points_mm(10_000, 0.0),
    "10 000 points of a walk": lambda: _walk(10_000),
    "ball of 1000 points": lambda: _ball(1000),
    "ball of 10 000 points": lambda: _ball(10_000),
    "zigzag": lambda: _zigzag(500),
    "there and back": lambda: _there_and_back(101),
    "one place": lambda: np.ones((200, 3)),
    "a straight line": lambda: np.outer(np.arange(300.0), [1.0, 0.0, 0.0]),
    "three points": lambda: points_mm(3, 0.0),
    "no coordinate but zero": lambda: np.zeros((50, 3)),
    "kilometres": lambda: 1e9 * points_mm(60, 0.0),
    "less than an atom": lambda: 1e-9 * points_mm(60, 0.0),
    "one point far away": lambda: np.vstack((points_mm(60, 0.0), [1e12, 0.0, 0.0])),
    "10 001 points": lambda: points_mm(10_001, 0.0),
}
"""Points [mm] of frames that are hard to fit."""
_FIELDS: dict[str, dict[str, object]] = {
    "time 1.7e18": {"t": 1.7e18},
    "time 1e13": {"t": 1e13},
    "time 1e300": {"t": 1e300},
    "time -1e18": {"t": -1e18},
    "time text": {"t": "50"},
    "tension 1e9": {"tension_in_N": 1e9},
    "tension 1e300": {"tension_in_N": 1e300},
    "tension -1": {"tension_in_N": -1.0},
    "position of 1 km": {"displacement_in_m": 1000.0},
    "position -1 m": {"displacement_in_m": -1.0},
    "target out of reach": {"displacement_target_m": 50.0},
    "two targets": {"displacement_target_m": 1e-3, "tension_out_target_N": 2.0},
    "tension target 1e9": {"tension_out_target_N": 1e9},
    "noise 0": {"noise_m": 0.0},
    "noise of 1 km": {"noise_m": 1000.0},
    "temperature -1e9": {"temperature_C": -1e9},
    "length -1": {"length_m": -1.0},
    "stations back": {"s": list(range(60, 0, -1))},
    "stations of another count": {"s": [0, 1, 2]},
    "directions of zero": {"directions": [[0, 0, 0]] * 60},
    "id of 1000 characters": {"id": "x" * 1000},
    "id with control characters": {"id": "\x1b[31m\x07\x00"},
    "id of a surrogate": {"id": "\ud800"},
    "an unknown key": {"tensionIn": 3.0},
    "unit of furlongs": {"unit": "furlong"},
}
_TEXTS = {
    "a byte order mark": b"\xef\xbb\xbf{}",
    "NUL bytes": b"\0" * 1000,
    "Latin-1": '{"t": 1, "unit": "µm"}'.encode("latin-1"),
    "a million brackets less": b"[" * 900_000,
    "a repeated key": b'{"t": 1, "t": 2, "unit": "mm", "points": [[0,0,0]]}',
    "10 000 times an empty line": b"\n" * 10_000 + b"{}",
    "half a frame": points_mm(60, 0.0).tobytes()[:200].replace(b"\n", b" "),
}


def lines() -> Iterator[tuple[str, bytes]]:
    """Yield the text of each hostile frame, with its name."""
    yield from malformed()
    for name, points in HARD.items():
        yield name, line(points(), _T, id=name)
    for name, fields in _FIELDS.items():
        yield name, json.dumps(json.loads(line(points_mm(60, 0.0), _T, id=name)) | fields).encode()
    yield from _TEXTS.items()


def sent(target: Target, name: str, text: bytes) -> bool:
    """Send a frame as another client; return whether the stream says what became of it."""
    begin = len(target.lines)
    with target.stream.source() as other:
        other.sendall(text.rstrip() + b"\n")
        return target.reaction(lambda one: "rejected" in one or one.get("id") == name or _strange(one), begin)


def _strange(answer: dict) -> bool:
    """Whether it is the answer to a frame of another client whose id was changed."""
    return "segments" in answer and not str(answer.get("id", "")).startswith("good")
