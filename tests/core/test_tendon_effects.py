"""The tendon with effects in the core beside slow twins: runs, steps on moving routes, both ends."""

import math

import numpy as np
import pytest

from tests.core.test_tendon import random_route
from tests.core.twins import tendon_ends, tendon_march
from tests.core.twins.tendon_laws import remembered, unpacked
from tests.core.twins.tendon_profile import discretised, is_unmoved
from tssgeom import core
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon_rows import MEMORY
from tssgeom.effects import KINDS, Setup, together, with_size
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of, edges
from tssgeom.tendon.bars.model import Model, begin
from tssgeom.tendon.bars.plant import plant

NAMES = list(KINDS)
DRIVES = ("tension_in_N", "displacement_in_m")


def random_model(rng, names, stiffness):
    """A tendon of few bars with some effects on a random route, and the route."""
    base = Setup(0.145, 3.16e-4, 5.0, stiffness)
    setup = together(base, [with_size(KINDS[name]) for name in names])
    length, angle, covariance = random_route(rng, 5)
    arcs = Arcs(length, angle, covariance, "exact")
    edge = edges(arcs, int(rng.integers(2, 9)))
    drive = DRIVES[rng.integers(2)]
    return Model(setup, plant(setup, arcs, edge), drive, edge), arcs


def random_drive(rng, by_force, count):
    """Pulls, releases and holds: tensions [N] or positions [m]."""
    steps = rng.normal(size=count) * rng.choice([0.0, 0.3, 1.0], count)
    return np.maximum(6.0 + np.cumsum(2.0 * steps), 0.0) if by_force else 3e-3 + 4e-4 * np.cumsum(steps)


@pytest.mark.parametrize("name", [*NAMES, "any three"])
@pytest.mark.parametrize("stiffness", [0.0, 1000.0])
def test_a_run_is_that_of_the_twin(name, stiffness):
    rng = np.random.default_rng(NAMES.index(name) if name in NAMES else 99)
    for _ in range(3 if name in NAMES else 12):
        names = [name] if name in NAMES else rng.choice(NAMES, 3, replace=False)
        model, _ = random_model(rng, names, stiffness)
        by_force, count = model.drive == DRIVES[0], 8
        spans, warmth = rng.uniform(0.05, 2.0, count), rng.normal(size=count)
        drive, parts = random_drive(rng, by_force, count), rng.integers(1, 3, count)
        start, laws = begin(model).memory.block, unpacked(model.plant)
        memory, _ = remembered(start)
        out, rows = np.full((6, count), np.nan), np.full((count, len(memory.tension)), np.nan)
        expected = tendon_march.march(laws, memory, by_force, spans, drive, warmth, parts, out, rows)
        done, after, here, profile = core.march(
            len(model.edge), model.plant.block, start, by_force, spans, drive, warmth, parts, count
        )
        assert done == expected
        np.testing.assert_allclose(here[:2, :done], out[:2, :done], rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(here[2:4, :done], out[2:4, :done], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(profile[:done], rows[:done], rtol=1e-10, atol=1e-9)
        if done == count:
            kept, _ = remembered(after)
            np.testing.assert_allclose(kept.travel, memory.travel, rtol=1e-10, atol=1e-12)
            np.testing.assert_allclose(kept.drive, memory.drive, rtol=1e-9, atol=1e-12)


def test_a_step_on_a_moving_route_is_that_of_the_twin():
    rng, stepped = np.random.default_rng(1), 0
    for _ in range(250):
        names = rng.choice(NAMES, int(rng.integers(1, 4)), replace=False)
        model, arcs = random_model(rng, names, 1000.0)
        setup, edge, bends = model.setup, model.edge, bends_of(model.setup)
        first, after = remembered(begin(model).memory.block)[0], begin(model).memory.block
        laws, block, before, position, front, by_force = (
            unpacked(model.plant), model.plant.block, arcs, 0.0, 0, model.drive == DRIVES[0],
        )  # fmt: skip
        for _ in range(4):
            length, covariance = before.length, before.covariance
            turned = np.abs(before.angle + rng.choice([0.0, 1e-11, 0.05]) * rng.normal(size=len(length)))
            was, by_force = by_force, bool(rng.random() < 0.6)
            drive = random_drive(rng, by_force, 1)[0]
            routes = length, before.angle, covariance, length, turned, covariance
            span, warmth = rng.uniform(0.1, 1.0), rng.choice([math.nan, rng.normal()])
            done, after_step, plant_after, ends = core.step_with_effects(
                edge, block, after, *routes, bends, True, setup.friction, np.inf,
                drive, by_force, was, position, front, span, warmth,
            )  # fmt: skip
            moves = not is_unmoved(*routes)
            if moves:
                numbers = setup.friction, setup.asymmetry, setup.curvature_gain_m
                laws = tendon_ends.put_on_route(laws, numbers, edge, length, turned, bends)
                laws = laws._replace(swift=False)
            if was != by_force:
                tendon_march.switch(first, position, by_force)
            last = first.drive[0]
            warm = first.drive[1] if math.isnan(warmth) else warmth
            out = np.empty((6, 1))
            one = np.array([span]), np.array([drive]), np.array([warm]), np.ones(1, dtype=np.int64)
            assert done == tendon_march.march(laws, first, by_force, *one, out, np.empty((0, 0)))
            if not done:
                break
            stepped += 1
            assert ends[8] == moves
            np.testing.assert_allclose(ends[:4], out[:4, 0], rtol=1e-10, atol=1e-9)
            np.testing.assert_allclose(ends[2:4], out[2:4, 0], rtol=1e-10, atol=1e-12)
            assert ends[6] == pytest.approx(last, rel=1e-10, abs=1e-12)
            slip = remembered(after_step)[0].slip
            front = tendon_march.front_of(slip, front, drive == ends[6])
            assert ends[7] == front
            kept, _ = remembered(after_step)
            np.testing.assert_allclose(kept.tension, first.tension, rtol=1e-10, atol=1e-9)
            np.testing.assert_allclose(kept.creep, first.creep, rtol=1e-10, atol=1e-12)
            after, block, position = after_step, plant_after, ends[2]
            before = Arcs(length, turned, covariance, "exact") if moves else before
    assert stepped > 700


def test_contacts_follow_a_route_as_by_the_twin():
    rng = np.random.default_rng(2)
    for _ in range(300):
        names = rng.choice(NAMES, 3, replace=False)
        model, _ = random_model(rng, {*names, "sheath_clearance"}, 1000.0)
        length, angle, _ = random_route(rng, 5)
        setup, bends = model.setup, bends_of(model.setup)
        numbers = setup.friction, setup.asymmetry, setup.curvature_gain_m
        laws = unpacked(model.plant)
        expected = tendon_ends.put_on_route(laws, numbers, model.edge, length, angle, bends)
        block = core.plant_on_route(model.edge, model.plant.block, length, angle, bends)
        for row, wanted in zip(unpacked(model.plant._replace(block=block)), expected, strict=True):
            np.testing.assert_allclose(row, wanted, rtol=1e-10, atol=1e-14)


def test_both_ends_are_those_of_the_twin():
    rng = np.random.default_rng(3)
    for _ in range(300):
        names = rng.choice(NAMES, int(rng.integers(1, 4)), replace=False)
        model, arcs = random_model(rng, names, float(rng.choice([0.0, 1000.0])))
        setup, memory = model.setup, begin(model).memory
        taut = float(rng.random() < 0.9)
        memory.tension[:] = taut * rng.uniform(0.1, 12.0, len(memory.tension))
        memory.travel[:] = rng.uniform(0.0, 0.1, len(memory.travel))
        memory.displacement[:] = 1e-3 * rng.normal(size=len(memory.travel))
        memory._row(MEMORY.slip, True)[:] = rng.integers(-1, 2, len(memory.slip))
        laws, (kept, _) = unpacked(model.plant), remembered(memory.block)
        friction = setup.friction * (1 + setup.asymmetry), setup.friction * (1 - setup.asymmetry)
        pieces = arcs.length, 1.0 + 2.0 * setup.curvature_gain_m * arcs.kappa, arcs.covariance
        variance, angle_variance, slope = tendon_ends.spread(laws, kept, friction, model.edge, pieces)
        way, front = int(rng.choice([-1, 1])), int(rng.integers(0, len(kept.slip) + 1))
        tension_out = kept.tension[-1]
        near = tendon_ends.answering(laws, kept.travel, tension_out, way > 0)
        size = len(model.edge), model.plant.block, memory.block
        assert core.answering(*size, tension_out, way) == pytest.approx(near, rel=1e-10)
        ends = core.transmit_with_effects(
            model.edge, *size[1:], arcs.length, arcs.angle, arcs.covariance, way, front
        )
        width = way * (near - kept.tension[0])
        rubs = np.flatnonzero((laws.pulling + laws.fitting > ROUNDING.relative) | (laws.force > 0.0))
        last = rubs.max(initial=0)  # what is straight behind it slides by rounding alone
        replied = kept.slip[last] == way or width <= 1e-7 * max(kept.tension[0], tension_out, 1.0)
        middle = discretised(model.edge, arcs.length, arcs.angle)[1]
        slid = arcs.total_angle if front == len(kept.slip) else middle[front - 1] if front else 0.0
        sd = math.sqrt(variance), tension_out * abs(slope) * math.sqrt(angle_variance)
        expected = (*sd, 0.0 if replied else width, replied, slid)
        np.testing.assert_allclose(ends, expected, rtol=1e-9, atol=1e-12)


def test_a_lag_is_that_of_the_twin():
    rng = np.random.default_rng(4)
    for _ in range(200):
        values, spans = rng.normal(size=(2, int(rng.integers(0, 12))))
        before, lag = rng.normal(size=2), rng.uniform(0.01, 2.0)
        expected = tendon_march.lagged(values, spans, lag, before)
        np.testing.assert_allclose(core.lagged(values, spans, lag, *before), expected, rtol=1e-12)


def test_a_run_of_numbers_that_are_none_ends():
    rng = np.random.default_rng(5)
    for name in NAMES:
        model, _ = random_model(rng, [name], 1000.0)
        block = model.plant.block.copy()
        block[rng.integers(model.plant.rows.size)] = math.nan
        one = np.ones(2), np.array([6.0, math.nan]), np.zeros(2), np.ones(2, dtype=np.int64)
        done, _, out, _ = core.march(
            len(model.edge), block, begin(model).memory.block, model.drive == DRIVES[0], *one, 0
        )
        assert done < 2
        assert np.isfinite(out[:4, :done]).all()
