"""A whole run through the model: tension, elongation and phase at each time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import repeat
from typing import Literal

from tssgeom.arrays import Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.errors import TssgeomError
from tssgeom.rig import Rig
from tssgeom.tendon.bars.model import setup_of
from tssgeom.tendon.bars.sensors import Drive, check_drive
from tssgeom.tendon.capstan import Transmission
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import Step, variants_of, with_rig_errors
from tssgeom.tendon.commander import Commander, Target, commander_of
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.sensor_errors import readings, sensors_err, true_tension
from tssgeom.tendon.state import TendonState, pretensioned, step, transmit
from tssgeom.uncertain import Uncertain

Phase = Literal["pull", "pull_to_release", "release", "release_to_pull", "hold"]
"""The four phases of the paper's figure 5, those with `_to_` being dead zones; and a drive that rests."""


@dataclass(frozen=True, slots=True)
class Measured:
    """Columns of one run, in SI; NaN where a reading is missing."""

    time: Vector
    """[n] [s]."""
    tension_in: Vector | None = None
    """[n] Total tension at the proximal end [N]."""
    displacement_in: Vector | None = None
    """[n] Of the tendon at the proximal end [m]."""
    tension_out: Vector | None = None
    """[n] Total tension at the distal end [N]."""
    elongation: Vector | None = None
    """[n] Displacement of the proximal less that of the distal end [m]."""
    temperature: Vector | None = None
    """[n] Temperature [°C]."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The tendon at one time of a run."""

    time: float
    """[s]."""
    state: TendonState
    """Tension along the tendon."""
    transmission: Transmission
    """Tension at both ends, elongation and displacements, with their standard errors."""
    phase: Phase
    """What the tendon does: pull, release, a dead zone between them, or hold."""
    readings: Mapping[str, float]
    """What the sensors read, by the names of the columns of a run [N, m]; empty where these are true."""
    counts_rig: bool = False
    """Whether standard errors count what the rig states of its own errors beside those of the route."""


def simulate(
    time: Vector,
    route: MovingRoute,
    rig: Rig,
    *,
    tension_in: Vector | None = None,
    displacement_in: Vector | None = None,
    temperature: Vector | None = None,
    state: TendonState | None = None,
    uncertain: Sequence[Uncertain] = (),
) -> Iterator[Moment]:
    """Drive a tendon through a run, one moment for each of its times.

    Parameters
    ----------
    time
        [n] Times of the run [s].
    route
        The route over time.
    rig
        Tendon, friction, load and effects.
    tension_in, displacement_in
        [n] Total tension [N] or position [m] of the drive; one of them. A tension is what its sensor reads,
        which is not the true one where effects spoil that sensor; docs/model.md (61).
    temperature
        [n] Temperature [°C]; the same throughout where left out.
    state
        Tension along the tendon before the run; the rig's pretension by default.
    uncertain
        Numbers of the rig that have an error.

    Raises
    ------
    SettingsError, FitError
        As `tssgeom.tendon.state.step`; where the sensor of the drive lags, or a number of the rig is out of
        bounds a standard deviation from its value.

    Notes
    -----
    Sources: docs/model.md (1) to (6), (40) to (47), (212), (354); Sun, Wang and Phee (2014), Theorem 1 and
    Fig. 5.
    """
    current = _begun(time, rig) if state is None else state
    name: Drive = "displacement_in_m" if tension_in is None else "tension_in_N"
    check_drive(setup_of(rig), name)
    counts = bool(uncertain or rig.unexplained)
    variants, last = variants_of(rig, uncertain, current) if counts else (), None
    rows = zip(
        time, _each(tension_in, time), _each(displacement_in, time), _each(temperature, time), strict=True
    )
    for moment, read, position, warm in rows:
        arcs = route.at(float(moment))
        with _at(float(moment)):
            pull = None if read is None else true_tension(rig, read)
            current = step(
                current,
                arcs,
                rig,
                tension_in=pull,
                displacement_in=position,
                time=float(moment),
                temperature=warm,
            )
            at = Step(arcs, float(moment), warm)
            variants = tuple(each.driven(at, position, pull) for each in variants)
        ends, drive = transmit(current, rig), position if read is None else read
        if counts:
            ends = with_rig_errors(ends, variants, rig, current.route, by_tension=read is not None)
        sensed = readings(current, rig) | {name: drive or 0.0} if sensors_err(rig) else {}
        yield Moment(float(moment), current, ends, _phase(last, drive or 0.0, ends), sensed, counts)
        last = drive or 0.0


def commands(
    time: Vector,
    route: MovingRoute,
    rig: Rig,
    *,
    tension_out: Vector | None = None,
    displacement_out: Vector | None = None,
    temperature: Vector | None = None,
    commander: Commander | None = None,
) -> Iterator[Command]:
    """Return the command for each time of a run with targets of its distal end [n]; see `Commander`."""
    state, commander = _begun(time, rig), commander or commander_of(rig)
    targets = (_each(tension_out, time), _each(displacement_out, time))
    for moment, force, position, warm in zip(time, *targets, _each(temperature, time), strict=True):
        arcs = route.at(float(moment))
        with _at(float(moment)):
            at, elapsed = Step(arcs, float(moment), warm), float(moment) - state.time
            known = elapsed if elapsed >= 0.0 else 0.0
            command, commander = commander.command(state, at, Target(position, force), elapsed=known)
        state = command.state
        yield command


def _begun(time: Vector, rig: Rig) -> TendonState:
    """Return the tendon before a run: its first row takes as long as the next one."""
    return pretensioned(rig, float(time[0] - (time[1] - time[0])) if len(time) > 1 else math.nan)


@contextmanager
def _at(time: float) -> Iterator[None]:
    """Say in errors at which time of the run they came up."""
    try:
        yield
    except TssgeomError as error:
        raise type(error)(f"at time_s = {time:g}: {error}") from error


def _each(values: Vector | None, time: Vector) -> Iterable[float | None]:
    """Return the values one by one, or None for each time."""
    return repeat(None, len(time)) if values is None else map(float, values)


def _phase(last: float | None, drive: float, ends: Transmission) -> Phase:
    """Return the phase after a move of the drive from `last`, in the unit of the drive."""
    if last is not None and abs(drive - last) <= ROUNDING.exact * max(abs(drive), abs(last)):
        return "hold"
    if ends.direction_index > 0:
        return "release_to_pull" if ends.dead_zone else "pull"
    return "pull_to_release" if ends.dead_zone else "release"
