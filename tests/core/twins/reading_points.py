"""Points straight from their text in plain Python: what `core.read_points` has to return."""

from __future__ import annotations

import math

import numpy as np

_POWERS = np.array([10.0**i for i in range(23)])  # all exact
_EXACT = 1 << 53  # whole numbers up to here are exact in float64
_MOST = 9 * 10**17  # an int64 holds one digit more
_SPLIT = 134217729.0  # 2^27 + 1: cuts a number into halves whose products are exact
_TIE = 1.0 - 1e-6  # of half the last digit: above it, both neighbours are equally near
_SPACE, _TAB, _LINE, _RETURN = 32, 9, 10, 13
_COMMA, _MINUS, _PLUS, _DOT, _ZERO = 44, 45, 43, 46, 48
_OPEN, _CLOSE, _E, _SMALL_E = 91, 93, 69, 101
_NULL = np.array([110, 117, 108, 108], dtype=np.uint8)
_BAD = -1


def points_of(text: np.ndarray) -> np.ndarray:
    """Read `[[x,y,z],...]`, a row of NaN where a row is null; no row where the text is anything else."""
    out = np.empty((len(text) // 5 + 1, 3))  # the shortest row is a null and a comma
    none = out[:0]
    i = _past(text, _OPEN, _blank(text, 0))
    n = 0
    while i > 0:
        i = _null(text, i, out[n]) if text[i] == _NULL[0] else _row(text, i, out[n])
        if i < 0:
            return none
        n += 1
        i = _blank(text, i)
        if i < len(text) and text[i] == _CLOSE:
            return out[:n].copy() if _blank(text, i + 1) == len(text) else none
        i = _past(text, _COMMA, i)
    return none


def _blank(text: np.ndarray, i: int) -> int:
    """Return the index of the next character that is no white space."""
    while i < len(text) and (text[i] == _SPACE or text[i] in (_TAB, _LINE, _RETURN)):
        i += 1
    return i


def _past(text: np.ndarray, sign: int, i: int) -> int:
    """Go past a sign and white space to the next character; -1 where there is another, or an end."""
    if i >= len(text) or text[i] != sign:
        return _BAD
    i = _blank(text, i + 1)
    return i if i < len(text) else _BAD


def _null(text: np.ndarray, i: int, row: np.ndarray) -> int:
    """Read a null, which is a point that was not observed; return where it ends, or -1."""
    if len(text) < i + 4:
        return _BAD
    for c in range(4):
        if text[i + c] != _NULL[c]:
            return _BAD
    row[:] = math.nan
    return i + 4


def _row(text: np.ndarray, i: int, row: np.ndarray) -> int:
    """Read three numbers in brackets; return where they end, or -1."""
    for c in range(3):
        i = _past(text, _OPEN if c == 0 else _COMMA, i)
        if i < 0:
            return _BAD
        row[c], i = _number(text, i)
        if i < 0:
            return _BAD
        i = _blank(text, i)
    return i + 1 if i < len(text) and text[i] == _CLOSE else _BAD


def _number(text: np.ndarray, i: int) -> tuple[float, int]:
    """Read a number; return it and where it ends, or -1."""
    n = len(text)
    negative = text[i] == _MINUS
    i += 1 if negative else 0
    begin = i
    whole, i = _digits(text, i, 0)
    if i == begin or (text[begin] == _ZERO and i > begin + 1):
        return 0.0, _BAD
    behind = 0
    if i < n and text[i] == _DOT:
        begin = i + 1
        whole, i = _digits(text, begin, whole)
        behind = i - begin
        if behind == 0:
            return 0.0, _BAD
    if i < n and (text[i] == _E or text[i] == _SMALL_E):
        power, i = _exponent(text, i + 1)
        behind -= power
    if i < 0 or whole >= _MOST or not -len(_POWERS) < behind < len(_POWERS):
        return 0.0, _BAD
    value = _nearest(whole, behind)
    if math.isnan(value):
        return 0.0, _BAD
    return -value if negative else value, i


def _digits(text: np.ndarray, i: int, whole: int) -> tuple[int, int]:
    """Append digits to a whole number until it is too large; return it and where they end."""
    while i < len(text) and whole < _MOST:
        digit = int(text[i]) - _ZERO
        if digit < 0 or digit > 9:
            break
        whole = 10 * whole + digit
        i += 1
    return whole, i


def _exponent(text: np.ndarray, i: int) -> tuple[int, int]:
    """Read the exponent of a number; return it and where it ends, or -1."""
    negative = i < len(text) and text[i] == _MINUS
    if i < len(text) and (negative or text[i] == _PLUS):
        i += 1
    begin = i
    power, i = _digits(text, i, 0)
    return -power if negative else power, i if begin < i < begin + 4 else _BAD


def _nearest(whole: int, behind: int) -> float:
    """Return whole / 10^behind rounded to the nearest number; NaN where two are equally near."""
    if whole <= _EXACT:
        return whole / _POWERS[behind] if behind >= 0 else whole * _POWERS[-behind]
    if behind < 0:
        return math.nan
    power, head = _POWERS[behind], float(whole)
    tail = float(whole - int(head))
    share = head / power
    product, error = _product(share, power)
    more = (((head - product) - error) + tail) / power
    value = share + more
    left = (share - value) + more
    mantissa, exponent = math.frexp(value)
    if mantissa == 0.5 or abs(left) > _TIE * math.ldexp(1.0, exponent - 54):
        return math.nan
    return value


def _product(a: float, b: float) -> tuple[float, float]:
    """Return a product and its rounding error, exactly (Dekker)."""
    high, other = _SPLIT * a, _SPLIT * b
    a1, b1 = high - (high - a), other - (other - b)
    a2, b2 = a - a1, b - b1
    product = a * b
    return product, a2 * b2 - (((product - a1 * b1) - a2 * b1) - a1 * b2)
