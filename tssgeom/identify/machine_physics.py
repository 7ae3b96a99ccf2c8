"""What physics and bounds forbid of a fitted machine; docs/model.md (198)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from tssgeom.arrays import Vector
from tssgeom.channel_names import numbered
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.machine_evidence import FittedModel
from tssgeom.identify.machine_problem import FIT
from tssgeom.identify.machine_run import turns_of
from tssgeom.least_squares import SOLVER
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.tendon.machine import Start, machine_of, routed
from tssgeom.tendon.machine_simulation import drive_channels, simulate_machine


def refused(before: FittedModel, after: FittedModel) -> str:
    """Return why physics or a bound forbids a model, in a clause; empty where nothing does; (198)."""
    return next(_reasons(before, after), "")


def _reasons(before: FittedModel, after: FittedModel) -> Iterator[str]:
    shared = len(before.state.u)
    values = zip(after.problem.parameters, after.state.u, strict=True)
    for j, (each, u) in enumerate(values):
        far = abs(u) >= CHANCE.rare
        was = j < shared and abs(before.state.u[j]) >= CHANCE.rare
        if each.kind == "rig" and far and not was:
            yield f"{each.name} goes to its bound"
    for law in after.problem.laws:
        if law.at_bound(after.state.u[after.problem.waves_of(law)]):
            yield f"{law.name} goes to its bound"
    limits = {
        f"{part.label}: {number.name}": (number.lower, number.upper)
        for part in after.parts
        for number in part.numbers
    }
    for each, u in zip(after.problem.parameters, after.state.u, strict=True):
        value = each.value(u)
        for bound in limits.get(each.name, ()):
            if math.isfinite(bound) and abs(value - bound) <= SOLVER.step * abs(bound):
                yield f"{each.name} goes to its bound"
    friction = [one.rig.friction.coefficient for one in (before, after)]
    if friction[1] > PLAUSIBLE.most_rig_friction >= friction[0]:
        yield f"the friction coefficient goes to {friction[1]:.2g}"
    yield from _creates(after)


def simulated_runs(model: FittedModel) -> Iterator[dict[str, Vector]]:
    """Yield every channel of each run without errors of sensors, up to one that finds no equilibrium."""
    rig = model.rig
    in_physics = tuple(each for each in rig.effects if each.hook != "observation")
    plain = msgspec.structs.replace(rig, sensors={}, effects=in_physics)
    for k, run in enumerate(model.problem.runs):
        own = model.problem.of_run(model.state.u, k)
        machine = machine_of(plain, [routed(arcs, rig) for arcs in run.routes], FIT.bars)
        shares = np.array([own.get(("history", str(which)), 0.0) for which in range(machine.count)])
        try:
            yield simulate_machine(
                machine, dict(run.given), drive=run.drive, end_given=run.end_given, start=Start(shares)
            )
        except (FitError, SettingsError):
            return


def _creates(model: FittedModel) -> Iterator[str]:
    """Say where a tendon pushes, or gives more work over its cycles than it takes."""
    for run, out in zip(model.problem.runs, simulated_runs(model), strict=False):
        edges = turns_of(run.given[drive_channels(run.drive, run.tendons)[0]])
        names = [list(numbered(name, run.tendons)) for name in _WORK]
        for pull_in, way_in, pull_out, way_out in zip(*names, strict=True):
            if min(float(out[pull_in].min()), float(out[pull_out].min())) < -1e-9:
                yield f"{pull_in} goes below zero"
            cycles = closed_cycles([out[name] for name in (pull_in, way_in, pull_out, way_out)], edges[1:-1])
            taken = _work(out[pull_in][cycles], out[way_in][cycles])
            left = _work(out[pull_out][cycles], out[way_out][cycles])
            turned = float(np.sum(np.abs(_steps(out[pull_in][cycles], out[way_in][cycles]))))
            if taken - left < -PLAUSIBLE.slight * turned:  # a cycle hardly ever closes better
                yield "the sheath would give more work over its cycles than it takes"


def closed_cycles(channels: Sequence[Vector], turned: np.ndarray) -> slice:
    """Return the most samples between two turns of one kind where all channels agree, as energy then does."""
    at = np.array([each[turned] for each in channels])
    near = PLAUSIBLE.slight * np.array([np.ptp(each) for each in channels])
    closed = np.all(np.abs(at[:, :, None] - at[:, None]) <= near[:, None, None], axis=0)
    pairs = [(i, j) for i in range(len(turned)) for j in range(i + 2, len(turned), 2) if closed[i, j]]
    if not pairs:
        return slice(0)
    first, last = max(pairs, key=lambda pair: turned[pair[1]] - turned[pair[0]])
    return slice(turned[first], turned[last] + 1)


_WORK = ("tension_in_N", "displacement_in_m", "tension_out_N", "displacement_out_m")


def _steps(pull: Vector, way: Vector) -> Vector:
    return 0.5 * (pull[1:] + pull[:-1]) * np.diff(way)


def _work(pull: Vector, way: Vector) -> float:
    return float(np.sum(_steps(pull, way)))
