"""A whole run through the model: what the tendon does, and which phase of its cycle it is in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import repeat
from typing import Literal

from tssgeom.arrays import Vector
from tssgeom.errors import TssgeomError
from tssgeom.settings import Rig
from tssgeom.tendon.compensation import Command, compensate
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.profile import RESOLUTION
from tssgeom.tendon.state import TendonState, pretensioned, step, transmit
from tssgeom.tendon.transmission import Transmission

Phase = Literal["pull", "pull_to_release", "release", "release_to_pull", "hold"]
"""The four phases of the paper's figure 5, those with `_to_` being dead zones; and a drive that rests."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The tendon at one time of a run."""

    time: float
    """[s]."""
    state: TendonState
    transmission: Transmission
    phase: Phase


def simulate(
    time: Vector,
    route: MovingRoute,
    rig: Rig,
    *,
    tension_in: Vector | None = None,
    displacement_in: Vector | None = None,
    state: TendonState | None = None,
) -> Iterator[Moment]:
    """Drive a tendon through a run, one moment for each of its times.

    Parameters
    ----------
    time
        [n] Times of the run [s].
    route
        The route over time.
    rig
        Tendon, friction and load.
    tension_in, displacement_in
        [n] Total tension [N] or position [m] of the drive; one of them.
    state
        Tension along the tendon before the run; the rig's pretension by default.

    Raises
    ------
    SettingsError, FitError
        As `tssgeom.tendon.state.step`.
    """
    current = pretensioned(rig) if state is None else state
    last: float | None = None
    for moment, force, place in zip(time, _each(tension_in, time), _each(displacement_in, time), strict=True):
        with _at(float(moment)):
            current = step(current, route.at(float(moment)), rig, tension_in=force, displacement_in=place)
        seen, drive = transmit(current, rig), place if force is None else force
        yield Moment(float(moment), current, seen, _phase(last, drive or 0.0, seen))
        last = drive or 0.0


def commands(
    time: Vector,
    route: MovingRoute,
    rig: Rig,
    *,
    tension_out: Vector | None = None,
    displacement_out: Vector | None = None,
) -> Iterator[Command]:
    """Return the command for each time of a run whose distal end is told [n]; see `compensate`."""
    state = pretensioned(rig)
    pairs = zip(time, _each(tension_out, time), _each(displacement_out, time), strict=True)
    for moment, force, place in pairs:
        arcs = route.at(float(moment))
        with _at(float(moment)):
            command = compensate(state, arcs, rig, tension_out=force, displacement_out=place)
        state = command.state
        yield command


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


def _phase(last: float | None, drive: float, seen: Transmission) -> Phase:
    """Return the phase after a move of the drive from `last`, in the unit of the drive."""
    if last is not None and abs(drive - last) <= RESOLUTION * max(abs(drive), abs(last)):
        return "hold"
    if seen.direction_index > 0:
        return "release_to_pull" if seen.dead_zone else "pull"
    return "pull_to_release" if seen.dead_zone else "release"
