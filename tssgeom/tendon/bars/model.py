"""A whole measured run through the model with any effects: what each channel should have read.

`predict` is what fits call; `begin` and `carry_on` go through the same run in chunks, down to one sample, and
give the same digits. Source: docs/model.md (50)-(64).
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants_tendon_rows import HELD, PLANT
from tssgeom.effects import AnyEffect, Setup, together
from tssgeom.errors import FitError, SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import edges
from tssgeom.tendon.bars.plant import Memory, Plant, crept, memory_of, moved_plant, plant
from tssgeom.tendon.bars.sensors import CHANNELS as CHANNELS
from tssgeom.tendon.bars.sensors import Drive, Lags, sensed, true_drive, with_histories

BARS = 30
"""Bars of the tendon where nothing else is asked for."""
March: TypeAlias = Callable[..., tuple[int, Vector, Matrix, Matrix]]
_LEAST_COMPLIANCE = 1e-9  # strain per tension below which rounding would be more than stretch [1/N]


@dataclass(frozen=True, slots=True)
class Model:
    """A rig with its effects on one route, ready to go through runs."""

    setup: Setup
    plant: Plant
    drive: Drive
    """The channel that is given."""
    edge: Vector
    """[bars + 1] Where the tendon is cut, as fractions of its length [1]."""


@dataclass(frozen=True, slots=True)
class RunState:
    """Where a run stands after a sample: all that the next one needs."""

    memory: Memory
    time: float
    """Time of the last sample [s]; NaN before the first."""
    temperature: float
    """Temperature of the first sample [°C]; NaN before it."""
    lags: Lags
    """What each lagging channel was given and showed last."""


@dataclass(frozen=True, slots=True)
class RunTrace:
    """A run as the model sees it."""

    channels: dict[str, Vector]
    """[m] What each of `CHANNELS` reads, the drive as it was given [N, m]."""
    slip_out: Vector
    """[m] What the last contact did: +1 slid on a pull, −1 on a release, 0 stuck: the dead zone."""
    tension: Matrix
    """[m, bars + 2] Tension of each bar, from the drive to the load, where asked for; else no rows [N]."""


def predict(
    run: Mapping[str, Vector],
    arcs: Arcs,
    rig: Rig,
    effects: Iterable[AnyEffect] = (),
    *,
    drive: Drive | None = None,
    bars: int = BARS,
    longest_step_s: float = math.inf,
) -> dict[str, Vector]:
    """Return what every channel of a measured run should have read.

    Parameters
    ----------
    run
        Columns of the run: `time_s` [s], the drive, and `temperature_C` where heat matters. Each sample is
        one step from the one before; between samples the drive is taken as monotone.
    arcs
        The route.
    rig, effects
        Tendon, friction and load; effects besides the rig's own.
    drive
        `tension_in_N` or `displacement_in_m`; without it the tension if the run has it, else the position.
    bars
        Bars into which the tendon is cut.
    longest_step_s
        Samples further apart are gone through in several steps, the drive straight between them [s].

    Raises
    ------
    SettingsError
        Where the run has no drive, or effects and rig do not go together.
    FitError
        Where there is no equilibrium.
    """
    model = prepare(run, arcs, rig, effects, drive=drive, bars=bars)
    return carry_on(model, begin(model), run, longest_step_s=longest_step_s)[0].channels


def prepare(
    run: Mapping[str, Vector],
    arcs: Arcs,
    rig: Rig,
    effects: Iterable[AnyEffect] = (),
    *,
    drive: Drive | None = None,
    bars: int = BARS,
) -> Model:
    """Return a rig with effects on a route, to be driven as the run is; arguments and errors as `predict`."""
    chosen = _drive_of(run) if drive is None else drive
    setup = together(setup_of(rig), effects)
    return model_of(setup, arcs, chosen, edges(arcs, bars))


def model_of(setup: Setup, arcs: Arcs, drive: Drive, edge: Vector) -> Model:
    """Return a setup on a route, the tendon cut at the fractions `edge` of its length [bars + 1].

    Raises
    ------
    SettingsError
        Where the tendon does not stretch.
    """
    check_compliance(setup.compliance)
    return Model(setup, plant(setup, arcs, edge), drive, edge)


def check_compliance(compliance: float) -> None:
    """Refuse a tendon that does not stretch; `compliance` is its strain per tension [1/N].

    Raises
    ------
    SettingsError
        Where bars would stretch by less than rounding.
    """
    if compliance < _LEAST_COMPLIANCE:
        raise SettingsError(
            f"tendon.compliance_per_N is {compliance:g} 1/N: a tendon of bars has to stretch; "
            f"give at least {_LEAST_COMPLIANCE:g} 1/N"
        )


def moved(model: Model, arcs: Arcs) -> Model:
    """Return the model with the same tendon on another route, for runs in which the route moves.

    Angles and friction are those of the new route. The bars keep their lengths: more of the sheath in view is
    no longer tendon.
    """
    fresh = moved_plant(model.plant, model.setup, arcs, model.edge)
    return Model(model.setup, fresh, model.drive, model.edge)


def setup_of(rig: Rig) -> Setup:
    """Return the rig's own physics as a setup, its effects included."""
    own = Setup(
        friction=rig.friction.coefficient,
        compliance=rig.tendon.compliance_per_N,
        pretension=rig.tendon.pretension_N,
        load_stiffness=rig.load.stiffness_N_per_m,
    )
    return together(own, rig.effects)


def begin(model: Model) -> RunState:
    """Return the tendon at rest under its pretension, before the first sample."""
    pretension = model.plant.number(PLANT.pretension)
    rows, drive = model.plant.rows, np.zeros(len(HELD))
    drive[HELD.drive] = pretension if model.drive == "tension_in_N" else 0.0
    memory = memory_of(np.full(rows.shape[1], pretension), **crept(model.plant, pretension), drive=drive)
    return RunState(memory, math.nan, math.nan, {})


def carry_on(
    model: Model,
    state: RunState,
    run: Mapping[str, Vector],
    *,
    longest_step_s: float = math.inf,
    profile: bool = False,
    march: March = core.march,
) -> tuple[RunTrace, RunState]:
    """Go through further samples of a run, one or many, and return what they read and where they end.

    The first sample of all is reached in one step as long as the one after it. Arguments as `predict`;
    `profile` asks for the tension of every bar; `march` may keep what `core.march` returned.

    Raises
    ------
    FitError
        Where there is no equilibrium.
    """
    time = np.asarray(run["time_s"], dtype=float)
    spans = np.diff(time, prepend=state.time)
    if math.isnan(state.time):
        spans[0] = spans[1] if len(spans) > 1 else 1.0
    parts = np.ones(len(time), dtype=np.int64)
    if longest_step_s < math.inf:
        parts = np.maximum(np.ceil(spans / longest_step_s - 1e-9), 1.0).astype(np.int64)
    temperature = np.asarray(run.get("temperature_C", np.zeros(len(time))), dtype=float)
    coldest = temperature[0] if math.isnan(state.temperature) else state.temperature
    given = np.array(run[model.drive], dtype=float)
    _check(time, spans, given, temperature, model.drive)
    by_force = model.drive == "tension_in_N"
    elapsed = state.memory.drive[HELD.time] + np.cumsum(spans)
    pulled, late = true_drive(model.setup, model.drive, given, elapsed, spans, state.lags)
    pulled = pulled if by_force else pulled - model.setup.backlash_open_m  # docs/model.md (334)
    rows = len(time) if profile else 0
    done, memory, out, tension = march(
        len(model.edge),
        model.plant.block,
        state.memory.block,
        by_force,
        spans,
        pulled,
        temperature - coldest,
        parts,
        rows,
    )
    if done < len(time):
        raise FitError(
            f"there is no equilibrium of the tendon at {time[done]:g} s, {model.drive} {given[done]:g}: "
            "thin the run less, or check for a jump in the drive"
        )
    ends = [out[0], out[1], out[2] + model.setup.backlash_open_m, out[3]]
    read = sensed(model.setup, np.array(ends), elapsed) | {model.drive: given}
    channels, lags = with_histories(model.setup, read, spans, state.lags, model.drive)
    trace = RunTrace(channels, out[5], read_only(tension))
    return trace, RunState(Memory(memory), float(time[-1]), float(coldest), {**lags, **late})


def _check(time: Vector, spans: Vector, given: Vector, temperature: Vector, drive: str) -> None:
    for name, column in (("time_s", time), (drive, given), ("temperature_C", temperature)):
        if not np.isfinite(column).all():
            at = int(np.argmin(np.isfinite(column)))
            raise SettingsError(f"{name} is missing in sample {at}: leave out such samples")
    if len(spans) > 1 and not spans[1:].min() > 0.0:
        at = 1 + int(np.argmax(spans[1:] <= 0.0))
        raise SettingsError(f"time_s goes from {time[at - 1]:g} to {time[at]:g} s: give increasing times")


def _drive_of(run: Mapping[str, Vector]) -> Drive:
    if "tension_in_N" in run:
        return "tension_in_N"
    if "displacement_in_m" in run:
        return "displacement_in_m"
    raise SettingsError("the run has no drive: it needs a column tension_in_N [N] or displacement_in_m [m]")
