"""Text of the pictures: labels, the summary and the table of pieces, with numbers and their errors."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.route.pieces import Arcs
from tssgeom.stream import FrameResult
from tssgeom.view.samples import RouteSamples

_STRAIGHT_RADIUS = 100.0
"""A piece of a larger radius than this is called nearly straight [m]."""


def decimals(error: float, usual: int) -> int:
    """Return the number of decimals of a value: so many that its standard error shows two digits.

    The `usual` number where the error is unknown, or below two decimals beyond them.
    """
    if not 10.0 ** -(usual + 2) <= error < math.inf:
        return usual
    return max(1 - math.floor(math.log10(error)), 0)


def plus_minus(error: float, usual: int) -> str:
    """Write "± 0.0041", with the decimals of its value, or a bound of it where it is far below them."""
    if 10.0 ** -(usual + 2) <= error < math.inf:
        return f"± {error:.{decimals(error, usual)}f}"
    if 0.0 < error < 10.0 ** -(usual + 2):
        return f"± < {10.0 ** -(usual + 1):g}"
    return f"± {error:.1g}"


def with_error(value: float, error: float, usual: int, sign: str = "") -> str:
    """Write a value and its standard error, "2.5512 ± 0.0041"; `sign` "+" writes that of the value too."""
    return f"{value:{sign}.{decimals(error, usual)}f} {plus_minus(error, usual)}"


def angle_with_error(angle: float, error: float) -> str:
    """Write an angle and its standard error [rad] in degrees."""
    value, half_width = with_error(math.degrees(angle), math.degrees(error), 1).split(" ± ")
    return f"{value}° ± {half_width}°"


def degrees(angle: float) -> str:
    """Write an angle [rad] in degrees, with one digit where it is small."""
    value = math.degrees(angle)
    return f"{value:.0f}°" if value >= 100 else f"{value:.1f}°"


def radius(kappa: float) -> str:
    """Write the radius of a curvature [1/m], "straight" where it is zero, "nearly straight" below 0.01."""
    if kappa == 0.0:
        return "straight"
    if kappa * _STRAIGHT_RADIUS < 1:
        return "nearly straight"
    return f"r {1e3 / kappa:.1f} mm" if kappa > 1 else f"r {1 / kappa:.2f} m"


def piece_labels(arcs: Arcs) -> list[str]:
    """One label for each piece: "2 · 45.0° · r 84.7 mm"."""
    pairs = zip(arcs.angle, arcs.kappa, strict=True)
    return [_piece_label(number, angle, kappa) for number, (angle, kappa) in enumerate(pairs, start=1)]


def _piece_label(number: int, angle: float, kappa: float) -> str:
    if kappa * _STRAIGHT_RADIUS < 1:
        return f"{number} · {radius(kappa)}"
    return f"{number} · {degrees(angle)} · {radius(kappa)}"


def end_labels(tension_in: float, tension_out: float) -> list[str]:
    """Labels of the proximal and the distal end, each with its tension [N]."""
    return [f"proximal · T_in {tension_in:.2f} N", f"distal · T_out {tension_out:.2f} N"]


def summary(name: str, result: FrameResult, timed: bool) -> str:
    """Describe a frame in words, as markdown: the route, the tendon, and warnings."""
    heading = f"### {name}" + (f" at {result.frame.time:.2f} s" if timed else "")
    warnings = "\n".join(f"- ⚠ {warning}" for warning in result.warnings)
    return "\n\n".join(part for part in (heading, *sentences(result), warnings) if part)


def sentences(result: FrameResult) -> tuple[str, str]:
    """Describe the route in one paragraph and the tendon in another, as markdown."""
    return _route_words(result), _tension_words(result)


def _route_words(result: FrameResult) -> str:
    profile, arcs = result.profile, result.arcs
    pieces = "one piece" if len(arcs.length) == 1 else f"{len(arcs.length)} pieces"
    return (
        f"The route is **L = {1e3 * arcs.total_length:.1f} mm** long and turns through "
        f"**Φ = {angle_with_error(arcs.total_angle, arcs.total_angle_se)}** in all: "
        f"{pieces} of constant curvature (method: {arcs.method}; sensor noise {noise(result)} mm; "
        f"{_sharpest(float(profile.kappa.max()))})."
    )


def _sharpest(kappa: float) -> str:
    return "no bend" if kappa * _STRAIGHT_RADIUS < 1 else f"sharpest bend {radius(kappa)}"


def noise(result: FrameResult) -> str:
    """Write the noise of a coordinate of the sensed points, without its unit [mm]."""
    value = 1e3 * result.sensed_noise
    return f"{value:.3g}" if value >= 1e-3 else "< 0.001"


def _tension_words(result: FrameResult) -> str:
    ends = result.transmission
    verb = "Pulled" if ends.direction_index > 0 else "Released"
    share = f" ({100 * ends.tension_out / ends.tension_in:.0f} %)" if ends.tension_in > 0 else ""
    return (
        f"{verb} to **T_in = {ends.tension_in:.2f} N**, the distal end feels "
        f"**T_out = {with_error(ends.tension_out, ends.tension_out_se, 2)} N**{share} and the tendon is "
        f"stretched by **δ = {with_error(1e3 * ends.elongation, 1e3 * ends.elongation_se, 3)} mm**. "
        + _dead_zone_words(result)
        + _machine_words(result)
    )


def _machine_words(result: FrameResult) -> str:
    """State that pictures show tendon 1 of a machine, and what its other channels read."""
    if result.machine is None:
        return ""
    from tssgeom.view.quantities import CHANNELS, quantity  # imports Matplotlib, for its colours

    others = {
        name: value
        for name, value in result.machine.channels.items()
        if name not in CHANNELS and "_1_" not in name
    }
    read = [
        f"{of.symbol} = {of.factor * value:.1f} {of.unit}"
        for of, value in ((quantity(name), value) for name, value in others.items())
    ]
    return f" This is tendon 1 of the machine; its other channels: {', '.join(read)}."


def _dead_zone_words(result: FrameResult) -> str:
    ends = result.transmission
    if not ends.dead_zone:
        return "Every change of T_in now reaches the distal end."
    change = "rise" if ends.direction_index > 0 else "fall"
    return f"Dead zone: T_in has to {change} by another {ends.dead_zone_width:.2f} N before T_out answers."


def piece_table(arcs: Arcs, frame: RouteSamples) -> str:
    """Table of the pieces as markdown: arc length, length, angle, radius and tension at the distal side."""
    ends = np.append(arcs.s_start[1:], arcs.total_length)
    rows = zip(arcs.s_start, arcs.length, arcs.angle, arcs.kappa, frame.tension_at(ends), strict=True)
    lines = [_table_row(number, *row) for number, row in enumerate(rows, start=1)]
    head = "| piece | from [mm] | length [mm] | angle [°] | radius | T after it [N] |"
    return "\n".join([head, "|--:|--:|--:|--:|--:|--:|", *lines])


def _table_row(number: int, start: float, length: float, angle: float, kappa: float, tension: float) -> str:
    return (
        f"| {number} | {1e3 * start:.1f} | {1e3 * length:.1f} | {math.degrees(angle):.1f} "
        f"| {radius(kappa).removeprefix('r ')} | {tension:.2f} |"
    )
