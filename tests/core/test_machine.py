"""Tendons on one mechanism in the core, beside the twin of their laws and a root finder of scipy."""

import math
import time

import numpy as np
import pytest
from scipy.optimize import brentq, root

from tests.adapt.machine_cases import arcs_of, rig_of
from tests.core.twins.tendon_laws import balanced, remembered, unpacked, workspace
from tests.twins.mechanisms import segment
from tssgeom import core
from tssgeom.core.constants_tendon_rows import LAW, PLANT, TABLE
from tssgeom.effects import KINDS, Setup, together, with_size
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import equal_edges
from tssgeom.tendon.bars.plant import memory_of, plant
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine

NAMES = ["creep", "toe_region", "load_dependent_friction", "end_fitting_friction_proximal", "hidden_bend"]
SOLVED = 1e-6  # of a tension; both solve the bars to 1e-10 and the coordinates to 1e-9 of the forces


def tendon(rng, names):
    """Plant and memory of one tendon of few bars with a soft bar at each end."""
    setup = together(Setup(rng.uniform(0.05, 0.3), 3e-4, 5.0, math.inf), [with_size(KINDS[n]) for n in names])
    edge = equal_edges(4)
    made = plant(setup, Arcs.exact(rng.uniform(0.1, 0.4, 2), rng.uniform(0.0, 2.0, 2)), edge)
    made.rows[LAW.soft, [0, -1]] = 2e-5
    made.rows[LAW.rest] = made.stretch(5.0)
    made.set(PLANT.swift, 0.0)
    tension = np.full(len(edge) + 1, 5.0)
    return made, memory_of(tension, creep=made.rows[LAW.creep_soft] * 5.0), edge


def holding(*rows):
    """What holds coordinates by weight and hardening, without a table."""
    return np.array([[*row, *np.zeros(TABLE.size)] for row in rows])


def twin_ends(laws, memory, drive, end, span):
    """Return what a step to these positions of both ends leaves."""
    after, _ = remembered(memory.block)
    rest = np.array(laws.rest)
    rest[-1] -= end
    cone, room = workspace(laws)
    balanced(laws, after, False, drive, 0.0, 0.0, span, rest, cone, room)
    return after


@pytest.mark.parametrize("name", ["none", *NAMES])
def test_a_joint_between_two_tendons_is_where_the_twin_balances(name):
    rng = np.random.default_rng(NAMES.index(name) if name in NAMES else 7)
    names = [] if name == "none" else [name]
    plants, memories, edges = zip(*(tendon(rng, names) for _ in range(2)), strict=True)
    arm, stiffness, load = 0.01, 0.2, 0.01
    distal = np.array([[arm], [-arm]])
    for drive in (1e-3, -2e-3, 4e-3):
        given = np.array([[drive, -drive]])
        done, after, where, ends, _ = core.march_machine(
            len(edges[0]), np.array([p.block for p in plants]), np.array([m.block for m in memories]),
            np.zeros((2, 1)), distal, np.array([stiffness]), holding([0.03, 0.2, 0.5]), np.zeros(1),
            np.zeros(1), np.zeros(1), False, np.ones(1), given, np.zeros((1, 2)), np.array([[load]]),
            np.zeros(1), 0,
        )  # fmt: skip
        assert done == 1

        def left(angle, given=given):
            out = [
                twin_ends(unpacked(p), m, given[0, i], distal[i, 0] * angle, 1.0).tension[-1]
                for i, (p, m) in enumerate(zip(plants, memories, strict=True))
            ]
            weight = 0.03 * (math.sin(angle + 0.2) - math.sin(0.2))
            return arm * (out[0] - out[1]) - stiffness * angle - 0.5 * angle**3 - weight - load

        angle = brentq(left, -3.0, 3.0, xtol=1e-15)
        assert where[0, 0] == pytest.approx(angle, rel=SOLVED, abs=1e-9)
        for i, row in enumerate(ends.reshape(2, 4)):
            twin = twin_ends(unpacked(plants[i]), memories[i], given[0, i], distal[i, 0] * angle, 1.0)
            np.testing.assert_allclose(row[:2], twin.tension[[0, -1]], rtol=SOLVED, atol=1e-6)
            kept, _ = remembered(after[i])
            np.testing.assert_allclose(kept.displacement, twin.displacement, rtol=1e-5, atol=1e-9)


def test_two_coordinates_of_three_tendons_are_where_the_twin_balances():
    rng = np.random.default_rng(4)
    plants, memories, edges = zip(*(tendon(rng, []) for _ in range(3)), strict=True)
    angles = np.radians([0.0, 120.0, 240.0])
    distal, stiffness = 0.004 * np.column_stack([np.cos(angles), np.sin(angles)]), np.full(2, 0.05)
    given = np.array([[2e-3, -1e-3, -0.5e-3]])
    done, _, where, _, _ = core.march_machine(
        len(edges[0]), np.array([p.block for p in plants]), np.array([m.block for m in memories]),
        np.zeros((3, 2)), distal, stiffness, np.zeros((2, 40)), np.zeros(2), np.zeros(2),
        np.zeros(2), False, np.ones(1),
        given, np.zeros((1, 3)), np.zeros((1, 2)), np.zeros(1), 0,
    )  # fmt: skip
    assert done == 1

    def left(bending):
        out = np.array(
            [
                twin_ends(unpacked(p), m, given[0, i], float(distal[i] @ bending), 1.0).tension[-1]
                for i, (p, m) in enumerate(zip(plants, memories, strict=True))
            ]
        )
        return distal.T @ out - stiffness * bending

    solution = root(left, where[0] + 1e-3, tol=1e-12)
    np.testing.assert_allclose(where[0], solution.x, rtol=SOLVED)


@pytest.mark.parametrize("names", [[], ["load_dependent_friction"], ["viscous_drag"], ["presliding"]])
def test_a_run_is_taken_at_once_as_sample_by_sample(names):
    """The samples of a run begin at a guess from the one before; those that are taken alone do not."""
    rng = np.random.default_rng(5)
    plants, memories, edges = zip(*(tendon(rng, names) for _ in range(2)), strict=True)
    k, plant, memory = (
        len(edges[0]),
        np.array([p.block for p in plants]),
        np.array([m.block for m in memories]),
    )
    distal, drive = np.array([[0.01], [-0.01]]), 0.02 * np.sin(np.linspace(0.0, 9.0, 60))  # one goes slack
    given, held = (
        np.column_stack([drive, -drive]),
        (np.array([0.2]), np.zeros((1, 40)), np.zeros(1), np.zeros(1)),
    )

    def taken(rows, memory, at):
        free = np.zeros((2, 1)), distal, *held, at, False
        none = np.zeros((len(rows), 2)), np.zeros((len(rows), 1)), np.zeros(len(rows))
        done, *made, _ = core.march_machine(k, plant, memory, *free, np.full(len(rows), 0.1), rows, *none, 0)
        assert done == len(rows)
        return made

    after, where, ends = taken(given, memory, np.zeros(1))
    assert np.any(ends[:, 1] == 0.0)
    at = np.zeros(1)
    for row, angle, end in zip(given, where, ends, strict=True):
        memory, (at,), (alone,) = taken(row[None], memory, at)
        np.testing.assert_allclose(at, angle, rtol=0.0, atol=1e-8)  # (175), of some 10 N on 0.2 N m/rad
        np.testing.assert_allclose(alone, end, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(memory, after, rtol=0.0, atol=1e-6)


def test_what_cannot_be_balanced_ends_with_the_sample_that_failed():
    made, memory, edge = tendon(np.random.default_rng(0), [])
    done, _, where, ends, _ = core.march_machine(
        len(edge), made.block[None], memory.block[None], np.zeros((1, 1)), np.ones((1, 1)), np.ones(1),
        np.zeros((1, 40)), np.zeros(1), np.full(1, 5.0), np.zeros(1), False, np.ones(3),
        np.array([[0.0], [np.nan], [0.0]]),
        np.zeros((3, 1)), np.zeros((3, 1)), np.zeros(3), 3,
    )  # fmt: skip
    assert done == 1
    assert np.isfinite(where[0]).all()
    assert np.isnan(where[1:]).all()
    assert np.isnan(ends[1:]).all()


def law_rows(plants, k):
    """Yield the rows of laws of each plant."""
    return (each[: len(LAW) * (k + 1)].reshape(len(LAW), k + 1) for each in plants)


def test_many_machines_are_stepped_as_each_by_itself():
    rng = np.random.default_rng(11)
    plants, memories, edges = zip(*(tendon(rng, ["creep"]) for _ in range(3)), strict=True)
    k, machines = len(edges[0]), 4
    plant, memory = np.array([p.block for p in plants]), np.array([m.block for m in memories])
    angles = np.radians([0.0, 120.0, 240.0])
    distal = 0.004 * np.column_stack([np.cos(angles), np.sin(angles)])
    slope = np.zeros((1, plant.size))
    more = rng.uniform(0.0, 0.1, k)
    for of in law_rows(slope.reshape(plant.shape), k):
        of[LAW.pulling, :k] = of[LAW.releasing, :k] = more
    shift, drive = rng.uniform(0.0, 0.2, (machines, 1)), rng.uniform(-1e-3, 1e-3, (machines, 3))
    stiffness, load = rng.uniform(0.02, 0.1, (machines, 2)), rng.uniform(-1e-3, 1e-3, (machines, 2))
    none, row = np.zeros((machines, 2)), np.zeros(machines, dtype=np.int64)
    law = core.table_of(np.array([-0.2, 0.0, 0.1]), np.array([-2e-3, 0.0, 3e-3]))
    held = np.tile(np.concatenate([[0.01, 0.3, 0.5], law]), 2)
    done, after, where, ends = core.step_machines(
        k, plant, slope, shift, memory.reshape(1, -1), row, np.zeros((machines, 6)),
        np.tile(distal.ravel(), (machines, 1)), stiffness, np.tile(held, (machines, 1)), np.zeros(machines),
        none, none, False, drive, np.zeros((machines, 3)), load, 0.5, 0.0,
    )  # fmt: skip
    assert done == machines
    for j in range(machines):
        own = plant.copy()
        for of in law_rows(own, k):
            of[LAW.pulling, :k] += shift[j, 0] * more
            of[LAW.releasing, :k] += shift[j, 0] * more
            of[LAW.low, :k] = np.exp(-of[LAW.pulling, :k] - of[LAW.fitting, :k])
            of[LAW.high, :k] = np.exp(of[LAW.releasing, :k] + of[LAW.fitting, :k])
        count, alone, at, forces, _ = core.march_machine(
            k, own, memory, np.zeros((3, 2)), distal, stiffness[j], held.reshape(2, 40), np.zeros(2),
            np.zeros(2), np.zeros(2), False, np.full(1, 0.5), drive[j][None], np.zeros((1, 3)), load[j][None],
            np.zeros(1), 0,
        )  # fmt: skip
        assert count == 1
        np.testing.assert_allclose(where[j], at[0], rtol=1e-9)  # exp of another library rounds otherwise
        np.testing.assert_allclose(ends[j], forces[0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(after[j].reshape(alone.shape), alone, rtol=1e-6, atol=1e-9)


def test_three_tendons_that_move_apart_are_balanced_in_each_sample():
    scenario = segment(1, 12.0, changes=())
    machine = machine_of(rig_of(scenario.machine), [arcs_of(scenario.machine)])
    drives = {f"displacement_in_{i}_m": np.array(scenario.truth[f"displacement_in_{i}_m"]) for i in (1, 2, 3)}
    read = simulate_machine(machine, {"time_s": scenario.times, **drives})
    for name in ("tension_in_1_N", "tension_in_2_N", "tension_in_3_N"):
        assert np.std(read[name] - scenario.truth[name]) < 0.03  # N, of 20; 0.013 measured


def test_a_step_that_no_relaxation_brings_to_rest_is_relaxed_to_the_end_but_once():
    """Drag of a billion times the stiffness: what rounding leaves is more than ends the iteration."""
    drive, end = np.array([[1.409], [1.975]]), np.array([[-0.471], [2.1]])
    plant, memory, none = np.ones((1, 17 * 9 + 430)), np.ones((1, 9 * 9 + 7)), np.zeros(0)
    mechanism = np.zeros((1, 0)), np.zeros((1, 0)), none, np.zeros((0, 40)), none, none, none
    begun = time.process_time()
    samples = np.array([0.66, 0.0]), drive, end, np.zeros((2, 0)), np.zeros(2)
    done, *_ = core.march_machine(8, plant, memory, *mechanism, 1, *samples, 0)
    assert done == 2
    assert time.process_time() - begun < 0.3  # 0.012 s; relaxed in each pass it took 0.7 s
