"""Channels of a run beside each other: loss of tension, signs, when each turns, and readings at rest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.machines import angle_remarks, direction_remarks, load_sign_remarks, sign_remarks
from tssgeom.plausibility.rules import remark
from tssgeom.plausibility.series import DISPLACEMENTS, DRIVES, Series, apparent_friction, correlation, filled

_LINE = 0.12  # of a leg: the line by which a channel rises before it turns [1]; chosen for the noise
_LEVEL = 0.03  # of that rise: readings so near the greatest are at its level [1]; chosen
_DWELL = 0.25  # of a leg: a drive that stays at its turn for longer has no sharp one [1]; chosen
_TENSION_IN, _TENSION_OUT = "tension_in_N", "tension_out_N"


def motion_remarks(run: Series, *, fitted: bool) -> Iterator[Remark]:
    """Yield what is wrong between channels; `fitted` is true where the run is measured."""
    yield from _tension_ratio(run)
    yield from _signs(run)
    yield from sign_remarks(run)
    yield from load_sign_remarks([run])
    yield from direction_remarks(run)
    yield from angle_remarks(run)
    yield from _consistency(run)
    if fitted:
        yield from _rest(run)
        yield from _turning(run)
        yield from _lags(run)


def _tension_ratio(run: Series) -> Iterator[Remark]:
    """Compare both tensions where the drive pulls farther than ever before; docs/model.md (3)."""
    if not {_TENSION_IN, _TENSION_OUT} <= run.channels.keys():
        return
    there = np.isfinite(run.means[_TENSION_IN]) & np.isfinite(run.means[_TENSION_OUT])
    t_in, t_out = run.means[_TENSION_IN][there], run.means[_TENSION_OUT][there]
    if len(t_in) < LIMITS.repeated_rows or (t_in < 0.0).mean() > LIMITS.share_of_rows:
        return
    highest = np.maximum(np.maximum.accumulate(t_in), np.maximum.accumulate(t_out))
    span = max(run.span(_TENSION_IN), run.span(_TENSION_OUT))
    error = CHANCE.never * (run.error(_TENSION_IN) + run.error(_TENSION_OUT))
    pulled = (np.maximum(t_in, t_out) >= highest) & (highest > highest[0] + LIMITS.turn_share * span + error)
    if not pulled.any():
        return
    excess, allowed = t_out - t_in, LIMITS.slight * span + error
    above = excess > allowed
    if above[pulled].mean() > LIMITS.share_of_rows:
        at = int(np.flatnonzero(pulled)[np.argmax(excess[pulled])])
        reads = f"T_out is {t_out[at]:.3g} N where T_in is {t_in[at]:.3g} N and pulls"
        released = ~pulled & (np.arange(len(t_in)) > at)
        below = (excess < -allowed) & released
        if np.median(t_out[pulled] / np.maximum(t_in[pulled], 1e-12)) > LIMITS.gross:
            yield remark("tension_ratio", "run", reads)
        elif released.any() and below.sum() > LIMITS.share_of_rows * released.sum():
            yield remark("channels_exchanged", "run", reads)
        else:
            yield remark("tension_excess", "run", reads)
    elif run.angle:
        peak = int(np.flatnonzero(pulled)[np.argmax(t_in[pulled])])
        friction = apparent_friction(float(t_in[peak]), float(t_out[peak]), run.angle)
        if friction > LIMITS.largest_friction:
            reads = f"T_out is {t_out[peak]:.3g} N where T_in is {t_in[peak]:.3g} N, over {run.angle:.3g} rad"
            yield remark("apparent_friction", "run", reads)


def _signs(run: Series) -> Iterator[Remark]:
    """Compare the sign of displacements and elongation with that of a tension, or with each other."""
    against = next(
        (
            name
            for name in (_TENSION_IN, _TENSION_OUT, "displacement_in_m")
            if name in run.channels and run.moves(name)
        ),
        None,
    )
    if against is None:
        return
    for name in (*DISPLACEMENTS, "elongation_m"):
        if name == against or name not in run.channels or not run.moves(name):
            continue
        pulls = run.means[against]
        if np.nanmedian(pulls) < 0.0 and against.endswith("_N"):
            pulls = -pulls  # an inverted cell, which is a remark of its own
        together = correlation(pulls, run.means[name])
        if together < LIMITS.opposite:
            falls = f"{name} falls where {against} rises (correlation {together:.2f})"
            yield remark("sign", "run", falls)


def _consistency(run: Series) -> Iterator[Remark]:
    if not {"elongation_m", *DISPLACEMENTS} <= run.channels.keys():
        return
    stretch = run.means["elongation_m"]
    left = stretch - (run.means[DISPLACEMENTS[0]] - run.means[DISPLACEMENTS[1]])
    span = float(np.nanmax(stretch) - np.nanmin(stretch))
    error = sum(run.error(name) for name in ("elongation_m", *DISPLACEMENTS))
    off = float(np.nanstd(left)) if np.isfinite(left).any() else 0.0
    if off > LIMITS.usual_error * span + error:
        differ = (
            f"elongation_m and displacement_in_m less displacement_out_m differ by {1e3 * off:.2g} mm rms"
        )
        yield remark("inconsistent_stretch", "run", differ)


def _rest(run: Series) -> Iterator[Remark]:
    """Compare the first tensions with the pretension; a run may begin anywhere, so that this only warns."""
    if run.rig is None:
        return
    pretension = run.rig.tendon.pretension_N
    both = [name for name in (_TENSION_IN, _TENSION_OUT) if name in run.channels]
    span = max((run.span(name) for name in both if run.moves(name)), default=np.inf)
    for name in both:
        start = run.at_rest(name)
        allowed = LIMITS.usual_error * span + CHANCE.never * run.noise[name]
        if abs(start - pretension) > allowed:
            begins = f"{name} begins at {start:.3g} N and the pretension is {pretension:g} N"
            yield remark("zero_at_rest", "run", begins)


def _turning(run: Series) -> Iterator[Remark]:
    drive = next((name for name in DRIVES if name in run.channels), None)
    if drive is not None and len(run.edges) < 3:
        yield remark("drive_never_turns", "run", f"{run.drive} never goes back")


def _lags(run: Series) -> Iterator[Remark]:
    """Compare when channels turn with when the drive does."""
    if run.drive is None or len(run.edges) < 3:
        return
    time = filled(run.means["time_s"])
    leg = float(np.median(np.diff(time[run.edges])))
    least = max(LIMITS.lag_share * leg, LIMITS.lag_rows * float(np.median(np.diff(time))))
    for name in run.channels:
        if name == run.drive or name.startswith("temperature") or not run.moves(name):
            continue
        lags = [lag for k in range(1, len(run.edges) - 1) if (lag := _lag(run, name, time, k)) is not None]
        if not lags:
            continue
        typical, drift = float(np.median(lags)), lags[-1] - lags[0]
        same_way = np.mean(np.array(lags) * np.sign(typical) > 0.5 * least) > 1.0 - LIMITS.share_of_rows
        delay = f"{name} turns {abs(typical):.2g} s {'after' if typical > 0 else 'before'} {run.drive}"
        if len(lags) > 2 and abs(lags[-1]) > abs(lags[0]) and abs(drift) > 2.0 * least and _steady(lags):
            changes = f"{name} lags {run.drive} by {lags[0]:.2g} s at first and {lags[-1]:.2g} s at last"
            yield remark("two_clocks", "run", changes)
        elif abs(typical) > least and same_way:
            yield remark("lag", "run", delay)


def _steady(lags: list[float]) -> bool:
    """Whether lags grow evenly from turn to turn."""
    order = np.arange(len(lags), dtype=float)
    return abs(float(np.corrcoef(order, lags)[0, 1])) > 1.0 - _LEVEL


def _lag(run: Series, name: str, time: Vector, turn: int) -> float | None:
    """Return by how much a response stops to rise after the drive does [s]; None where it does not rise."""
    assert run.drive is not None
    begin, at, end = (int(edge) for edge in run.edges[turn - 1 : turn + 2])
    drive, response = filled(run.means[run.drive]), filled(run.means[name])
    way = 1.0 if drive[at] > drive[begin] else -1.0
    rows, near = max(int(_LINE * (at - begin)), 4), slice((begin + at) // 2, (at + end) // 2 + 1)
    of_drive = _end_of_rise(time, way * drive, near, rows, run.error(run.drive))
    of_response = _end_of_rise(time, way * response, near, rows, run.error(name))
    if of_drive is None or of_response is None or of_drive[1] > _DWELL * (time[at] - time[begin]):
        return None
    return of_response[0] - of_drive[0]


def _end_of_rise(
    time: Vector, values: Vector, near: slice, rows: int, error: float
) -> tuple[float, float] | None:
    """Return when the line by which values rise meets the level that they reach, and how long they stay [s].

    The level is that of the readings about the greatest; the line goes through as many `rows` before them.
    """
    top = near.start + int(np.argmax(values[near]))
    level, rise = values[top], values[top] - values[near.start]
    below = values < level - max(CHANCE.never * error, _LEVEL * rise)
    first = top - int(np.argmax(below[: top + 1][::-1])) + 1
    last = top + int(np.argmax(below[top : near.stop])) - 1 if below[top : near.stop].any() else near.stop - 1
    if first - rows < 0 or not below[: top + 1].any() or rise < CHANCE.never * error:
        return None
    when, height = time[first - rows : first], values[first - rows : first]
    slope, start = np.polyfit(when - when[0], height, 1)
    if slope * (when[-1] - when[0]) < CHANCE.never * error:
        return None
    level = float(np.median(values[first : last + 1])) if last - first > LIMITS.lag_rows else float(level)
    return float(when[0] + (level - start) / slope), float(time[last] - time[first])
