"""What a fit of a machine compares: the channels of all runs at any numbers, and their derivatives.

Every number is counted in standard deviations of what is assumed of it; docs/model.md (179)-(181).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import AnyEffect
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.fit_quality import weights_of
from tssgeom.identify.machine_laws import FreeLaw
from tssgeom.identify.machine_parameters import Parameter, route_numbers
from tssgeom.identify.machine_prediction import Machines, halved, predicted_beside
from tssgeom.identify.machine_run import MachineRun
from tssgeom.least_squares import SOLVER
from tssgeom.rig import Rig, with_values
from tssgeom.statistics import EVIDENCE_SCALE


@dataclass(frozen=True, slots=True)
class MachineFitSettings:
    """How a machine is fitted. All are chosen."""

    bars: int = 6
    """Bars of each tendon while fitting; chosen: more are brought in by `fine`."""
    fine: int = 40
    """Bars of each tendon, to whose answer that of few bars is brought [1]; chosen."""
    finest: int = 160
    """Bars at most, where 40 miss more than the noise of the readings hides [1]; chosen: for speed."""
    most_of_all: int = 1200
    """Samples of all runs together; more are thinned, to no less than `least_of_each`; chosen."""
    least_of_each: int = 120
    """Samples of each run; chosen."""
    close: float = 1e-4
    """Of χ²: fall that ends a round [1]; chosen: weights and bars change it by more from round to round."""
    most_at_start: int = 200
    """Samples of all runs together while the start is chosen, `least_at_start` each at least; chosen."""
    least_at_start: int = 50
    """Samples of each run while the start is chosen; chosen: a dozen a cycle."""
    starts: int = 3
    """Starts, the best of 27, from which short fits are made, and parts whose refit goes on until weights and
    numbers converge [1]; chosen for speed."""
    start_steps: int = 4
    """Steps from each start before the best one is kept; chosen."""


FIT = MachineFitSettings()
_LINEAR = ("zero", "bends")
"""Kinds of numbers by which the channels are straight: nothing is simulated for their derivatives."""


def fit_bars(rig: Rig) -> int:
    """Return the bars of each tendon while fitting: as many as parts of a sheath, up to those of `fine`."""
    return min(max(FIT.bars, len(rig.route.bends)), FIT.fine)


class Beside(NamedTuple):
    """What the model gives a step beside some numbers."""

    step: float
    channels: list[Mapping[str, Vector]] | None
    """None where the machine has no equilibrium."""
    only: int
    """The run that the channels are of, or −1 for all."""


@dataclass(frozen=True, slots=True)
class Problem:
    """Runs, what is fitted of them, and the model at so many bars; every number counts as `u`."""

    runs: tuple[MachineRun, ...]
    rig: Rig
    parameters: tuple[Parameter, ...]
    rows: tuple[tuple[int, str, np.ndarray], ...]
    """Run, channel, and the samples of it that are fitted."""
    bars: int
    too_few_bars: tuple[Mapping[str, Vector], ...] = ()
    """What more bars would add to the channels of each run; nothing where empty."""
    route_errors: Mapping[int, Matrix] = field(default_factory=dict)
    """By number of a route: errors of its lengths and angles [2k, m], of one s.d. each; (286)."""
    sensor_bends: Mapping[str, Matrix] = field(default_factory=dict)
    """By channel: errors of its sensor that are fitted, each of some waves [waves, m]; (301)."""
    laws: tuple[FreeLaw, ...] = ()
    """Effects behind those of the rig; (311)."""
    fine: int = FIT.fine
    """Bars to whose answer that of few bars is brought; (300)."""

    def refined(self, u: Vector) -> Problem:
        """Return the problem with as many bars in its corrections as its readings ask for; (300)."""
        bars, few = self.fine, replace(self, bars=self.fine).model(u)
        while few is not None and bars < FIT.finest:
            more = replace(self, bars=2 * bars).model(u)
            if more is None:
                break
            bars, missed = 2 * bars, self._over_noise(few, more)
            if missed < EVIDENCE_SCALE.very_strong:
                break
            few = more
        return replace(self, fine=bars)

    def _over_noise(self, few: Sequence[Mapping[str, Vector]], more: Sequence[Mapping[str, Vector]]) -> float:
        """Return the squares of what two predictions differ by, over the noise of the readings [1]."""
        changed = 0.0
        for k, name, at in self.rows:
            noise = max(self.runs[k].noise[name], 1e-12)
            changed += float(np.sum(np.square((more[k][name][at] - few[k][name][at]) / noise)))
        return changed

    def corrected(self, u: Vector, channels: Sequence[Mapping[str, Vector]]) -> Problem:
        """Return the problem with what as many bars as have an equilibrium would add at these numbers."""
        every = (replace(self, bars=bars).model(u) for bars in halved(self.fine, self.bars))
        fine = next((one for one in every if one is not None), None)
        if fine is None:
            return self
        pairs = zip(fine, channels, strict=True)
        added = tuple({name: each[name] - few[name] for name in each} for each, few in pairs)
        return replace(self, too_few_bars=added)

    def answers(self, channels: Sequence[Mapping[str, Vector]]) -> list[Mapping[str, Vector]]:
        """Return the channels of each run with what more bars would add."""
        if not self.too_few_bars:
            return list(channels)
        pairs = zip(channels, self.too_few_bars, strict=True)
        return [{name: values + added[name] for name, values in few.items()} for few, added in pairs]

    def measured(self) -> list[Vector]:
        """Return the readings of each block of rows."""
        return [self.runs[k].measured[channel][at] for k, channel, at in self.rows]

    def model(
        self, u: Vector, only: int | None = None, machines: Machines | None = None
    ) -> list[Mapping[str, Vector]] | None:
        """Return the channels of each run, or of one; None where the machine has no equilibrium.

        Where only numbers of runs have changed, the `machines` are as before.
        """
        try:
            machines = machines or self.machines(u)
            which = range(len(self.runs)) if only is None else [only]
            return [machines.predicted(self.runs[k], self.of_run(u, k)) for k in which]
        except (FitError, SettingsError, FloatingPointError):
            return None

    def machines(self, u: Vector) -> Machines:
        """Return the machines at these numbers; raises SettingsError where one is out of bounds."""
        return Machines(self.rig_at(u), self.bars)

    def rig_at(self, u: Vector) -> Rig:
        """Return the rig at these numbers; raises SettingsError where one is out of bounds."""
        pairs = zip(self.parameters, u, strict=True)
        rig = with_values(
            self.rig, {each.key: each.value(x) for each, x in pairs if each.kind in ("rig", "share")}
        )
        return self.with_laws(rig, u)

    def with_laws(self, rig: Rig, u: Vector) -> Rig:
        """Return a rig with the laws as effects; raises SettingsError where one is out of bounds."""
        laws = self.law_effects(u).values()
        return msgspec.structs.replace(rig, effects=(*rig.effects, *laws)) if laws else rig

    def law_effects(self, u: Vector) -> dict[str, AnyEffect]:
        """Return the laws as effects, by name; raises SettingsError where one is out of bounds."""
        return {law.name: law.effect(u[self.waves_of(law)]) for law in self.laws}

    def waves_of(self, law: FreeLaw) -> list[int]:
        """Return which numbers are the waves of a law."""
        every = enumerate(self.parameters)
        return [j for j, each in every if (each.kind, each.key) == ("law", law.name)]

    def of_run(self, u: Vector, k: int) -> dict[tuple[str, str], float]:
        """Return the numbers of one run, by kind and key."""
        factors = self.route_factors(u)
        numbers = route_numbers(self.runs)[k] if factors else []
        of_routes = {("route", str(i)): factors.get(number, 1.0) for i, number in enumerate(numbers)}
        pairs = zip(self.parameters, u, strict=True)
        bends = self.runs[k].bends
        own = (
            (each, x)
            for each, x in pairs
            if (each.run == k and each.kind != "route") or (each.kind == "bends" and each.key in bends)
        )
        return {(each.kind, each.key): each.value(x) for each, x in own} | of_routes

    def route_factors(self, u: Vector) -> dict[int, float]:
        """Return the true over the sensed angle of each route whose angle has an error, by its number [1]."""
        pairs = zip(self.parameters, u, strict=True)
        return {int(each.key): each.value(x) for each, x in pairs if each.kind == "route"}

    def moved_bends(self, u: Vector) -> dict[int, Vector]:
        """Return how lengths and angles of each route are off [2k], by its number [m, rad]."""
        sizes = {each.key: x for each, x in zip(self.parameters, u, strict=True) if each.kind == "bends"}
        return {
            number: errors @ np.array([sizes[f"{number} {m}"] for m in range(errors.shape[1])])
            for number, errors in self.route_errors.items()
        }

    def left(self, channels: Sequence[Mapping[str, Vector]]) -> list[Vector]:
        """Return measured less simulated of each block of rows."""
        given = self.answers(channels)
        return [self.runs[k].measured[name][at] - given[k][name][at] for k, name, at in self.rows]

    def floor(self, block: int) -> float:
        """Return what rounding leaves of a block of readings [SI]."""
        k, name, at = self.rows[block]
        return max(SOLVER.rounding * float(np.ptp(self.runs[k].measured[name][at])), 1e-12)

    def weights(self, left: Sequence[Vector]) -> tuple[list[Vector], Vector]:
        """Return what `weights_of` makes of what is left, and of what rounding leaves."""
        return weights_of(left, map(self.floor, range(len(self.rows))))

    def steps(self, slope: Matrix | None = None) -> Vector:
        """Return steps of derivatives: those by which the readings change by one standard deviation.

        Parameters
        ----------
        slope
            Derivatives of the weighted readings by every number [rows, parameters]; without it the steps are
            the longest.

        Notes
        -----
        Steps of logarithms are equal in the numbers themselves: two that show only as a product have then
        the same derivatives, kinks of friction and all, and no error of these parts them.
        """
        scale = np.array([each.prior.sd if each.prior.log else 1.0 for each in self.parameters])
        logs = np.array([each.prior.log for each in self.parameters])
        if slope is None:
            return SOLVER.coarse_step / scale
        strength = np.linalg.norm(slope, axis=0) / scale
        strength[logs] = strength[logs].max(initial=0.0)
        rounding = SOLVER.rounding  # of a model; of an angle it is 1000 times what (175) leaves open
        least = np.where(logs, SOLVER.step, rounding)
        return np.clip(1.0 / np.maximum(strength, 1e-300), least, SOLVER.coarse_step) / scale

    def jacobian(
        self,
        u: Vector,
        channels: Sequence[Mapping[str, Vector]],
        left: Sequence[Vector],
        beside: Mapping[int, Beside],
    ) -> Matrix:
        """Return derivatives of what is left by every number [rows, parameters]."""
        edges = np.cumsum([0, *(len(each) for each in left)])
        out = np.zeros((edges[-1], len(u)))
        for j, parameter in enumerate(self.parameters):
            if parameter.kind == "zero":
                for b, (k, name, _) in enumerate(self.rows):
                    if (k, name) == (parameter.run, parameter.key):
                        out[edges[b] : edges[b + 1], j] = -parameter.prior.sd
            elif parameter.kind == "bends":
                for b, (k, name, at) in enumerate(self.rows):
                    if parameter.key in self.runs[k].bends:
                        out[edges[b] : edges[b + 1], j] = -self.runs[k].bends[parameter.key][name][at]
        for j, there in beside.items():
            for b, (k, name, at) in enumerate(self.rows):
                if there.channels is not None and (there.only < 0 or k == there.only):
                    other = there.channels[k if there.only < 0 else 0]
                    out[edges[b] : edges[b + 1], j] = (channels[k][name][at] - other[name][at]) / there.step
        return out

    def beside(self, u: Vector, steps: Vector) -> dict[int, Beside]:
        """Return the channels a step beside some numbers, along each number that is not a zero; (298)."""
        here, moved = self.machines(u), dict[int, tuple[float, Vector, Machines]]()
        for j, each in enumerate(self.parameters):
            if each.kind not in _LINEAR:
                moved[j] = self._moved(u, j, float(steps[j]), here)
        with ThreadPoolExecutor(min(len(self.runs), os.cpu_count() or 1)) as pool:
            of_runs = list(pool.map(partial(self._of_run_beside, u, here, moved), range(len(self.runs))))
        out = dict[int, Beside]()
        for j, (step, _, _) in moved.items():
            only = self.parameters[j].run
            channels = [each[j] for each in of_runs if j in each]
            there = [each for each in channels if each is not None]
            out[j] = Beside(step, there if len(there) == len(channels) else None, only)
        return out

    def _moved(self, u: Vector, j: int, step: float, here: Machines) -> tuple[float, Vector, Machines]:
        """Return a step along one number that the machine allows, all numbers there, and the machines."""
        for way in (step, -step):
            moved = u.copy()
            moved[j] += way
            if self.parameters[j].kind not in ("rig", "share", "route", "law"):
                return way, moved, here
            with suppress(SettingsError):
                return way, moved, self.machines(moved)
        return step, u, here

    def _of_run_beside(
        self, u: Vector, here: Machines, moved: Mapping[int, tuple[float, Vector, Machines]], k: int
    ) -> dict[int, Mapping[str, Vector] | None]:
        """Return the channels of one run beside some numbers, along each one that it follows."""
        run, along = self.runs[k], [j for j in moved if self.parameters[j].run in (-1, k)]
        every = [(here, self.of_run(u, k)), *((moved[j][2], self.of_run(moved[j][1], k)) for j in along)]
        try:
            made = predicted_beside(run, [(each.simulation(run, values), values) for each, values in every])
        except (FitError, SettingsError, FloatingPointError):
            return dict.fromkeys(along)
        return dict(zip(along, made[1:], strict=True))


@dataclass(slots=True)
class FitState:
    """Where a fit stands."""

    u: Vector
    channels: list[Mapping[str, Vector]]
    left: list[Vector]
    weight: list[Vector]
    inflation: Vector
    objective: float
    steps: Vector
    """Of derivatives."""
    beside: Mapping[int, Beside] | None = None
    """What the model gives these steps beside, once it is known."""

    def slope(self, problem: Problem) -> Matrix:
        """Return derivatives of the weighted readings by every number [rows, parameters]."""
        made = self.jacobian(problem, self.left)
        return np.asarray(made * np.concatenate(self.weight)[:, None], dtype=np.float64)

    def jacobian(self, problem: Problem, left: Sequence[Vector]) -> Matrix:
        """Return derivatives of what is left of the rows of a problem, be they fitted or not."""
        if self.beside is None:
            self.beside = problem.beside(self.u, self.steps)
        return problem.jacobian(self.u, self.channels, left, self.beside)


def fitted_rows(runs: Sequence[MachineRun], held_out: bool | None) -> tuple[tuple[int, str, np.ndarray], ...]:
    """Return run, channel and samples of each block; held-out ones where asked for, all where None."""
    out = []
    for k, run in enumerate(runs):
        for name, values in run.measured.items():
            wanted = np.isfinite(values)
            if held_out is not None:
                wanted &= run.held_out == held_out
            out.append((k, name, np.flatnonzero(wanted)))
    return tuple((k, name, at) for k, name, at in out if len(at))
