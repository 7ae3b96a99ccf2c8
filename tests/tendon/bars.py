"""Bars of a tendon for tests: routes, rigs, and laws that no rig has."""

import math

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from tests.tendon.steps import pretensioned_bars, step
from tssgeom.core.constants_tendon_rows import LAW, PLANT
from tssgeom.effects import Setup
from tssgeom.rig import Friction, Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.base import one_drive, step_on
from tssgeom.tendon.bars.plant import Plant, plant

MU, RHO, PI = 0.145, 3.16e-4, math.pi  # the paper's tendon and sheath, section III-B
HALF_CIRCLE = Arcs.exact([0.5], [PI])
WITH_STRAIGHTS = Arcs.exact([0.1, 0.3, 0.1], [0.0, PI, 0.0])
STRAIGHT = Arcs.exact([0.5], [0.0])
HALF, LOOP = PI * 0.0847, 2 * PI * 0.0372  # radii inferred from figure 6 of the paper [m]
SETUP_A = Arcs.exact([HALF, LOOP], [PI, 2 * PI])
SETUP_B = Arcs.exact([LOOP, HALF], [2 * PI, PI])

# An equilibrium is accepted at 1e-10 of the greatest tension on the way, which may be many times the last.
SOLVED = 1e-7

untimed = settings(deadline=None, max_examples=30)
tensions = st.one_of(st.just(0.0), st.floats(0.1, 30.0))
histories = st.lists(tensions, min_size=1, max_size=8)
pieces = st.lists(
    st.tuples(st.floats(0.02, 0.3), st.one_of(st.just(0.0), st.floats(0.01, 3.0))), min_size=1, max_size=5
)


def rig(pretension=0.0, friction=MU, stiffness=1000.0):
    return Rig(
        tendon=Tendon(pretension_N=pretension),
        friction=Friction(coefficient=friction),
        load=Load(stiffness_N_per_m=stiffness),
    )


def arcs_of(lengths_and_angles):
    length, angle = np.array(lengths_and_angles).T
    return Arcs.exact(length, angle)


def driven(history, arcs, hardware, bars=60):
    state = pretensioned_bars(hardware, arcs, bars)
    for tension_in in history:
        state = step(state, arcs, hardware, tension_in=tension_in)
    return state


def blocked(state, arcs, hardware, *, stretches_with_route=True, **drive):
    """Step a tendon whose distal end is fixed, which no rig states."""
    goal = one_drive(drive.get("tension_in"), drive.get("displacement_in"))
    return step_on(state, (arcs, arcs), hardware, math.inf, goal, stretches_with_route, math.inf)[0]


def plant_on(state, arcs, stiffness=1000.0, pretension=0.0, friction=MU, **numbers):
    """Laws of bars and contacts on a route; `numbers` are those of `Setup`."""
    setup = Setup(friction, RHO, pretension, stiffness, **numbers)
    return plant(setup, arcs, state.edge)


def with_laws(laws, **changed):
    """Return laws with other rows, by the names of `LawRows`, and numbers, by those of `PlantNumbers`."""
    result = Plant(laws.block.copy())
    for name, values in changed.items():
        if name in LAW._fields:
            result.rows[getattr(LAW, name), : np.size(values) if np.ndim(values) else None] = values
        else:
            result.set(getattr(PLANT, name), values)
    return result
