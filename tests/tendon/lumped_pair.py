"""One case for two solvers: the bars of `tssgeom` and the independent lumped chain, on one grid in time."""

import math
from dataclasses import dataclass

import numpy as np

from tests.lumped import Distal, Drive, Physics, from_pieces, simulate
from tests.tendon.bars import HALF, LOOP, MU, PI, RHO, stepped
from tssgeom.effects import Setup
from tssgeom.rig import Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.bars.bar_state import pretensioned_bars
from tssgeom.tendon.bars.contact_grid import discretise
from tssgeom.tendon.bars.plant import plant
from tssgeom.tendon.transmission import of_corners as transmit

EXPANSION_PER_K = 2e-5
SPRING, BLOCKED, WEIGHT = Distal("spring", 1000.0), Distal("blocked"), Distal("weight")
MM = 1e-3
SETUP_A, SETUP_B = ([HALF, LOOP], [PI, 2 * PI]), ([LOOP, HALF], [2 * PI, PI])
FOUR = np.array([0.15, 0.1, 0.15, 0.1])
WANDER = [[2, 0.5, 1, 0], [1, 1.5, 1, 1], [2.5, 0, 0.5, 2], [0.5, 2, 2, 0], [1, 1, 1.5, 1], [2, 0.5, 1, 0]]
EVERY_2_S = np.arange(0.0, 11.0, 2.0)
STROKES = {
    "force": ([0, 1, 3.5, 4.5, 6, 7.5, 10], [2.0, 12.0, 5.0, 9.0, 6.0, 14.0, 3.0]),
    "displacement": ([0, 1, 3.5, 4.5, 6, 7.5, 10], np.array([0, 2, 1, 1.6, 1.1, 2.5, 0.5]) * MM),
}
HELD = {"force": ([0, 1, 10], [2.0, 12.0, 12.0]), "displacement": ([0, 1, 10], [0.0, 2 * MM, 2 * MM])}
ROWS = ("tension_in", "tension_out", "elongation", "displacement_in", "displacement_out")


@dataclass(frozen=True, slots=True)
class Case:
    """A route, how it moves, and what is done to the tendon; all linear in time between what is given."""

    length: np.ndarray
    """[k] or [F, k] Lengths of the pieces [m]."""
    angle: np.ndarray
    """[k] or [F, k] Angles of the pieces [rad]."""
    kind: str
    """Drive: "force" or "displacement"."""
    knots: np.ndarray
    """[D] Times of the drive, from 0 [s]."""
    values: np.ndarray
    """[D] Tension [N] or position [m] of the drive."""
    end: Distal = SPRING
    frames: np.ndarray = (0.0,)
    """[F] Times of the route [s]."""
    pretension: float = 2.0
    creep: tuple[tuple[float, float], ...] = ()
    """Kelvin–Voigt elements: ratio of creep to elastic strain [1], time [s]."""
    celsius: np.ndarray = None
    """[D] Temperature [°C], where it changes."""
    series: tuple[float, float] = (0.0, 0.0)
    """Compliance between sheath and drive, sheath and load [m/N]."""

    def asked(self, count=81):
        """Times at which to compare, `count` of them."""
        return np.linspace(0.0, self.knots[-1], count)


def by_lumped(case, asked, max_step=0.02, cells=160):
    """[5, len(asked)] `ROWS`, from the lumped chain."""
    physics = Physics(
        friction=MU,
        compliance_per_N=RHO,
        pretension_N=case.pretension,
        creep_ratios=tuple(ratio for ratio, _ in case.creep),
        creep_times_s=tuple(time for _, time in case.creep),
        expansion_per_K=EXPANSION_PER_K,
        series_in_m_per_N=case.series[0],
        series_out_m_per_N=case.series[1],
    )
    path = from_pieces(case.length, case.angle, cells, case.frames)
    celsius = None if case.celsius is None else np.asarray(case.celsius, dtype=float)
    drive = Drive(case.kind, np.asarray(case.knots, dtype=float), np.asarray(case.values), celsius)
    run = simulate(path, physics, drive, case.end, asked, max_step)
    return np.array([run.tension_in, run.tension_out, run.stretch, run.displacement_in, run.displacement_out])


def by_bars(case, asked, max_step=0.02, bars=60):
    """[5, len(asked)] `ROWS`, from the bars of `tssgeom`."""
    stiffness = {"spring": case.end.stiffness_N_per_m, "blocked": math.inf, "weight": 0.0}[case.end.kind]
    series_in, series_out = case.series
    setup = Setup(
        MU, RHO, case.pretension, stiffness, series_in_m_per_N=series_in, series_out_m_per_N=series_out
    )
    state = pretensioned_bars(_rig(case), _arcs(case, 0.0), bars)
    ratio, time = np.array(case.creep, dtype=float).reshape(-1, 2).T
    crept = np.outer(RHO * ratio, state.tension[1:-1])  # at rest under the pretension
    warm, before, grown, rows = _at(case, case.celsius, 0.0), -max_step, 0.0, []
    for now in _grid(case, asked, max_step):
        arcs, after = _arcs(case, now), _at(case, case.celsius, now)
        drive = {"tension_in" if case.kind == "force" else "displacement_in": _at(case, case.values, now)}
        heat = np.full(bars, EXPANSION_PER_K * (after - warm))
        step = (state, arcs, plant(setup, arcs, state.edge), drive, heat)
        state, crept, strain = _crept(step, crept, RHO * ratio, (now - before) / time)
        before, warm = now, after
        grown += float(strain @ discretise(state.edge, arcs).length)
        if np.isclose(asked, now, rtol=0.0, atol=1e-9).any():
            rows.append([getattr(state, name) + (grown if name == "elongation" else 0.0) for name in ROWS])
    return np.array(rows).T


def _crept(step, crept, compliance, x):
    """Advance with creep strains [c, n] that answer the tension of the same step, linear over x times [c].

    The strain is iterated until the tension it leaves is the tension it came from.
    """
    state, arcs, laws, drive, heat = step
    kept, mean = np.exp(-x)[:, None], (-np.expm1(-x) / x)[:, None]
    tension = state.tension[1:-1]
    for _ in range(30):
        answer = (mean - kept) * state.tension[1:-1] + (1 - mean) * tension
        grown = kept * crept + compliance[:, None] * answer
        strain = heat + np.sum(grown - crept, axis=0)
        after = stepped(state, arcs, laws, strain=strain, **drive)
        change = np.max(np.abs(after.tension[1:-1] - tension))
        tension = after.tension[1:-1]
        if not len(x) or change < 1e-8:
            return after, grown, strain
    raise AssertionError(f"creep did not settle: {change:.3g} N")


def by_corners(case, asked):
    """[3, len(asked)] The first three of `ROWS`, from the corner list: force drive on a fixed route."""
    state, observed = profile.pretensioned(_rig(case)), []
    for now in _grid(case, asked, 1.0):
        state = profile.step(state, _at(case, case.values, now), MU)
        if np.isclose(asked, now, rtol=0.0, atol=1e-9).any():
            reported = transmit(state, _arcs(case, now), _rig(case))
            observed.append([reported.tension_in, reported.tension_out, reported.elongation])
    return np.array(observed).T


def _rig(case):
    return Rig(tendon=Tendon(compliance_per_N=RHO, pretension_N=case.pretension))


def _at(case, series, now):
    return 0.0 if series is None else float(np.interp(now, case.knots, series))


def _arcs(case, now):
    def at(series):
        rows = np.broadcast_to(series, (len(case.frames), np.shape(series)[-1]))
        return np.array([np.interp(now, case.frames, column) for column in rows.T])

    return Arcs.exact(at(case.length), at(case.angle))


def _grid(case, asked, max_step):
    """Times of the steps: all that is asked and given, and no step longer than `max_step`."""
    met = np.unique(np.round(np.concatenate((asked, case.knots, case.frames)), 9))
    met = met[met <= asked[-1]]
    count = np.ceil(np.diff(met) / max_step - 1e-9).astype(int)
    parts = [np.linspace(a, b, m + 1)[1:] for a, b, m in zip(met, met[1:], count, strict=False)]
    return np.concatenate([met[:1], *parts])


def on_wander(kind, drive, end, **others):
    """Four pieces whose bends change while the drive does `drive`, knots and values."""
    return Case(FOUR, WANDER, kind, *drive, end, EVERY_2_S, **others)
