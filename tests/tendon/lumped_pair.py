"""One case for two solvers: the bars of `tssgeom` and the independent lumped chain, on one grid in time."""

from dataclasses import dataclass

import numpy as np

from tests.lumped import Distal, Drive, Physics, from_pieces, simulate
from tests.tendon.bars import HALF, LOOP, MU, PI, RHO, blocked
from tests.tendon.steps import pretensioned_bars, step
from tssgeom.rig import Friction, Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.capstan import transmit

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

    def asked(self, count=81):
        """Times at which to compare, `count` of them."""
        return np.linspace(0.0, self.knots[-1], count)


def by_lumped(case, asked, max_step=0.02, cells=160):
    """[5, len(asked)] `ROWS`, from the lumped chain."""
    physics = Physics(friction=MU, compliance_per_N=RHO, pretension_N=case.pretension)
    path = from_pieces(case.length, case.angle, cells, case.frames)
    drive = Drive(case.kind, np.asarray(case.knots, dtype=float), np.asarray(case.values))
    run = simulate(path, physics, drive, case.end, asked, max_step)
    return np.array([run.tension_in, run.tension_out, run.stretch, run.displacement_in, run.displacement_out])


def by_bars(case, asked, max_step=0.02, bars=60):
    """[5, len(asked)] `ROWS`, from the bars of `tssgeom`."""
    hardware, drive = _rig(case), "tension_in" if case.kind == "force" else "displacement_in"
    go = blocked if case.end.kind == "blocked" else step
    state, rows = pretensioned_bars(hardware, _arcs(case, 0.0), bars), []
    for now in _grid(case, asked, max_step):
        state = go(state, _arcs(case, now), hardware, **{drive: _at(case, case.values, now)})
        if np.isclose(asked, now, rtol=0.0, atol=1e-9).any():
            rows.append([getattr(state, name) for name in ROWS])
    return np.array(rows).T


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
    stiffness = case.end.stiffness_N_per_m if case.end.kind == "spring" else 0.0
    return Rig(
        tendon=Tendon(compliance_per_N=RHO, pretension_N=case.pretension),
        friction=Friction(coefficient=MU),
        load=Load(stiffness_N_per_m=stiffness),
    )


def _at(case, series, now):
    return float(np.interp(now, case.knots, series))


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
