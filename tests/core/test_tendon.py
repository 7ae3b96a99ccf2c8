"""The tendon in the core beside slow twins: corner lists, routes, and chains of bars on random input."""

import numpy as np
import pytest

from tests.core.twins import tendon_profile as twin
from tests.core.twins.tendon_base import on_route
from tests.core.twins.tendon_chain import Chain
from tests.core.twins.tendon_equilibrium import equilibrium
from tests.core.twins.tendon_laws import remembered
from tssgeom import core
from tssgeom.core.constants_tendon import PROFILE, SOLVER
from tssgeom.core.constants_tendon_rows import MEMORY
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import edges, equal_edges
from tssgeom.tendon.bars.plant import memory_of

EXACT = {"rtol": 1e-10, "atol": 1e-13}


def random_route(rng, most=6, spread=1e-3):
    """Lengths, angles and covariance of some pieces, some of them straight."""
    pieces = int(rng.integers(1, most + 1))
    length = rng.uniform(0.01, 0.3, pieces)
    angle = rng.uniform(0.0, 2.0, pieces) * (rng.random(pieces) < 0.8)
    half = spread * rng.normal(size=(2 * pieces, 2 * pieces)) * rng.choice([0.0, 1.0])
    return length, angle, half @ half.T


def test_routes_are_compared_as_by_the_twin():
    rng, unmoved = np.random.default_rng(1), 0
    for _ in range(1500):
        length, angle, covariance = random_route(rng)
        size = rng.choice([0.0, 1e-10, 1e-3, 1e-2])
        now = length * (1.0 + size * rng.normal(size=len(length))), np.abs(angle + size), covariance
        if rng.random() < 0.2:
            now = random_route(rng)
        expected = twin.is_unmoved(length, angle, covariance, *now)
        assert core.is_unmoved(length, angle, covariance, *now) == expected
        unmoved += expected
    assert 300 < unmoved < 1200


def test_bars_lie_on_a_route_as_by_the_twin():
    rng = np.random.default_rng(2)
    for _ in range(500):
        length, angle, _ = random_route(rng)
        edge = equal_edges(int(rng.integers(1, 12)), int(rng.integers(0, 4)))
        if rng.random() < 0.3:  # a joint of pieces that is one of bars
            length = np.diff(edge)[: len(length)] if len(edge) > len(length) else length
            angle = angle[: len(length)]
        bars, contacts = core.discretise(edge, length, angle)
        for row, expected in zip((*bars, *contacts), twin.discretised(edge, length, angle), strict=True):
            np.testing.assert_allclose(row, expected, **EXACT)


def test_hidden_bends_are_added_as_by_the_twin():
    rng = np.random.default_rng(3)
    for _ in range(500):
        length, angle, _ = random_route(rng)
        count, whole = int(rng.integers(0, 4)), length.sum()
        middle, width = rng.uniform(-0.1, 1.1, count) * whole, rng.choice([1e-12, 0.01, 0.1, 2.0], count)
        bends = np.column_stack([middle, rng.uniform(0.0, 1.0, count), width * whole])
        pieces, added = core.add_bends(length, angle, bends)
        expected = twin.bent(length, angle, bends)
        np.testing.assert_allclose(added[:, :pieces], expected if count else (length, angle), **EXACT)


def random_corners(rng, friction):
    """A list of corners after some random steps, by the twin."""
    angle, log_tension = np.array([0.0]), np.array([rng.uniform(-1.0, 3.0)])
    for _ in range(int(rng.integers(0, 7))):
        drive = log_tension[0] + rng.normal() * rng.choice([1e-13, 0.1, 1.0])
        corners, way = twin.stepped(angle, log_tension, drive, friction)
        angle, log_tension = corners if way else (angle, log_tension)
    return angle, log_tension


def test_corners_are_stepped_as_by_the_twin():
    rng = np.random.default_rng(4)
    for _ in range(1000):
        friction = rng.choice([0.02, 0.145, 0.5])
        angle, log_tension = random_corners(rng, friction)
        drive = log_tension[0] + rng.normal() * rng.choice([1e-13, 0.1, 2.0])
        expected, way = twin.stepped(angle, log_tension, drive, friction)
        count, corners = core.step_corners(angle, log_tension, drive, friction)
        assert np.sign(count) == way
        np.testing.assert_allclose(corners[:, : abs(count)], expected, **EXACT)


def test_corners_are_transmitted_as_by_the_twin():
    rng = np.random.default_rng(5)
    for _ in range(500):
        friction, (length, angle, covariance) = rng.choice([1e-4, 0.145, 0.5]), random_route(rng)
        profile = random_corners(rng, friction)
        if rng.random() < 0.1:
            profile = profile[0], np.full(len(profile[1]), PROFILE.slack)
        way, elastic = int(rng.choice([-1, 1])), (3e-4, 5.0, friction)
        expected = twin.on_pieces(*profile, (length, angle, covariance), elastic, way)
        ends, gradient = core.transmit_corners(*profile, length, angle, covariance, *elastic, way)
        np.testing.assert_allclose(ends[:6], expected, **EXACT)
        means, _, slope = twin.means_on_pieces(angle, *profile)
        np.testing.assert_allclose(gradient, twin._gradient(means, length, *elastic[:2]), **EXACT)
        assert ends[6] == pytest.approx(slope, rel=1e-10, abs=1e-12)


def test_bars_are_transmitted_as_by_the_twin():
    rng = np.random.default_rng(6)
    for _ in range(400):
        length, angle, covariance = random_route(rng)
        edge = equal_edges(int(rng.integers(1, 15)), int(rng.integers(0, 3)))
        level = rng.choice([0.0, 1e-11, 0.1, 1.0])
        tension = np.maximum(5.0 + level * np.cumsum(rng.normal(size=len(edge) + 1)), 0.0)
        corners = twin.through_bars(edge, tension, length, angle, sum(angle))
        count, through = core.corners_of_bars(edge, tension, length, angle)
        np.testing.assert_allclose(through[:, :count], corners, **EXACT)
        way, elastic = int(rng.choice([-1, 1])), (3e-4, 5.0, 0.145)
        expected = twin.on_pieces(*corners, (length, angle, covariance), elastic, way)
        ends = core.transmit_bars(edge, memory_of(tension).block, length, angle, covariance, *elastic, way)
        np.testing.assert_allclose(ends[:6], expected, **EXACT)


# --- one step of a chain of bars ----------------------------------------------------------------------------


def random_chain(rng):
    """A chain with any ends; trial tensions below zero leave bars slack."""
    contacts = int(rng.integers(2, 9))
    rigid_in, rigid_out = rng.random(2) < 0.3
    stiffness = rng.uniform(1e3, 3e4, contacts + 1)
    stiffness[0] *= rng.random() < 0.4 and not rigid_in
    stiffness[-1] *= not rigid_out
    trial = rng.uniform(rng.choice([-8.0, 4.0]), 12.0, contacts + 1)
    trial[0] = abs(trial[0])
    angle = rng.uniform(0.0, 0.5, contacts)
    force, drag = (
        rng.uniform(0.0, each, contacts) for each in (rng.choice([0.0, 0.3]), rng.choice([0.0, 500.0]))
    )
    shift = rng.normal() * 1e-3 if rigid_in else 0.0
    cone = np.exp(-angle), np.exp(rng.uniform(0.5, 1.5) * angle), force, drag
    gives = np.full(contacts, rng.random() < 0.4)
    bristle = np.where(gives, rng.uniform(1e2, 1e5, contacts), np.inf)
    kept = np.where(gives, rng.normal(0.0, 0.5, contacts), 0.0)
    return Chain(trial, stiffness, *cone, bristle, kept, bool(rigid_in), bool(rigid_out), shift)


def test_the_equilibrium_is_that_of_the_twin():
    rng, solved = np.random.default_rng(7), 0
    for _ in range(1200):
        chain = random_chain(rng)
        before = rng.integers(-1, 2, len(chain.low)).astype(np.int8)
        hanging = bool(rng.random() < 0.2 and chain.stiffness[0] == 0.0 and not chain.rigid_in)
        patience = (SOLVER.from_before, SOLVER.from_guess) if rng.random() < 0.6 else (0, 0)
        w, tension, slip, solves, residual = equilibrium(chain, hanging, before, patience)
        ends = chain.rigid_in, chain.rigid_out, chain.shift, hanging
        count, here, contacts, left = core.equilibrium(
            chain.trial, chain.stiffness, np.array(chain[2:8]), *ends, before.astype(float), *patience
        )
        if residual > 1e-9:
            continue
        solved += 1
        assert left[0] <= 1e-9
        assert count == solves
        np.testing.assert_allclose(here, tension, rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(contacts[0], w, rtol=1e-9, atol=1e-13)
        moves = np.abs(w) > 1e-12
        np.testing.assert_array_equal(contacts[1][moves], slip[moves])
    assert solved > 950


def compared(block, expected, rest):
    """Compare a memory with the twin's bars: tension, displacement, slip where anything moved, rest."""
    memory, here = remembered(block)
    tension, displacement, _, _ = expected
    np.testing.assert_allclose(memory.tension, tension, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(memory.displacement, displacement, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(here, rest, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("stiffness", [0.0, 1000.0, np.inf])
def test_a_step_of_bars_is_that_of_the_twin(stiffness):
    rng, count = np.random.default_rng(8), 0
    for _ in range(100):
        length, angle, covariance = random_route(rng)
        edge = equal_edges(int(rng.integers(1, 8)), int(rng.integers(0, 3)))
        pretension, position, friction = rng.choice([1.0, 5.0]), 0.0, rng.choice([0.0, 0.145])
        block = memory_of(np.full(len(edge) + 1, pretension)).block
        for _ in range(6):
            moved = rng.choice([0.0, 1e-3, 0.1])
            now = length * (1 + 0.1 * moved * rng.normal(size=len(length))), np.abs(angle + moved)
            by_force = bool(rng.random() < 0.5)
            drive = max(block[0] + rng.normal(), 0.0) if by_force else position + 3e-4 * rng.normal()
            before = length.sum() if rng.random() < 0.3 else -1.0
            numbers = friction, 3e-4, pretension, stiffness
            memory, rest = remembered(block)
            old = memory.tension, memory.displacement, memory.slip, rest
            bars, ends, whole, solves = on_route(
                old, (edge, *now), numbers, before, (drive, by_force, position)
            )
            routes = length, angle, covariance, *now, covariance
            code, after, given = core.step_bars(
                edge, block, *routes, False, *numbers, np.inf, before, drive, by_force, position
            )
            assert (code == 0) == (solves > 0)
            if code:
                continue
            count += 1
            assert given[3] == solves
            np.testing.assert_allclose(given[[0, 1, 2, 4]], (*ends, whole), rtol=1e-10, atol=1e-12)
            compared(after, bars, bars[3])
            block, position, (length, angle) = after, given[0], now
    assert count > 300


def test_numbers_that_are_none_end_in_a_code():
    rng = np.random.default_rng(10)
    for _ in range(300):
        length, angle, covariance = random_route(rng)
        edge = edges(Arcs.exact(length, angle), 4)
        values = [edge, memory_of(np.full(6, 5.0)).block, *2 * (length, angle, covariance)]
        spoiled = [each.copy() for each in values]
        which = rng.integers(len(spoiled))
        spoiled[which].flat[rng.integers(spoiled[which].size)] = rng.choice([np.nan, np.inf])
        friction = rng.choice([0.145, np.nan])
        code, after, _ = core.step_bars(
            *spoiled, True, friction, 3e-4, 5.0, 1000.0, np.inf, -1.0, 6.0, True, 0.0
        )
        assert code or np.isfinite(after[: (MEMORY.tension + 1) * 6]).all()
