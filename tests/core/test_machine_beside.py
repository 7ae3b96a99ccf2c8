"""Machines beside one that is marched, whose twin is the march of each by itself; docs/model.md (298)."""

import math
from typing import Any

import numpy as np
import pytest

from tssgeom import core
from tssgeom.core.constants_tendon_rows import LAW, PLANT
from tssgeom.effects import KINDS, FrictionLaw, Setup, together, with_size
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import equal_edges
from tssgeom.tendon.bars.plant import memory_of, plant

EDGE = equal_edges(4)
NUMBERS = 9
STEP = 1e-6  # of each number; contacts of both marches begin to slide in the same samples but for chance
SAMPLES = 60
LAWS = [
    *("creep", "toe_region", "load_dependent_friction", "velocity_dependent_friction", "friction_drift"),
    *("presliding", "viscous_drag", "end_fitting_friction_proximal", "end_fitting_friction_distal"),
    *("slack_take_up", "backlash", "thermal_drift", "friction_over_speed"),
]


def law_of(name, size):
    """An effect of some size; friction over speed falls, and follows it late."""
    if name != "friction_over_speed":
        return with_size(KINDS[name], size)
    speeds = 2e-3 * np.linspace(0.0, 1.0, 8)
    factors = 1.0 + 0.4 * size * np.exp(-speeds / 5e-4)
    return FrictionLaw(over="speed", x=tuple(speeds), factor=tuple(factors), memory_s=0.3)


def machine_at(x, names, tendons, coordinates, by_force):
    """Arguments of one machine by numbers about 0 [9]; the routes, the drives and the laws follow them."""
    effects = [law_of(name, 1.0 + 0.3 * x[0]) for name in names]
    setup = together(
        Setup(0.15 * math.exp(x[1]), 3e-4 * math.exp(x[2]), 5.0 * math.exp(x[3]), math.inf), effects
    )
    plants, memories = [], []
    for i in range(tendons):
        arcs = Arcs.exact(np.array([0.2, 0.15]) + 0.02 * i, np.array([1.0 + 0.5 * x[4], 0.8 - 0.3 * x[5]]))
        made = plant(setup, arcs, EDGE)
        made.rows[LAW.soft, [0, -1]] = 2e-5
        made.rows[LAW.rest] = made.stretch(5.0)
        made.set(PLANT.swift, 0.0)
        made.set(PLANT.load, math.inf)
        tension = np.full(len(EDGE) + 1, 5.0 + x[6])
        rest = made.stretch(tension) - made.rows[LAW.rest]
        plants.append(made.block)
        memories.append(memory_of(tension, rest=rest, creep=made.rows[LAW.creep_soft] * tension).block)
    angles, time = np.linspace(0.0, 2.0 * math.pi, tendons, endpoint=False), np.linspace(0.0, 12.0, SAMPLES)
    around = np.column_stack([np.cos(angles), np.sin(angles)])[:, :coordinates]
    motion = np.sin(time[:, None] + 0.7) * around[:, 0] * (1.0 + x[7])
    drive = 6.0 + 4.0 * motion if by_force else 4e-3 * motion
    torque = 0.01 * (1.0 + x[5]) * np.array([-2.0, -0.3, 0.0, 0.1, 3.0])
    law = core.table_of(np.array([-0.5, -0.2, 0.0, 0.2, 0.5]), torque)
    return {
        "plant": np.concatenate(plants),
        "memory": np.concatenate(memories),
        "proximal": np.zeros(tendons * coordinates),
        "distal": (0.008 * (1.0 + 0.1 * x[8]) * around).ravel(),
        "stiffness": np.full(coordinates, 0.2 * math.exp(x[8])),
        "holds": np.tile(np.concatenate([[0.03, 0.2 + x[7], 0.05 * (1.0 + x[6])], law]), coordinates),
        "friction": np.array(0.0 if coordinates > 1 else 0.004 * math.exp(x[5])),
        "at_rest": np.zeros(coordinates),
        "start": np.zeros(coordinates),
        "drive": drive.ravel(),
        "end": np.zeros(SAMPLES * tendons),
        "load": np.tile(0.01 * np.cos(2.0 * time + x[6])[:, None], coordinates).ravel(),
    }


NAMES = tuple(machine_at(np.zeros(NUMBERS), [], 1, 1, False))
SPANS, WARMTH = np.full(SAMPLES, 0.2), 3.0 * np.sin(np.linspace(0.0, 3.0, SAMPLES))


def beside(machines, tendons, by_force):
    """March the first machine, and the others beside it; returns both ends and the coordinates [c, …]."""
    given = [np.array([each[name] for each in machines]) for name in NAMES]
    march: Any = core.march_beside
    done, after, where, ends = march(tendons, len(EDGE), *given[:9], by_force, SPANS, *given[9:], WARMTH)
    assert done == SAMPLES
    return np.hstack([ends, where]), after


def alone(machine, tendons, by_force):
    """Do the same by the march of one machine."""
    m, rows = len(machine["stiffness"]), (tendons, -1)
    done, after, where, ends, _ = core.march_machine(
        len(EDGE), machine["plant"].reshape(rows), machine["memory"].reshape(rows),
        machine["proximal"].reshape(tendons, m), machine["distal"].reshape(tendons, m), machine["stiffness"],
        machine["holds"].reshape(m, 40), np.full(m, machine["friction"]), machine["at_rest"],
        machine["start"], by_force, SPANS, machine["drive"].reshape(-1, tendons),
        machine["end"].reshape(-1, tendons), machine["load"].reshape(-1, m), WARMTH, 0,
    )  # fmt: skip
    assert done == SAMPLES
    return np.concatenate([ends.ravel(), where.ravel()]), after


@pytest.mark.parametrize("name", ["none", *LAWS])
@pytest.mark.parametrize(("tendons", "coordinates", "by_force"), [(2, 1, False), (3, 2, False), (1, 1, True)])
def test_what_small_changes_make_is_what_marches_of_their_own_make(name, tendons, coordinates, by_force):
    names = [] if name == "none" else [name]
    kind = (names, tendons, coordinates, by_force)
    numbers = np.vstack([np.zeros(NUMBERS), STEP * np.eye(NUMBERS)])
    machines = [machine_at(x, *kind) for x in numbers]
    result, after = beside(machines, tendons, by_force)
    own, own_after = alone(machines[0], tendons, by_force)
    np.testing.assert_array_equal(result[0], own)  # the first is marched as ever
    np.testing.assert_array_equal(after[0], own_after.ravel())
    for j in range(NUMBERS):
        above, below = (
            alone(machine_at(way * numbers[j + 1], *kind), tendons, by_force)[0] for way in (1, -1)
        )
        wanted, given = (above - below) / (2.0 * STEP), (result[j + 1] - result[0]) / STEP
        off = np.abs(given - wanted)
        size = np.maximum(np.abs(wanted), 1e-3 * np.abs(wanted).max() + 1e-9)
        # laws that are solved by passes leave 1e-8 of a tension, of a step of 1e-6
        assert np.quantile(off / size, 0.9) < 1e-2, j
        assert np.median(off / size) < 1e-3, j


def test_what_has_no_finite_answer_is_nan_and_leaves_the_others():
    kind = ([], 2, 1, False)
    machines = [machine_at(x, *kind) for x in (np.zeros(NUMBERS), np.full(NUMBERS, STEP), np.zeros(NUMBERS))]
    machines[1]["drive"][30] = math.nan
    result, _ = beside(machines, 2, False)
    assert np.isnan(result[1]).any()
    np.testing.assert_array_equal(result[2], result[0])
