"""Rows and digits of a run: ends of scales, values that stand still, rows that repeat, and the clock."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.rules import remark
from tssgeom.plausibility.series import Series, filled
from tssgeom.rig import Sensor

_MUST_MOVE = ("tension_in_N", "tension_out_N", "displacement_in_m", "elongation_m")
"""Channels that a drive moves, whatever the load; the distal end may be blocked."""


def digit_remarks(run: Series, *, fitted: bool) -> Iterator[Remark]:
    """Yield faults of rows by recorders and connections; `fitted` is true where the run is measured."""
    yield from clock_remarks(run)
    if not fitted:
        return
    for name in run.channels:
        if name.startswith("temperature"):
            continue
        yield from _clipped(run, name)
        yield from _still(run, name)
        yield from _spikes(run, name)
    yield from _copies(run)
    yield from _repeated(run)


def clock_remarks(run: Series) -> Iterator[Remark]:
    """Yield faults of the times of a run."""
    steps = np.diff(run.time)
    if len(steps) < LIMITS.repeated_rows:
        return
    if not (steps > 0.0).all():
        row = int(np.argmin(steps > 0.0)) + 1
        yield remark("time_order", "run", f"time_s is {run.time[row]:g} s in row {row + 1}")
        return
    usual, median = float(np.quantile(steps, 0.25)), float(np.median(steps))
    longest = int(np.argmax(steps))
    if steps[longest] > LIMITS.pause * usual > 0.0:
        apart = (
            f"time_s jumps by {steps[longest]:.3g} s after {run.time[longest]:g} s, usual are {usual:.2g} s"
        )
        yield remark("time_jump", "run", apart)
    burst = LIMITS.pause * steps < median
    if np.mean(burst) > 0.1 or LIMITS.pause * usual < float(np.quantile(steps, 0.75)):
        yield remark("two_recorders", "run", f"time_s steps by {steps.min():.2g} s and by {median:.2g} s")


def _clipped(run: Series, name: str) -> Iterator[Remark]:
    """Find readings that stay at the greatest one while another channel rises, or at full scale."""
    values = run.channels[name]
    scale = 0.0 if run.rig is None else run.rig.sensors.get(name, Sensor()).full_scale
    at_end = int(np.count_nonzero(np.abs(values) >= scale * (1.0 - 1e-9))) if scale else 0
    if at_end >= LIMITS.clipped_rows:
        yield remark("clipped", "run", f"{at_end} readings of {name} are at its full scale of {scale:g}")
        return
    highest = float(np.nanmax(values))
    if not run.moves(name) or name.endswith("_rad"):
        return  # an encoder has no end, and a joint stands while its drive crosses the dead zone
    for first, last in _plateaus(values, LIMITS.clipped_rows):
        if values[first] < highest:
            continue
        for other in run.channels:
            if other == name or other.startswith("temperature"):
                continue
            part = filled(run.channels[other])[first : last + 1]
            rise = float(np.max(part - np.minimum.accumulate(part)))
            if rise > LIMITS.slight * run.span(other) + CHANCE.never * run.noise[other]:
                stays = f"{last - first + 1} readings of {name} stay at {highest:g} while {other} rises"
                yield remark("clipped", "run", stays)
                return


def _still(run: Series, name: str) -> Iterator[Remark]:
    """Find a channel that repeats one value or does not answer, and steps that are too large."""
    drive, values = run.drive, run.channels[name]
    if drive is None or not run.moves(drive):
        return
    if name != drive and name in _MUST_MOVE and not run.moves(name) and _near_zero(run, name):
        yield remark("unresponsive", "run", f"{name} stays within {run.span(name):.2g}, which is its noise")
        return
    for first, last in _plateaus(values, LIMITS.clipped_rows):
        rows = last - first + 1
        other = drive if name != drive else next((each for each in run.channels if each != drive), drive)
        if other != name and _way(run, other, first, last) > run.span(other):
            stays = f"{rows} readings of {name} stay at {values[first]:g} while {other} moves"
            yield remark("frozen", "run", stays)
            return
    levels = np.unique(values[np.isfinite(values)])
    step = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    if run.noise[name] < step and LIMITS.slight * run.span(name) < step:
        yield remark("quantised", "run", f"{name} has steps of {step:.2g} in a range of {run.span(name):.2g}")


def _near_zero(run: Series, name: str) -> bool:
    """Whether a channel that stands still reads next to nothing; a dead weight keeps T_out where it is."""
    if name != "tension_out_N":
        return True
    others = [run.most(each) for each, _ in run.tensions() if each != name]
    return abs(float(np.nanmedian(run.channels[name]))) < LIMITS.usual_error * max(others, default=0.0)


def _way(run: Series, name: str, first: int, last: int) -> float:
    """Return how far a channel goes back and forth between two rows, noise aside."""
    rows = run.rows_a_mean
    part = filled(run.means[name])[first // rows : last // rows + 1]
    steps = np.abs(np.diff(part[:: max(1, len(part) // 20)]))
    return float(steps[steps > CHANCE.never * run.error(name)].sum())


def _plateaus(values: Vector, least: int) -> list[tuple[int, int]]:
    """Return first and last row of each stretch of equal readings of this length, the longest first."""
    edges = np.concatenate(([0], np.flatnonzero(values[1:] != values[:-1]) + 1, [len(values)]))
    spans = np.diff(edges)
    long = np.flatnonzero(spans >= least)
    order = long[np.argsort(-spans[long], kind="stable")][:20]
    return [(int(edges[k]), int(edges[k + 1]) - 1) for k in order]


def _spikes(run: Series, name: str) -> Iterator[Remark]:
    values = run.channels[name]
    there = np.flatnonzero(np.isfinite(values))
    kept = values[there]
    if len(kept) < LIMITS.repeated_rows:
        return
    before, after = kept[1:-1] - kept[:-2], kept[1:-1] - kept[2:]
    usual = float(np.quantile(kept, 0.98) - np.quantile(kept, 0.02))
    off = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    far = off > LIMITS.spike * usual + CHANCE.never * run.noise[name]
    if usual > 0.0 and 0 < far.sum() <= len(kept) // LIMITS.repeated_rows:
        row = int(there[int(np.argmax(off)) + 1])
        reads = f"{name} has {int(far.sum())} single readings far off, {values[row]:.3g} in row {row + 1}"
        yield remark("spike", "run", reads)


def _copies(run: Series) -> Iterator[Remark]:
    names = list(run.channels)
    for k, one in enumerate(names):
        for other in names[k + 1 :]:
            if run.moves(one) and np.array_equal(run.channels[one], run.channels[other], equal_nan=True):
                yield remark("copied_channel", "run", f"{one} and {other} have the same readings")


def _repeated(run: Series) -> Iterator[Remark]:
    """Find rows that occur again in the same order, in channels that have noise."""
    noisy = [run.channels[name] for name in run.noisy() if run.moves(name)]
    if len(noisy) < 2:
        return
    block = repeated_block(np.column_stack(noisy))
    if block is not None:
        first, again, rows = block
        yield remark(
            "repeated_block", "run", f"rows {first + 1} to {first + rows} occur again from row {again + 1}"
        )


def repeated_block(table: np.ndarray) -> tuple[int, int, int] | None:
    """Return where the longest block of rows is, where it occurs again, and its length."""
    _, kind = np.unique(table, axis=0, return_inverse=True)
    kind = kind.reshape(-1)
    order = np.argsort(kind, kind="stable")
    same = kind[order[1:]] == kind[order[:-1]]
    shift = np.zeros(len(kind), dtype=np.intp)
    shift[order[:-1][same]] = (order[1:] - order[:-1])[same]
    shift[shift < LIMITS.repeated_rows] = 0  # a value that stands still is no block
    edges = np.concatenate(([0], np.flatnonzero(np.diff(shift)) + 1, [len(shift)]))
    spans = np.where(shift[edges[:-1]] > 0, np.diff(edges), 0)
    longest = int(np.argmax(spans))
    if spans[longest] < LIMITS.repeated_rows:
        return None
    first = int(edges[longest])
    return first, first + int(shift[first]), int(spans[longest])
