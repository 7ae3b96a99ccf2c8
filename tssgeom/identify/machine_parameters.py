"""What is fitted of a machine and its runs, and what is assumed of each; model.md (180), (234), (287)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import msgspec
import numpy as np
from scipy.special import ndtr

from tssgeom.arrays import Vector
from tssgeom.channel_names import unit_of_key
from tssgeom.identify.fit import start_rig
from tssgeom.identify.machine_run import LIMITS, MachineRun
from tssgeom.rig import Rig
from tssgeom.route.synthetic import STATED
from tssgeom.tendon.machine_simulation import drive_channels
from tssgeom.uncertain import Prior, Uncertain, assumed


@dataclass(frozen=True, slots=True)
class BendSettings:
    """What is assumed of a sheath that bends nobody knows where."""

    log_sd: float = 3.0
    """Standard deviation of the logarithm of a share [1]; chosen: straights between one to three bends are
    likely, whose shares are next to none."""
    one_log: float = 4.0
    """Logarithm of the share of one bend above that of the rest [1]; chosen: it has nearly all."""
    one_parts: float = 1.5
    """Parts that are one standard deviation of it [1]; chosen."""


BENDS = BendSettings()
_BENDS = "route.bends"


class Parameter(NamedTuple):
    """One number that is fitted; `u` counts standard deviations of its prior."""

    name: str
    unit: str
    prior: Prior
    kind: Literal["rig", "share", "zero", "given zero", "history", "turn", "route", "bends", "law"]
    run: int = -1
    """The run that it belongs to; −1 for all."""
    key: str = ""
    """Key of the rig, channel, number of a tendon, number of a route of `route_numbers`, key of
    `MachineRun.bends`, or name of a law."""

    def value(self, u: float) -> float:
        """Return the number in its unit; a share of friction is even over −1 to 1."""
        return float(2.0 * ndtr(u) - 1.0) if self.kind == "history" else self.prior.value(u)


def shares_of(parameters: Sequence[Parameter]) -> list[int]:
    """Return which numbers are the shares of the angle in the parts of a sheath, proximal to distal."""
    return [j for j, each in enumerate(parameters) if each.kind == "share"]


def one_bend(parameters: Sequence[Parameter], u: Vector, position: float | None) -> Vector:
    """Return numbers with one bend at a position along the sheath, 0 to 1; with an even bend where None."""
    at, out = shares_of(parameters), u.copy()
    out[at] = 0.0
    if position is not None:
        away = (np.arange(len(at)) + 0.5 - position * len(at)) / BENDS.one_parts
        out[at] = BENDS.one_log / BENDS.log_sd * (np.exp(-0.5 * away**2) - 0.5)
    return out


def with_unknown_bends(
    runs: Sequence[MachineRun], rig: Rig, uncertain: Sequence[Uncertain]
) -> tuple[Rig, tuple[Uncertain, ...]]:
    """Return rig and uncertain numbers, bends anywhere if neither rig nor shape says where they are; (287).

    A rig that gives the angle of its sheaths says no more than their sum.
    """
    if not has_unknown_bends(runs, rig):
        return rig, tuple(uncertain)
    even = msgspec.structs.replace(rig.route, bends=(1.0,) * STATED.parts)
    prior = Prior(1.0, BENDS.log_sd)
    more = (Uncertain(f"{_BENDS}[{k}]", prior, stated=False) for k in range(STATED.parts))
    return msgspec.structs.replace(rig, route=even), (*uncertain, *more)


def has_unknown_bends(runs: Sequence[MachineRun], rig: Rig) -> bool:
    """Whether neither rig nor shape says where sheaths bend whose length and angle the rig gives."""
    stated, one_piece = rig.route, all(len(arcs.length) == 1 for run in runs for arcs in run.routes)
    return one_piece and not stated.bends and stated.length_m is not None and bool(stated.angle_rad)


def parameters_of(runs: Sequence[MachineRun], rig: Rig, uncertain: Sequence[Uncertain]) -> list[Parameter]:
    """Return everything that is fitted: of the rig what is not certain, of each run its zeros and start."""
    stated = {each.key: each.prior for each in uncertain}
    start = start_rig(rig)
    stated.setdefault("friction.coefficient", assumed("", start.friction.coefficient, 0.15))
    soft = start.tendon.compliance_per_N
    stated.setdefault("tendon.compliance_per_N", assumed("", soft, soft))
    gain, own = rig.shape.angle_gain_sd, list[Parameter]()
    if "route.angle_rad" not in stated and rig.route.angle_rad is None:
        own = list(_of_routes(runs))
        alone = len(set(itertools.chain.from_iterable(route_numbers(runs)))) == 1
        if own and alone and "route.angle_gain" not in stated:
            gain, own = math.hypot(gain, own[0].prior.sd), []
    if gain > 0.0:
        stated.setdefault("route.angle_gain", assumed("", 1.0, gain))
    parameters = [
        Parameter(key, unit_of_key(key), prior, "share" if key.startswith(_BENDS) else "rig", key=key)
        for key, prior in stated.items()
    ]
    parameters += own
    for k, run in enumerate(runs):
        parameters += _of_run(run, k, len(runs), rig)
    return parameters


def _of_routes(runs: Sequence[MachineRun]) -> Iterator[Parameter]:
    """Yield the true over the sensed angle of each route whose angle has an error; docs/model.md (234)."""
    first, on = dict[int, tuple[MachineRun, int]](), dict[int, set[int]]()
    for k, (run, numbers) in enumerate(zip(runs, route_numbers(runs), strict=True)):
        for which, number in enumerate(numbers):
            first.setdefault(number, (run, which))
            on.setdefault(number, set()).add(k)
    for number, (run, which) in first.items():
        arcs = run.routes[which]
        if arcs.total_angle_se > 0.0 and arcs.total_angle > 0.0:
            of = f"{run.name}, route {which + 1}" if len(run.routes) > 1 else run.name
            prior = assumed("", 1.0, arcs.total_angle_se / arcs.total_angle)
            alone = min(on[number]) if len(on[number]) == 1 else -1
            yield Parameter(f"true over sensed angle of {of}", "1", prior, "route", alone, str(number))


def bends_of(keys: Iterable[str]) -> list[Parameter]:
    """Return errors of routes or sensors, by their keys in `MachineRun.bends`; (286), (301)."""
    unit = Prior(0.0, 1.0, log=False)
    return [Parameter(f"bends, {key}", "1", unit, "bends", key=key) for key in keys]


def route_numbers(runs: Sequence[MachineRun]) -> list[list[int]]:
    """Return a number for each route of each run, counted in their order; equal routes have the same."""
    known = dict[bytes, int]()
    return [
        [known.setdefault(arcs.length.tobytes() + arcs.angle.tobytes(), len(known)) for arcs in run.routes]
        for run in runs
    ]


def _of_run(run: MachineRun, k: int, runs: int, rig: Rig) -> Iterator[Parameter]:
    of = f" of {run.name}" if runs > 1 else ""
    straight = rig.end.length_m + rig.end.marker_m
    for channel, values in run.measured.items():
        sd = LIMITS.zero * float(np.nanmax(values) - np.nanmin(values)) or 1.0
        middle = float(np.nanmedian(values)) - (straight if channel == "tip_z_m" else 0.0)
        anywhere = unit_of_key(channel) in ("rad", "m") and abs(middle) > 3.0 * sd  # an encoder's own zero
        centre = middle if anywhere else 0.0
        prior = Prior(centre, sd, log=False)
        yield Parameter(f"zero of {channel}{of}", unit_of_key(channel), prior, "zero", k, channel)
    if run.drive == "motor_angle_rad":
        motion = run.given["motor_angle_rad"]
        prior = Prior(float(motion[0]), LIMITS.zero * float(np.ptp(motion)), log=False)
        yield Parameter(f"zero of motor_angle_rad{of}", "rad", prior, "given zero", k, "motor_angle_rad")
    unit = unit_of_key(drive_channels(run.drive, run.tendons)[0])
    for turn, sd in enumerate(run.legs.fitted_se if run.legs is not None else ()):
        prior = Prior(0.0, sd, log=False)
        yield Parameter(f"turn {turn + 1} of the drive{of}", unit, prior, "turn", k, str(turn))
    for which in range(run.tendons):
        name = f"friction of tendon {which + 1} at the start{of}"
        yield Parameter(name, "1", Prior(0.0, 1.0, log=False), "history", k, str(which))
