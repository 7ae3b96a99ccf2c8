"""The march of a run through the core, done once where fits ask for it again.

Derivatives by what only sensors read leave the tendon as it was, and a stage of `discover` begins where the
one before ended.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector


def march_once(
    k: int,
    plant: Vector,
    memory: Vector,
    by_force: bool,
    spans: Vector,
    drive: Vector,
    warmth: Vector,
    parts: np.ndarray,
    rows: int,
) -> tuple[int, Vector, Matrix, Matrix]:
    """Return what `core.march` does, in arrays that refuse writes; arguments as there."""
    arrays = (plant, memory, spans, drive, warmth, parts)
    return _marched(k, by_force, rows, *(each.tobytes() for each in arrays))


@lru_cache(maxsize=512)  # measured: more than half of all equal ones in a campaign with laws
def _marched(k: int, by_force: bool, rows: int, *given: bytes) -> tuple[int, Vector, Matrix, Matrix]:
    plant, memory, spans, drive, warmth = (np.frombuffer(each) for each in given[:-1])
    parts = np.frombuffer(given[-1], dtype=np.int64)
    done, *arrays = core.march(k, plant, memory, by_force, spans, drive, warmth, parts, rows)
    for each in arrays:
        each.flags.writeable = False
    after, out, profile = arrays
    return done, after, out, profile
