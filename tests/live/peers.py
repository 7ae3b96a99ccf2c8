"""Frames that tests send, and a reader that misses none of them."""

import json
from itertools import count

import numpy as np

from tests.live_process import PATIENCE, Live, Reader, line, points_mm

_marks = count()


def synchronised(stream: Live, reader: Reader) -> None:
    """Send frames until the reader gets the answer to one: then it gets all later answers too."""
    replies = None
    while replies is None:
        mark = f"mark {next(_marks)}"
        with stream.source() as sock:
            sock.sendall(frame(0.0, id=mark))
            reader.sock.settimeout(2.0)
            try:
                replies = reader.until("id", mark)
            except TimeoutError:
                continue
    reader.sock.settimeout(PATIENCE)


def frame(time: float, n: int = 30, **more: object) -> bytes:
    return line(points_mm(n, 0.0), time, **more)


def next_answer(stream: Live) -> dict:
    """Read standard output up to the next line that belongs to a frame: a busy machine may be late."""
    while (answer := json.loads(stream.output.readline())).get("stale"):
        pass
    return answer


def half_circle(n: int = 40) -> np.ndarray:
    """Points on a half circle of 0.5 m [mm]."""
    turn = np.linspace(0.0, np.pi, n)
    return 500.0 / np.pi * np.column_stack((np.sin(turn), 1 - np.cos(turn), 0 * turn))
