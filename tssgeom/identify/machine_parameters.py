"""What is fitted of a machine and its runs, and what is assumed of each; docs/model.md (180), (234)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import ndtr

from tssgeom.identify.machine_run import LIMITS, MachineRun
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.uncertain import Prior, Uncertain, assumed


class Parameter(NamedTuple):
    """One number that is fitted; `u` counts standard deviations of its prior."""

    name: str
    unit: str
    prior: Prior
    kind: Literal["rig", "zero", "given zero", "history", "turn", "route"]
    run: int = -1
    """The run that it belongs to; −1 for all."""
    key: str = ""
    """Key of the rig, channel, number of a tendon, or number of a route of `distinct_routes`."""

    def value(self, u: float) -> float:
        """Return the number in its unit; a share of friction is even over −1 to 1."""
        return float(2.0 * ndtr(u) - 1.0) if self.kind == "history" else self.prior.value(u)


def parameters_of(runs: Sequence[MachineRun], rig: Rig, uncertain: Sequence[Uncertain]) -> list[Parameter]:
    """Return everything that is fitted: of the rig what is not certain, of each run its zeros and start."""
    stated = {each.key: each.prior for each in uncertain}
    stated.setdefault("friction.coefficient", assumed("", max(rig.friction.coefficient, 0.01), 0.15))
    soft = max(rig.tendon.compliance_per_N, 1e-6)
    stated.setdefault("tendon.compliance_per_N", assumed("", soft, soft))
    gain, own = rig.shape.angle_gain_sd, list[Parameter]()
    if "route.angle_rad" not in stated and rig.route.angle_rad is None:
        own = list(_of_routes(runs))
        if len(own) == 1:
            gain, own = math.hypot(gain, own[0].prior.sd), []
    if gain > 0.0:
        stated.setdefault("route.angle_gain", assumed("", 1.0, gain))
    parameters = [Parameter(key, unit_of(key), prior, "rig", key=key) for key, prior in stated.items()]
    parameters += own
    for k, run in enumerate(runs):
        parameters += _of_run(run, k, len(runs))
    return parameters


def _of_routes(runs: Sequence[MachineRun]) -> Iterator[Parameter]:
    """Yield the true over the sensed angle of each route whose angle has an error; docs/model.md (234)."""
    for number, arcs in enumerate(distinct_routes(runs)):
        on = [k for k, run in enumerate(runs) if any(_same(arcs, each) for each in run.routes)]
        error = arcs.total_angle_se / arcs.total_angle if arcs.total_angle else 0.0
        if error > 0.0:
            name = f"true over sensed angle of {runs[on[0]].name}"
            if len(runs[on[0]].routes) > 1:
                name += (
                    f", route {1 + next(i for i, each in enumerate(runs[on[0]].routes) if _same(arcs, each))}"
                )
            run = on[0] if len(on) == 1 else -1
            yield Parameter(name, "1", assumed("", 1.0, error), "route", run, str(number))


def distinct_routes(runs: Sequence[MachineRun]) -> list[Arcs]:
    """Return the routes of all runs, each once."""
    out = list[Arcs]()
    for each in itertools.chain.from_iterable(run.routes for run in runs):
        if not any(_same(each, known) for known in out):
            out.append(each)
    return out


def numbers_of_routes(run: MachineRun, routes: Sequence[Arcs]) -> list[int]:
    """Return the number of each route of a run among the distinct ones."""
    return [next(i for i, known in enumerate(routes) if _same(each, known)) for each in run.routes]


def _same(one: Arcs, other: Arcs) -> bool:
    return one is other or (
        np.array_equal(one.length, other.length) and np.array_equal(one.angle, other.angle)
    )


def _of_run(run: MachineRun, k: int, runs: int) -> Iterator[Parameter]:
    of = f" of {run.name}" if runs > 1 else ""
    for channel, values in run.measured.items():
        sd = LIMITS.zero * float(np.nanmax(values) - np.nanmin(values)) or 1.0
        middle = float(np.nanmedian(values))
        anywhere = unit_of(channel) in ("rad", "m") and abs(middle) > 3.0 * sd  # an encoder's own zero
        centre = middle if anywhere else 0.0
        prior = Prior(centre, sd, log=False)
        yield Parameter(f"zero of {channel}{of}", unit_of(channel), prior, "zero", k, channel)
    if run.drive == "motor_angle_rad":
        motion = run.given["motor_angle_rad"]
        prior = Prior(float(motion[0]), LIMITS.zero * float(np.ptp(motion)), log=False)
        yield Parameter(f"zero of motor_angle_rad{of}", "rad", prior, "given zero", k, "motor_angle_rad")
    for turn, sd in enumerate(run.legs.turn_se[: LIMITS.most_turns] if run.legs is not None else ()):
        prior = Prior(0.0, max(float(sd), 1e-6), log=False)
        yield Parameter(f"turn {turn + 1} of the drive{of}", "N", prior, "turn", k, str(turn))
    for which in range(run.tendons):
        name = f"friction of tendon {which + 1} at the start{of}"
        yield Parameter(name, "1", Prior(0.0, 1.0, log=False), "history", k, str(which))


def unit_of(key: str) -> str:
    """Return the unit in which the name of a key or channel ends."""
    for ending, unit in _UNITS.items():
        if key.endswith(ending):
            return unit
    return "1"


_UNITS = {
    "_per_N": "1/N",
    "_N_per_m": "N/m",
    "_Nm_per_rad": "N·m/rad",
    "_Nm": "N·m",
    "_N": "N",
    "_m": "m",
    "_rad": "rad",
    "_A": "A",
    "_s": "s",
}
