"""Where along a sheath friction is greater or less than elsewhere, in words; docs/model.md (337)."""

from __future__ import annotations

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.identify.finding import LawCurve

_POINTS = 401  # on which stretches begin and end; chosen: a quarter per cent of the length
_HALF = 0.5  # of how far friction goes from its usual value: where a stretch ends [1]; chosen


def uneven_words(law: LawCurve) -> str:
    """Say where friction over the arc length is greatest and least, by how much; docs/model.md (337).

    What the band of the law does not part from the usual friction has no words; nor has a law whose usual
    friction is none.
    """
    s = np.linspace(float(law.x[0]), float(law.x[-1]), _POINTS)
    value, low, high = (np.interp(s, law.x, each) for each in (law.value, law.low, law.high))
    usual = float(np.median(value))
    if usual <= 0.0:
        return ""
    greater = _stretch(value / usual - 1.0, low > usual)
    less = _stretch(1.0 - value / usual, high < usual)
    words = [_words(s, value / usual, part) for part in (greater, less) if part is not None]
    return " and ".join(words)


def _stretch(beyond: Vector, apart: np.ndarray) -> slice | None:
    """Return the stretch about the greatest of what the band parts, as far as it is half of that."""
    peak = int(np.argmax(np.where(apart, beyond, -np.inf)))
    if not apart[peak] or beyond[peak] <= 0.0:
        return None
    inside = beyond >= _HALF * beyond[peak]
    before, behind = np.flatnonzero(~inside[:peak]), np.flatnonzero(~inside[peak:])
    first = int(before[-1]) + 1 if len(before) else 0
    last = peak + int(behind[0]) if len(behind) else len(beyond)
    return slice(first, last)


def _words(s: Vector, ratio: Vector, part: slice) -> str:
    own = ratio[part]
    most = float(own[np.argmax(np.abs(own - 1.0))])
    start, end = 1e3 * float(s[part][0]), 1e3 * float(s[part][-1])
    return f"{most:.2g} times as great between {start:.0f} and {end:.0f} mm"
