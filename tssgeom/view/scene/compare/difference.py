"""By how much one recording differs from another, in numbers and in words."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.statistics import NORMAL_95
from tssgeom.view.quantities import CHANNELS
from tssgeom.view.scene.compare.reading import Side
from tssgeom.view.wording import angle_with_error, with_error

COMPARED = ("tension_in_N", "tension_out_N", "elongation_m")
"""What is compared over time."""
_STEPS = 200  # of arc length in which two tensions are compared


@dataclass(frozen=True, slots=True)
class Difference:
    """B less A over their common time."""

    time: Vector
    """[s]."""
    values: Mapping[str, Vector]
    """Of each of `COMPARED` [SI]."""

    def rms(self, name: str) -> float:
        """Root mean square over time [SI]."""
        return float(np.sqrt(_mean(self.time, self.values[name] ** 2)))

    def most(self, name: str) -> tuple[float, float]:
        """Return the largest difference with its sign [SI], and when it is [s]."""
        row = int(np.argmax(np.abs(self.values[name])))
        return float(self.values[name][row]), float(self.time[row])


def _mean(time: Vector, values: Vector) -> float:
    span = float(time[-1] - time[0])
    return float(np.trapezoid(values, time)) / span if span > 0 else float(values.mean())


def aligned(a: Side, b: Side) -> tuple[Side, Side]:
    """Return both on one time: unchanged where their spans overlap, else each from its own beginning."""
    if a.time is None or b.time is None or _overlap(a.time, b.time) is not None:
        return a, b
    return a.begun_at_zero(), b.begun_at_zero()


def _overlap(a: Vector, b: Vector) -> tuple[float, float] | None:
    begin, end = max(float(a[0]), float(b[0])), min(float(a[-1]), float(b[-1]))
    return (begin, end) if end > begin else None


def difference(a: Side, b: Side) -> Difference | None:
    """Return B less A at every time of either; None where they have no common time."""
    if a.time is None or b.time is None:
        return None
    common = _overlap(a.time, b.time)
    if common is None:
        return None
    time = np.union1d(a.time, b.time)
    time = time[(time >= common[0]) & (time <= common[1])]
    values = {
        name: np.interp(time, b.time, b.numbers[name]) - np.interp(time, a.time, a.numbers[name])
        for name in COMPARED
    }
    return Difference(time, values)


def parting(a: Side, b: Side) -> float | None:
    """Return the arc length from which on the tensions differ, each at its greatest pull [m].

    None where they do not differ, or differ from the proximal end on.
    """
    ends = a.frames[a.peak], b.frames[b.peak]
    s = np.linspace(0.0, min(float(frame.s[-1]) for frame in ends), _STEPS)
    first, second = (frame.tension_at(s) for frame in ends)
    differ = np.abs(second - first) > PLAUSIBLE.negligible * max(
        float(first.max()), float(second.max()), 1e-12
    )
    node = int(np.argmax(differ))
    return float(s[node]) if node > 0 else None


def comparison(a: Side, b: Side, change: Difference | None) -> str:
    """Describe how B differs from A, as markdown: the route, the greatest pull, and over time."""
    parts = [
        f"**A** is {_name(a)}, **B** is {_name(b)}.",
        _route_words(a, b),
        _peak_words(a, b),
        "" if change is None else _time_words(change),
    ]
    return _with_minus("\n\n".join(part for part in parts if part))


def _name(side: Side) -> str:
    kept = len(side.frames)
    frames = f"{kept} frames" if kept == side.count else f"{kept} of its {side.count} frames"
    kind = "a shape" if side.time is None else frames
    return f"{side.name} ({kind}" + (f"; time from its beginning, {side.since:.2f} s)" if side.since else ")")


def _route_words(a: Side, b: Side) -> str:
    turn, error = _change(a, b, "total_angle_rad", "total_angle_se_rad")
    longer = 1e3 * (_at_peak(b, "length_m") - _at_peak(a, "length_m"))
    more = "more" if turn >= 0 else "less"
    length = f"{abs(longer):.1f} mm {'longer' if longer > 0 else 'shorter'}"
    length = "as long" if round(longer, 1) == 0.0 else length  # in the digits above
    if abs(turn) <= NORMAL_95 * error or turn == 0.0:
        return f"The routes turn alike: Φ differs by {_degrees(turn)}, within its error. B is {length}."
    return f"The route of B turns **{angle_with_error(abs(turn), error)} {more}** and is {length}."


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.1f}°"


def _peak_words(a: Side, b: Side) -> str:
    pull = _at_peak(b, "tension_in_N") - _at_peak(a, "tension_in_N")
    out, error = _change(a, b, "tension_out_N", "tension_out_se_N")
    before = _at_peak(a, "tension_out_N")
    share = f", {100 * out / before:+.0f} %" if before > 0 else ""
    stretch, stretch_error = _change(a, b, "elongation_m", "elongation_se_m")
    same = (
        "the same T_in"
        if round(pull, 2) == 0.0
        else f"{abs(pull):.2f} N {'more' if pull > 0 else 'less'} T_in"
    )
    s = parting(a, b)
    late = s is not None and s > PLAUSIBLE.slight * _at_peak(a, "length_m")
    where = f" The tensions differ from s = {1e3 * s:.0f} mm on." if s and late else ""
    return (
        f"At the greatest pull, with {same}, T_out of B less that of A is "
        f"**{with_error(out, error, 2, '+')} N** ({before:.2f} to {before + out:.2f} N{share}), and δ of B "
        f"less that of A is **{with_error(1e3 * stretch, 1e3 * stretch_error, 3, '+')} mm**.{where}"
    )


def _time_words(change: Difference) -> str:
    changes = []
    for name in ("tension_out_N", "elongation_m"):
        channel, (most, when) = CHANNELS[name], change.most(name)
        changes.append(
            f"{channel.symbol} differs by {channel.factor * change.rms(name):.3g} {channel.unit} rms, "
            f"at most by {channel.factor * most:+.3g} {channel.unit} at {when:.2f} s"
        )
    drives = change.rms("tension_in_N")
    drive = (
        "the drives are the same"
        if round(drives, 2) == 0.0
        else f"but the drives differ by {drives:.3g} N rms too"
    )
    span = f"{change.time[0]:.2f} to {change.time[-1]:.2f} s"
    return f"From {span}, {'; '.join(changes)}; {drive}."


def _at_peak(side: Side, name: str) -> float:
    return float(side.numbers[name][side.peak])


def _change(a: Side, b: Side, name: str, error: str) -> tuple[float, float]:
    """Return B less A at the greatest pull of each, and its standard error."""
    return _at_peak(b, name) - _at_peak(a, name), math.hypot(_at_peak(a, error), _at_peak(b, error))


_ROWS = (
    ("L [mm]", "length_m", 1e3, 1),
    ("Φ [°]", "total_angle_rad", math.degrees(1.0), 1),
    ("T_in [N]", "tension_in_N", 1.0, 2),
    ("T_out [N]", "tension_out_N", 1.0, 2),
    ("δ [mm]", "elongation_m", 1e3, 3),
)


def table(a: Side, b: Side) -> str:
    """Set the numbers of both at the greatest pull of each side by side, as markdown."""
    rows = _moments(a, b)
    for title, name, factor, digits in _ROWS:
        first, second = factor * _at_peak(a, name), factor * _at_peak(b, name)
        cells = (f"{first:.{digits}f}", f"{second:.{digits}f}", f"{second - first:+z.{digits}f}")
        rows.append(f"| {title} | {' | '.join(cells)} |")
    counts = [len(side.pieces[side.peak].length) for side in (a, b)]
    change = counts[1] - counts[0]
    rows.append(f"| pieces | {counts[0]} | {counts[1]} | {f'{change:+d}' if change else '0'} |")
    return "\n".join(["| | A | B | B − A |", "|---|--:|--:|--:|", *map(_with_minus, rows)])


def _with_minus(text: str) -> str:
    """Write negative numbers with a minus, as wide as a plus, and no sign before a zero."""
    return re.sub(r"(?<![\w-])-(?=\d)", "−", re.sub(r"\+(0(?:\.0+)?)(?= )", r"\1", text))


def _moments(a: Side, b: Side) -> list[str]:
    """Write when the greatest pull of each is; no row for two shapes."""
    times = [math.nan if side.time is None else float(side.time[side.peak]) for side in (a, b)]
    if all(map(math.isnan, times)):
        return []
    cells = (f"{times[0]:.2f}", f"{times[1]:.2f}", f"{times[1] - times[0]:+z.2f}")
    return [f"| time [s] | {' | '.join(cells).replace('+nan', '–').replace('nan', '–')} |"]
