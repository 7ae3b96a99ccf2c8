"""One step of the tendon beside finite volumes of the same accuracy, and how it grows with the bars.

The reference gets as many cells as it needs for its elongation to be as near as that of the bars to the
corner list, which is exact on a fixed route.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.routes import PIECEWISE, truth
from benchmarks.tables import number, table
from tests.compiled import library_of
from tssgeom.arrays import Vector
from tssgeom.rig import Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.bars import base
from tssgeom.tendon.bars.bar_state import BarState, pretensioned_bars
from tssgeom.tendon.transmission import of_corners as transmit


@dataclass(frozen=True, slots=True)
class Cells:
    """Tension in the cells, drive and load at both ends, and the faces between."""

    tension: Vector
    """[n+2] N."""
    turn: Vector
    """[n+1] Friction coefficient times the angle from the middle of one cell to that of the next [1]."""


@dataclass(frozen=True, slots=True)
class Rod:
    """What the cells are made of."""

    length: float
    """m."""
    compliance: float
    """Strain per tension [1/N]."""
    friction: float
    """Coulomb coefficient [1]."""
    pretension: float
    """N."""
    load_stiffness: float
    """N/m."""


def turns(rod: Rod, cells: int, length: Vector, angle: Vector) -> Vector:
    """Return μΔφ of each face [n+1] on a route of pieces of the given lengths [m] and angles [rad]."""
    middle = (np.arange(cells) + 0.5) / cells
    share = np.concatenate(([0.0], np.cumsum(length))) / length.sum()
    phi = np.interp(middle, share, np.concatenate(([0.0], np.cumsum(angle))))
    return rod.friction * np.diff(phi, prepend=0.0, append=angle.sum())


def at_rest(rod: Rod, turn: Vector) -> Cells:
    """Return the pretensioned tendon."""
    return Cells(np.full(len(turn) + 1, rod.pretension), turn)


def pulled(rod: Rod, state: Cells, turn: Vector, tension_in: float) -> Cells:
    """Return the equilibrium after one step of drive and route.

    Raises
    ------
    ArithmeticError
        Where there is none.
    """
    cells = len(turn) - 1
    stiffness = np.full(cells + 2, cells / (rod.compliance * rod.length))
    stiffness[0], stiffness[-1] = 0.0, rod.load_stiffness
    ffi, library = _compiled()
    tension, memory = state.tension.copy(), np.empty(8 * cells + 9)
    arrays = (tension, state.turn, turn, stiffness)
    given = [ffi.from_buffer("double[]", each) for each in (*arrays, memory)]
    if not library.pull(cells + 1, *given[:4], tension_in, given[4]):
        raise ArithmeticError(f"no equilibrium of {cells} cells at {tension_in:g} N")
    return Cells(tension, turn)


def elongation(rod: Rod, state: Cells) -> float:
    """Return the elongation above the pretensioned state [m]."""
    return rod.compliance * rod.length * float(np.mean(state.tension[1:-1]) - rod.pretension)


@cache
def _compiled() -> tuple[Any, Any]:
    here = Path(__file__).parent
    return library_of(here / "volumes.h", [here / "volumes.c"])


BARS = (15, 30, 60, 120, 240)
RIG = Rig(tendon=Tendon(pretension_N=2.0))
LEGEND = """\
From a pull to 15 N and a release to 9 N: mean of one step back to 15 N and one on to 6 N, on the route as it
is (fixed) or with all bends opened by 2 % in the same step (moving). error: of the elongation, rms over a
history on a fixed route, against the corner list, which is exact there and takes that step. volumes:
implicit, compiled, by Tresca's iteration, as many cells as it takes for that error. ratio: their time over
ours."""

_HISTORY = (15.0, 9.0, 12.0, 6.0, 14.0)  # [N]
_LOADED, _GOALS = (15.0, 9.0), (15.0, 6.0)
_OPENS = 1.02
_FINER = 1.15  # from one number of cells that is tried to the next


def step_table(
    repeats: int, clock: Callable[[], float], *, markdown: bool, bars: Sequence[int] = BARS
) -> str:
    """Return the table of times [µs] and ratios."""
    after = _route(1.0)
    exact = _timed([partial(profile.step, _corners(_LOADED), t, _MU) for t in _GOALS], repeats, clock)
    rows, moving = [], []
    for n in bars:
        error = _error(_bars_history(n))
        cells = _cells_for(error)
        chain, volumes = _loaded_bars(n), _loaded_cells(cells)
        own = _timed([partial(base.step, chain, after, RIG, tension_in=t) for t in _GOALS], repeats, clock)
        still = _timed([partial(_stepped, volumes, _route(_OPENS), t) for t in _GOALS], repeats, clock)
        other = _timed([partial(_stepped, volumes, after, t) for t in _GOALS], repeats, clock)
        moving.append(own)
        times = [number(1e6 * t) for t in (exact, own, still, other)]
        rows.append([str(n), f"{error:.1e}", str(cells), *times, number(still / exact), number(other / own)])
    header = ["bars", "error", "cells", "corners [µs]", "bars, moving", "volumes, fixed", "volumes, moving"]
    text = table([*header, "ratio, fixed", "ratio, moving"], rows, text_columns=0, markdown=markdown)
    power = np.polyfit(np.log(bars), np.log(moving), 1)[0]
    return f"{text}\nbars, moving: time as the number of bars to the power {power:.2f}"


_MU = RIG.friction.coefficient


@dataclass(frozen=True, slots=True)
class _Loaded:
    rod: Rod
    state: Cells


def _route(opens: float) -> Arcs:
    course = truth(PIECEWISE[-1], np.random.default_rng(0)).course
    if course is None:
        raise TypeError(f"{PIECEWISE[-1]} has no pieces: choose another route for the steps")
    return Arcs.exact(course.length, opens * np.hypot(*course.bend.T) * course.length)


def _corners(drive: Sequence[float]) -> profile.Corners:
    state = profile.pretensioned(RIG)
    for tension_in in drive:
        state = profile.step(state, tension_in, _MU)
    return state


def _bars_history(bars: int) -> Vector:
    """Return the elongation [m] after each step of the history."""
    route = _route(_OPENS)
    state, out = pretensioned_bars(RIG, route, bars), []
    for tension_in in _HISTORY:
        state = base.step(state, route, RIG, tension_in=tension_in)
        out.append(state.elongation)
    return np.array(out)


def cells_history(cells: int) -> Vector:
    """Return the elongation [m] of the reference after each step of the history."""
    rod, route = _rod(), _route(_OPENS)
    turn = turns(rod, cells, route.length, route.angle)
    state, out = at_rest(rod, turn), []
    for tension_in in _HISTORY:
        state = pulled(rod, state, turn, tension_in)
        out.append(elongation(rod, state))
    return np.array(out)


def exact_history() -> Vector:
    """Return the exact elongation [m] after each step of the history."""
    states = [_corners(_HISTORY[: i + 1]) for i in range(len(_HISTORY))]
    return np.array([transmit(state, _route(_OPENS), RIG).elongation for state in states])


def _error(elongation: Vector) -> float:
    return float(np.sqrt(np.mean((elongation / exact_history() - 1) ** 2)))


def _cells_for(error: float) -> int:
    """Return the first number of cells tried that has no larger error."""
    cells = 10.0
    while _error(cells_history(round(cells))) > error:
        cells *= _FINER
    return round(cells)


def _rod() -> Rod:
    tendon = RIG.tendon
    length, load = _route(1.0).total_length, RIG.load.stiffness_N_per_m
    return Rod(length, tendon.compliance_per_N, _MU, tendon.pretension_N, load)


def _loaded_bars(bars: int) -> BarState:
    route = _route(_OPENS)
    state = pretensioned_bars(RIG, route, bars)
    for tension_in in _LOADED:
        state = base.step(state, route, RIG, tension_in=tension_in)
    return state


def _loaded_cells(cells: int) -> _Loaded:
    rod, route = _rod(), _route(_OPENS)
    turn = turns(rod, cells, route.length, route.angle)
    state = at_rest(rod, turn)
    for tension_in in _LOADED:
        state = pulled(rod, state, turn, tension_in)
    return _Loaded(rod, state)


def _stepped(loaded: _Loaded, route: Arcs, tension_in: float) -> Cells:
    rod, state = loaded.rod, loaded.state
    turn = turns(rod, len(state.turn) - 1, route.length, route.angle)
    return pulled(rod, state, turn, tension_in)


def _timed(calls: Sequence[Callable[[], object]], repeats: int, clock: Callable[[], float]) -> float:
    """Return the mean over the calls of each one's median time, the first run of each not counted [s]."""
    medians = []
    for call in calls:
        call()
        taken = []
        for _ in range(repeats):
            begin = clock()
            call()
            taken.append(clock() - begin)
        medians.append(float(np.median(taken)))
    return float(np.mean(medians))
