"""A tendon with effects, one step after the other, on a route that stands or moves.

It goes through the same march as a measured run, so that a rig means the same in a stream as in a fit.
Source: docs/model.md (50)-(65), (120).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec.structs import replace as changed

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.core.constants_tendon import BAR
from tssgeom.core.constants_tendon_rows import HELD, LAW
from tssgeom.effects import AnyEffect, Setup
from tssgeom.errors import SettingsError
from tssgeom.rig import Friction, Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.bars.base import direction_after, no_equilibrium, too_much_friction
from tssgeom.tendon.bars.contact_grid import bends_of, discretise, edges, with_bends
from tssgeom.tendon.bars.model import BARS, Model, begin, model_of, moved, setup_of
from tssgeom.tendon.bars.plant import Memory, Plant, crept, load_friction, memory_of
from tssgeom.tendon.bars.sensors import Lags, has_history, sensed, with_histories
from tssgeom.tendon.capstan import Corners, Transmission, tension

_BY_LENGTH = 1e-4  # rad along the whole route, so that positions on straight pieces have an order
_SLACK = 1e-9  # N that stand for no tension in a logarithm
_NO_BENDS = np.empty((0, 3))


def effective_setup(rig: Rig) -> Setup | None:
    """Return the physics of a rig with effects, or None where it does not differ from the base model."""
    return _setup(rig.tendon, rig.friction, rig.load, rig.effects) if rig.effects else None


@lru_cache(maxsize=64)
def _setup(tendon: Tendon, friction: Friction, load: Load, effects: tuple[AnyEffect, ...]) -> Setup | None:
    rig = Rig(tendon=tendon, friction=friction, load=load, effects=effects)
    setup = setup_of(rig)
    return None if setup == setup_of(changed(rig, effects=())) else setup


def timed(setup: Setup) -> bool:
    """Whether any of the effects depends on time."""
    late = bool(setup.lags) or setup.distal_delay_s > 0.0
    curves = any(
        curve.table == "speed" or curve.table.endswith(("time", "time_gain")) for curve in setup.curves
    )
    return bool(setup.creep_ratio or setup.drag_Ns_per_m2 or setup.speed_gain or late or curves)


def cut(along: Corners, arcs: Arcs, setup: Setup) -> BarState:
    """Cut a tendon into bars on a route, with the tension that it has along it.

    What the corners do not hold is as in a tendon that came to these tensions slowly: nothing is slack or has
    crept, and backlash is engaged for pulling; docs/model.md (120).
    """
    model = model_of(setup, arcs, "tension_in_N", edges(arcs, BARS))
    memory = begin(model).memory
    if len(along.angle) > 1 or along.tension_in != setup.pretension:
        mean_angle = discretise(model.edge, arcs).mean_angle
        held = tension(along, np.concatenate(([0.0], mean_angle, [arcs.total_angle])))
        gained = model.plant.stretch(held) - model.plant.rows[LAW.rest]
        shift = np.cumsum(gained[::-1])[::-1]  # contacts and drive, where the tensions have them; (51)
        drive = np.zeros(len(HELD))
        drive[[HELD.drive, HELD.engaged, HELD.shift]] = held[0], shift[0], shift[0]
        creep = crept(model.plant, setup.pretension)
        memory = memory_of(held, **creep, displacement=shift[1:], drive=drive)
    out = memory.tension[-1] - setup.pretension
    displacement_in = float(memory.drive[HELD.shift])
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
        load_friction=load_friction(setup),
    )


def model_on(state: BarState, route: Arcs, setup: Setup) -> Model:
    """Return the rig on the route on which the tendon lies."""
    if state.model is not None and state.model.setup is setup:
        return state.model
    cut = route if state.cut is None else state.cut
    first = model_of(setup, cut, "tension_in_N", state.edge)
    return first if route is cut else moved(first, route)


def driven(
    state: BarState,
    model: Model,
    routes: tuple[Arcs, Arcs],
    drive: tuple[float, bool],
    span: float,
    temperature: float | None,
    friction: tuple[float, float],
) -> tuple[BarState, Arcs]:
    """Drive the tendon; return its state and the route on which it lies: the second where that has moved.

    Parameters
    ----------
    state
        The tendon before the step.
    model
        The rig on the first route.
    routes
        The route before the step, and as sensed after it.
    drive
        True tension [N] or position [m], and whether it is a tension.
    span
        Time that the step takes [s].
    temperature
        Temperature at the end of the step [°C]; None where it is as before.
    friction
        Base coefficient μ, and the most of μΦ that is stepped [1].

    Raises
    ------
    SettingsError
        Where μΦ is too much.
    FitError
        Where there is no equilibrium.
    """
    first, warmth = _warmth(state, temperature)
    before, now = routes
    goal, by_force = drive
    taken_up = model.setup.backlash_open_m  # docs/model.md (334)
    goal = goal if by_force else goal - taken_up
    done, block, laws, ends = core.step_with_effects(
        state.edge,
        model.plant.block,
        state.memory.block,
        before.length,
        before.angle,
        before.noise_covariance,
        now.length,
        now.angle,
        now.noise_covariance,
        bends_of(model.setup) if model.setup.bends else _NO_BENDS,
        before is not now,
        *friction,
        goal,
        by_force,
        state.by_force,
        state.displacement_in - taken_up,
        state.front,
        span,
        warmth,
    )
    ends[2] += taken_up
    numbers = ends.tolist()
    if numbers[9] > friction[1]:
        raise too_much_friction(friction[0], numbers[9] / friction[0])
    if done == 0:
        raise no_equilibrium(goal, by_force)
    displacement_in, displacement_out, slip, _, last_drive, front, moves, _ = numbers[2:]
    after = BarState(
        edge=state.edge,
        memory=Memory(block),
        displacement_in=displacement_in,
        displacement_out=displacement_out,
        elongation=displacement_in - displacement_out,  # docs/model.md (121)
        direction_index=direction_after(int(slip), goal - last_drive, state.direction_index),
        length=state.length,
        cut=state.cut,
        by_force=by_force,
        span=span,
        temperature=first,
        lags=_lagging(model.setup, ends, span, state) if has_history(model.setup) else {},
        front=int(front),
        model=Model(model.setup, Plant(laws), model.drive, model.edge) if moves else model,
        load_friction=state.load_friction,
    )
    return after, now if moves else before


def transmit(state: BarState, model: Model, arcs: Arcs) -> Transmission:
    """Return tension, elongation and dead zone of a tendon with effects; docs/model.md (121)-(123)."""
    way = state.direction_index
    ends = core.transmit_with_effects(
        model.edge,
        model.plant.block,
        state.memory.block,
        arcs.length,
        arcs.angle,
        arcs.covariance,
        way,
        state.front,
    )
    elongation_se, tension_out_se, width, replied, front = ends.tolist()
    return Transmission(
        tension_in=state.tension_in,
        tension_out=state.tension_out,
        elongation=state.elongation,
        elongation_se=elongation_se,
        tension_out_se=tension_out_se,
        direction_index=way,
        dead_zone=not replied,
        dead_zone_width=width,
        slip_front=front,
        displacement_in=state.displacement_in,
        displacement_out=state.displacement_out,
    )


def answering(state: BarState, model: Model, load_tension: float, way: int) -> float:
    """Return the proximal tension from which on a slow pull (+1) or release (−1) moves the load [N].

    `load_tension` is what is left behind the friction of the load then [N]; docs/model.md (122).
    """
    return core.answering(len(state.edge), model.plant.block, state.memory.block, load_tension, way)


def readings(state: BarState, setup: Setup) -> dict[str, float]:
    """Return what the sensors read after a step [N, m], by the names of `CHANNELS`; docs/model.md (61)."""
    true = (state.tension_in, state.tension_out, state.displacement_in, state.displacement_out)
    elapsed = state.memory.drive[HELD.time : HELD.time + 1]
    read = {name: float(value[0]) for name, value in sensed(setup, np.array(true)[:, None], elapsed).items()}
    return read | {channel: kept[1] for channel, kept in state.lags.items()}


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
    held = np.maximum(state.along, _SLACK)
    return np.exp(np.interp(at, known, np.log(held)))


def step_span(before: float, time: float | None, last: float, setup: Setup) -> float:
    """Return how long a step from the time `before` lasts [s]; at that time as long as the `last` one [s]."""
    if not timed(setup):
        return BAR.untimed
    if time is None:
        raise SettingsError("some of the effects act over time: give the time of each step [s]")
    if math.isnan(before):
        return BAR.untimed
    if time < before:
        raise SettingsError(f"time goes from {before:g} to {time:g} s: give increasing times")
    return time - before if time > before else last


def _warmth(state: BarState, temperature: float | None) -> tuple[float, float]:
    """Return the first temperature [°C], and how much warmer it is now [K]; NaN where it is as before."""
    if temperature is None:
        return state.temperature, math.nan
    if not math.isfinite(temperature):
        raise SettingsError(f"the temperature is {temperature:g} °C: give a finite one, or leave it out")
    first = temperature if math.isnan(state.temperature) else state.temperature
    return first, temperature - first


def _lagging(setup: Setup, ends: Vector, span: float, before: BarState) -> Lags:
    elapsed = before.memory.drive[HELD.time : HELD.time + 1] + span
    return with_histories(setup, sensed(setup, ends[:4, None], elapsed), np.array([span]), before.lags)[1]
