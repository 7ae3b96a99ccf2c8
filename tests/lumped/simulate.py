"""One run: path, physics, drive and far end in, plain arrays out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from tests.lumped.assembly import Chain, chain
from tests.lumped.changes import Change, play_width, rows
from tests.lumped.march import march
from tests.lumped.physics import Distal, Drive, Physics
from tests.lumped.route import Path

STILL_M = 1e-13  # of slip in a step: what rounding of displacements may show as motion


@dataclass(frozen=True, slots=True)
class Run:
    """What a run gave at the F asked times, on n vertices; on the ends only, where no more was asked for."""

    times: np.ndarray
    """[F] s."""
    tension_in: np.ndarray
    """[F] At the drive [N]."""
    tension_out: np.ndarray
    """[F] At the load [N]."""
    displacement_in: np.ndarray
    """[F] Of the drive, towards the proximal side, from the pretensioned state [m]."""
    displacement_out: np.ndarray
    """[F] Of the load, towards the proximal side [m]."""
    elongation: np.ndarray
    """[F] displacement_in − displacement_out [m]."""
    stretch: np.ndarray
    """[F] How much longer the tendon in the sheath is than when pretensioned, as the path grows too [m]."""
    temperature: np.ndarray
    """[F] °C."""
    stations: np.ndarray
    """[n] Arc length of the vertices in the first frame of the path [m]."""
    tension: np.ndarray
    """[F, n + 1] In the bars before, between and behind the vertices, or [F, 0] [N]."""
    friction: np.ndarray
    """[F, n + 2] On fitting, vertices, fitting, or [F, 2] without the vertices; > 0 against motion to the
    proximal end [N]."""
    position: np.ndarray
    """[F, n + 2] or [F, 2] Displacement of the same [m]."""
    sliding: np.ndarray
    """[F, n + 2] or [F, 2] Last substep: −1 slipped to the distal end, 0 stuck, 1 to the proximal end."""
    heat: np.ndarray
    """[F] Work done against friction since the start [J]."""
    steps: int
    passes: int


class NoBalanceError(Exception):
    """No equilibrium at some time of a run."""


def simulate(
    path: Path,
    physics: Physics,
    drive: Drive,
    distal: Distal,
    times: ArrayLike,
    max_step: float = 0.01,
    changes: Sequence[Change] = (),
    ends_only: bool = False,
) -> Run:
    """Run from the pretensioned state, in substeps of at most `max_step` [s], and return it at `times` [s].

    The drive's knots, the path's frames and the knots of changes are always met. What they say at the start
    is imposed in one step. Time itself matters only to viscous drag, friction by speed, creep and changes.
    With `ends_only` the run holds no arrays of the vertices: an hour of 100 Hz and 64 cells then takes 70 MB,
    not 800 MB.

    Raises
    ------
    NoBalanceError
        Where the chain finds no equilibrium: a force drive beyond what a dead weight and friction hold, say.
    """
    knots = [path.times, *(np.asarray(change.times, dtype=float) for change in changes)]
    grid, keep = grid_of(times, [drive.times], knots, max_step)
    parts, imposed, values = prepared(path, physics, drive, distal, grid, keep, max_step, changes)
    records = records_for(path, int(keep.sum()), ends_only)
    steps, passes = march(parts, imposed, records)
    if steps < 0:
        time = grid[-steps - 1]
        raise NoBalanceError(
            f"no balance at {time:.6g} s, drive {values[-steps - 1]:.6g}; lower max_step or the load"
        )
    tension, position = records[:2]
    out = {
        "blocked": np.zeros(len(tension)),
        "spring": (tension[:, -1] - parts.pretension) / (distal.stiffness_N_per_m or np.inf),
        "weight": position[:, -1],
    }[distal.kind]
    displayed = displacement_by_force(records, parts, physics) if drive.kind == "force" else values[keep]
    run = run_of(grid[keep], displayed, out, records, (steps, passes), path, celsius_of(drive, grid[keep]))
    if physics.load_friction_N:  # the cell stands before what rubs
        run = replace(run, tension_out=run.tension_out + run.friction[:, -1])
    return run


def prepared(
    path: Path,
    physics: Physics,
    drive: Drive,
    distal: Distal,
    grid: np.ndarray,
    keep: np.ndarray,
    max_step: float,
    changes: Sequence[Change] = (),
) -> tuple[Chain, dict[str, np.ndarray], np.ndarray]:
    """Return the chain, what is imposed on it over the grid, and the drive's values there."""
    values = np.interp(grid, drive.times, np.asarray(drive.values, dtype=float))
    celsius = celsius_of(drive, grid)
    width = play_width(physics, changes, grid)
    if drive.kind == "force" and np.ptp(width) > 0.0:
        raise ValueError("a play that changes needs a drive by displacement")
    given = rows(path, physics, changes)
    frame, weight = _frames(given.times, grid)
    imposed = {
        "span": np.diff(grid, prepend=grid[0] - max_step),
        "drive": play(values, width) if drive.kind == "displacement" else values,
        "warmth": celsius - celsius[0],
        "frame": frame,
        "weight": weight,
        "growth": given.growth,
        "turns": given.turns,
        "friction": given.friction,
        "compliance": given.compliance,
        "keep": keep,
    }
    return chain(path, physics, distal, drive.kind == "force"), imposed, values


def records_for(path: Path, rows: int, ends_only: bool = False) -> tuple[np.ndarray, ...]:
    """Return room for what is kept: tension, position, friction, slip, work."""
    n = path.turns.shape[1]
    return (*(np.empty((rows, 2 if ends_only else n + m)) for m in (3, 2, 2, 2)), np.empty(rows))


def run_of(times, displacement_in, displacement_out, records, effort, path: Path, celsius) -> Run:
    """Return a run of one tendon from what was kept of it."""
    tension, position, friction, slip, heat = records
    longer = np.interp(times, path.times, (path.bars - path.bars[0]).sum(axis=1))
    return Run(
        times=times,
        tension_in=tension[:, 0],
        tension_out=tension[:, -1],
        displacement_in=displacement_in,
        displacement_out=displacement_out,
        elongation=displacement_in - displacement_out,
        stretch=position[:, 0] - position[:, -1] + longer,
        temperature=celsius,
        stations=path.stations,
        tension=tension[:, 1:-1],
        friction=friction,
        position=position,
        sliding=(np.sign(slip) * (np.abs(slip) > STILL_M)).astype(np.int8),
        heat=heat,
        steps=effort[0],
        passes=effort[1],
    )


def displacement_by_force(records, parts: Chain, physics: Physics) -> np.ndarray:
    """Return where a drive went that has a given force [m]."""
    tension, position = records[:2]
    shift = position[:, 0] + _extension(tension[:, 0], parts, 0) + parts.slack
    return play(shift, physics.backlash_m, inverse=True)


def _extension(tension: np.ndarray, parts: Chain, bar: int) -> np.ndarray:
    """Extension of an outer bar beyond that under the pretension [m]."""

    def at(force):
        return parts.compliance[bar] * force - parts.toe[bar] * np.expm1(-force / parts.toe_scale[bar])

    return at(tension) - at(parts.pretension)


def grid_of(
    times: ArrayLike, drives: list[np.ndarray], others: list[np.ndarray], max_step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return a grid from the first drive on that meets all asked and given times; where it is asked for."""
    asked = np.asarray(times, dtype=float)
    first = min(asked[0], *(each[0] for each in drives))
    knots = np.concatenate((asked, *drives, *others))
    knots = np.unique(np.round(knots[(knots >= first) & (knots <= asked[-1])], 9))
    grid = _divided(knots, max_step)
    return grid, np.isin(grid, np.round(asked, 9))


def _divided(knots: np.ndarray, max_step: float) -> np.ndarray:
    if len(knots) == 1:
        return knots
    parts = np.ceil(np.diff(knots) / max_step - 1e-9).astype(int)
    return np.append(
        np.concatenate(
            [np.linspace(a, b, m, endpoint=False) for a, b, m in zip(knots, knots[1:], parts, strict=False)]
        ),
        knots[-1],
    )


def _frames(times: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frame before each time of the grid, and how far towards the next one it is [1]."""
    at = np.interp(grid, times, np.arange(len(times)))
    frame = np.floor(at).astype(np.int64)
    return frame, at - frame


def celsius_of(drive, grid: np.ndarray) -> np.ndarray:
    """Return the temperature of a drive [°C]."""
    if drive.temperature_C is None:
        return np.full(len(grid), 20.0)
    return np.interp(grid, drive.times, drive.temperature_C)


def play(values: np.ndarray, width: float | np.ndarray, inverse: bool = False) -> np.ndarray:
    """Pass a series through a play that starts engaged for pulling; or return the series that gives it.

    A play that changes has a width for each value [m], and no inverse.
    """
    if not np.any(width):
        return values
    if not inverse:
        return _passed(values, np.broadcast_to(width, values.shape))
    passed = np.empty_like(values)
    held, lag = 0.0, 0.0
    for i, value in enumerate(values):
        change = value - held
        lag = 0.0 if change > 1e-12 else width if change < -1e-12 else lag
        held = value
        passed[i] = value - lag
    return passed


def _passed(values: np.ndarray, width: np.ndarray) -> np.ndarray:
    passed, held = [], 0.0
    for value, wide in zip(values.tolist(), width.tolist(), strict=True):
        held = min(max(held, value), value + wide)
        passed.append(held)
    return np.array(passed)
