"""A tendon with effects, one step after the other, on a route that stands or moves.

It goes through the same march as a measured run, so that a rig means the same in a stream as in a fit.
Source: docs/model.md (50)-(65), (120).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec.structs import replace as changed
from numba import njit

from tssgeom.arrays import Vector
from tssgeom.effects import Library, Setup
from tssgeom.errors import SettingsError
from tssgeom.rig import Friction, Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.bars.base import direction_after, no_equilibrium
from tssgeom.tendon.bars.contact_grid import discretise, edges, with_bends
from tssgeom.tendon.bars.march import march
from tssgeom.tendon.bars.model import BARS, Model, begin, model_of, moved, setup_of
from tssgeom.tendon.bars.plant import Memory, stretch_of
from tssgeom.tendon.bars.sensors import Lags, sensed, with_lags
from tssgeom.tendon.capstan import Corners, tension

_BY_LENGTH = 1e-4  # rad along the whole route, so that positions on straight pieces have an order
_SLACK = 1e-9  # N that stand for no tension in a logarithm
_ONE, _NO_PROFILE = np.ones(1, dtype=np.int64), np.empty((0, 0))


def effective_setup(rig: Rig) -> Setup | None:
    """Return the physics of a rig with effects, or None where it does not differ from the base model."""
    return _setup(rig.tendon, rig.friction, rig.load, rig.effects) if rig.effects else None


@lru_cache(maxsize=64)
def _setup(tendon: Tendon, friction: Friction, load: Load, effects: tuple[Library, ...]) -> Setup | None:
    rig = Rig(tendon=tendon, friction=friction, load=load, effects=effects)
    setup = setup_of(rig)
    return None if setup == setup_of(changed(rig, effects=())) else setup


def timed(setup: Setup) -> bool:
    """Whether any of the effects depends on time."""
    return bool(setup.creep_ratio or setup.drag_Ns_per_m2 or setup.speed_gain or setup.lags)


def cut(along: Corners, arcs: Arcs, setup: Setup) -> BarState:
    """Cut a tendon into bars on a route, with the tension that it has along it.

    What the corners do not hold is as in a tendon that came to these tensions slowly: nothing is slack or has
    crept, and backlash is engaged for pulling; docs/model.md (120).
    """
    model = model_of(setup, arcs, "tension_in_N", edges(arcs, BARS))
    memory = begin(model).memory
    if len(along.angle) > 1 or along.tension_in != setup.pretension:
        mean_angle = discretise(model.edge, arcs).mean_angle
        memory.tension[:] = tension(along, np.concatenate(([0.0], mean_angle, [arcs.total_angle])))
        _put(model, memory)
    out = memory.tension[-1] - setup.pretension
    displacement_in = float(memory.drive[4])
    displacement_out = float(out / setup.load_stiffness) if setup.load_stiffness > 0.0 else 0.0
    return BarState(
        edge=model.edge,
        memory=memory,
        displacement_in=displacement_in,
        displacement_out=displacement_out,
        elongation=displacement_in - displacement_out,  # docs/model.md (121)
        direction_index=along.direction_index,
        length=arcs.total_length,
        cut=arcs,
        model=model,
    )


def _put(model: Model, memory: Memory) -> None:
    """Put every contact, and the drive, where the tensions of the bars have it; docs/model.md (51)."""
    plant = model.plant
    gained = [stretch_of(plant, j, float(pull)) - plant.rest[j] for j, pull in enumerate(memory.tension)]
    shift = np.cumsum(gained[::-1])[::-1]
    memory.displacement[:] = shift[1:]
    memory.drive[0], memory.drive[2], memory.drive[4] = memory.tension[0], shift[0], shift[0]


def model_on(state: BarState, route: Arcs, setup: Setup) -> Model:
    """Return the rig on the route on which the tendon lies."""
    if state.model is not None and state.model.setup is setup:
        return state.model
    cut = route if state.cut is None else state.cut
    first = model_of(setup, cut, "tension_in_N", state.edge)
    return first if route is cut else moved(first, route)


def driven(
    state: BarState, model: Model, drive: float, by_force: bool, span: float, temperature: float | None
) -> BarState:
    """Drive the tendon to a tension [N] or a position [m] within `span` [s], on the route of the model.

    Parameters
    ----------
    state
        The tendon before the step.
    model
        The rig on the route after the step.
    drive, by_force
        True tension [N], or position [m].
    span
        Time that the step takes [s].
    temperature
        Temperature at the end of the step [°C]; None where it is as before.

    Raises
    ------
    FitError
        Where no equilibrium was found.
    """
    memory = Memory(*(array.copy() for array in state.memory))
    if by_force != state.by_force:
        _switch(memory, state.displacement_in, by_force)
    first, warmth = _warmth(state, memory, temperature)
    out, before = np.empty((6, 1)), float(memory.drive[0])
    spans, drives = np.array([span]), np.array([drive])
    done = march(model.plant, memory, by_force, spans, drives, np.array([warmth]), _ONE, out, _NO_PROFILE)
    if done == 0:
        raise no_equilibrium(drive, by_force)
    displacement_in, displacement_out = float(out[2, 0]), float(out[3, 0])
    return BarState(
        edge=state.edge,
        memory=memory,
        displacement_in=displacement_in,
        displacement_out=displacement_out,
        elongation=displacement_in - displacement_out,  # docs/model.md (121)
        direction_index=direction_after(int(memory.slip[0]), drive - before, state.direction_index),
        length=state.length,
        cut=state.cut,
        by_force=by_force,
        span=span,
        temperature=first,
        lags=_lagging(model.setup, out, spans, state.lags),
        front=_front(memory.slip, state.front, drive == before),
        model=model,
    )


def readings(state: BarState, setup: Setup) -> dict[str, float]:
    """Return what the sensors read after a step [N, m], by the names of `CHANNELS`; docs/model.md (61)."""
    true = (state.tension_in, state.tension_out, state.displacement_in, state.displacement_out)
    read = {name: float(value[0]) for name, value in sensed(setup, np.array(true)[:, None]).items()}
    return read | {channel: last for channel, (_, last) in state.lags.items()}


def tension_along(state: BarState, route: Arcs, s: Vector) -> Vector:
    """Return the tension [N] at arc lengths `s` [m].

    Between the middles of the bars ln T is linear in the angle that presses, or in the length where none
    does.
    """
    felt = route if state.model is None else with_bends(state.model.setup, route)
    whole = route.total_length
    ends = np.concatenate(([0.0], np.cumsum(felt.length)))
    phi = np.concatenate(([0.0], np.cumsum(felt.angle)))
    middle = 0.5 * (state.edge[1:] + state.edge[:-1])
    means = discretise(state.edge, felt).mean_angle + _BY_LENGTH * middle
    known = np.concatenate(([0.0], means, [phi[-1] + _BY_LENGTH]))
    at = np.interp(s, ends, phi) + _BY_LENGTH * s / whole
    held = np.maximum(state.memory.tension, _SLACK)
    return np.exp(np.interp(at, known, np.log(held)))


def _switch(memory: Memory, displacement_in: float, by_force: bool) -> None:
    """Go from one kind of drive to the other: the tendon's end and the drive stay where they are; (59)."""
    drive = memory.drive
    if by_force:
        drive[0], drive[3], drive[4] = memory.tension[0], drive[2] - displacement_in, drive[2]
    else:
        drive[0], drive[2] = displacement_in, drive[4]
    drive[5] = 0.0


def _warmth(state: BarState, memory: Memory, temperature: float | None) -> tuple[float, float]:
    """Return the first temperature [°C], and how much warmer it is now [K]."""
    if temperature is None:
        return state.temperature, float(memory.drive[1])
    if not math.isfinite(temperature):
        raise SettingsError(f"the temperature is {temperature:g} °C: give a finite one, or leave it out")
    first = temperature if math.isnan(state.temperature) else state.temperature
    return first, temperature - first


def _lagging(setup: Setup, out: np.ndarray, spans: Vector, before: Lags) -> Lags:
    return with_lags(setup, sensed(setup, out), spans, before)[1] if setup.lags else {}


@njit(cache=True, nogil=True)
def _front(slip, before, stands):
    """Return how many contacts from the drive on slid one way; as before where nothing moved there."""
    if slip[0] == 0:
        return before if stands else 0
    count = 1
    while count < slip.size and slip[count] == slip[0]:
        count += 1
    return count
