"""Bars on a moving route, and the laws that every step obeys."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tendon.bars import (
    HALF,
    LOOP,
    MU,
    PI,
    RHO,
    SETUP_A,
    SOLVED,
    STRAIGHT,
    WITH_STRAIGHTS,
    arcs_of,
    driven,
    histories,
    pieces,
    plant_on,
    rig,
    stepped,
    untimed,
    with_cone,
    with_laws,
)
from tssgeom.core.constants_tendon_rows import LAW, PLANT
from tssgeom.effects import Setup
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import pretensioned_bars
from tssgeom.tendon.bars.base import step
from tssgeom.tendon.bars.contact_grid import discretise
from tssgeom.tendon.bars.model import begin, carry_on, model_of


@given(pieces, histories)
@untimed
def test_the_same_route_in_other_pieces_gives_the_same_answer(parts, history):
    arcs = arcs_of(parts)
    halved = Arcs.exact(np.repeat(arcs.length, 2) / 2, np.repeat(arcs.angle, 2) / 2)
    hardware, one = rig(4.0), pretensioned_bars(rig(4.0), arcs, 17)
    other = one
    for k, tension_in in enumerate(history):
        one = step(one, arcs, hardware, tension_in=tension_in)
        other = step(other, halved if k % 2 == 0 else arcs, hardware, tension_in=tension_in)
        np.testing.assert_allclose(other.tension, one.tension, atol=SOLVED)


def test_bends_that_vanish_under_a_held_position_leave_the_mean_tension_all_along():
    """Between two fixed ends the stretch is shared out and none is lost."""
    state = pretensioned_bars(rig(), SETUP_A, 40)
    pulled = stepped(state, SETUP_A, plant_on(state, SETUP_A, math.inf), displacement_in=1.5e-3)
    unbent = Arcs.exact(SETUP_A.length, [0.0, 0.0])
    after = stepped(pulled, unbent, plant_on(state, unbent, math.inf), displacement_in=1.5e-3)
    np.testing.assert_allclose(after.tension, 1.5e-3 / (RHO * (HALF + LOOP)), rtol=1e-9)
    assert after.elongation == pytest.approx(pulled.elongation, rel=1e-12)


def test_a_bend_that_comes_does_not_move_a_tendon_whose_drive_is_held():
    pulled = driven([15.0], WITH_STRAIGHTS, rig())
    bent = step(
        pulled, Arcs.exact([0.1, 0.3, 0.1], [1.0, PI, 0.5]), rig(), displacement_in=pulled.displacement_in
    )
    np.testing.assert_allclose(bent.tension, pulled.tension, rtol=1e-9)
    assert not bent.slip.any()


def test_a_bend_that_straightens_in_the_dead_zone_lets_tension_through_to_the_far_end():
    stuck = driven([15.0, 10.0], SETUP_A, rig())
    freed = step(stuck, Arcs.exact(SETUP_A.length, [PI, 0.5 * PI]), rig(), tension_in=10.0)
    assert freed.tension_out > stuck.tension_out
    assert freed.slip[0] == -1 or freed.slip[0] == 1
    assert (freed.slip[-20:] == 1).all()


def test_a_longer_route_stretches_a_tendon_between_fixed_ends():
    state = pretensioned_bars(rig(5.0), STRAIGHT, 10)
    longer = Arcs.exact([0.501], [0.0])
    laws = plant_on(state, longer, math.inf, 5.0)
    after = stepped(state, longer, laws, displacement_in=0.0)
    stretch = RHO * 0.5 * 5.0 + 0.001  # nothing but the path makes it longer
    np.testing.assert_allclose(after.tension, stretch / (RHO * 0.501), rtol=1e-9)
    after = stepped(state, longer, laws, stretches_with_route=False, displacement_in=0.0)
    np.testing.assert_allclose(after.tension, 5.0, rtol=1e-12)


def test_a_tendon_that_grows_between_fixed_ends_loses_tension_and_counts_the_growth_as_elongation():
    state = pretensioned_bars(rig(5.0), STRAIGHT, 10)
    warm = 1e-3
    after = stepped(
        state, STRAIGHT, plant_on(state, STRAIGHT, math.inf, 5.0), strain=warm, displacement_in=0.0
    )
    np.testing.assert_allclose(after.tension, 5.0 - 1e-3 / RHO, rtol=1e-9)
    assert after.elongation + warm * 0.5 == pytest.approx(0.0, abs=1e-15)  # both ends are fixed
    creep = stepped(state, STRAIGHT, plant_on(state, STRAIGHT, 1e3, 5.0), strain=warm, tension_in=5.0)
    assert creep.displacement_in - creep.displacement_out == pytest.approx(0.5e-3, rel=1e-9)
    model = model_of(Setup(MU, RHO, 5.0, 1e3, expansion_per_K=warm), STRAIGHT, "tension_in_N", state.edge)
    run = {"time_s": [0.0, 1.0], "tension_in_N": [5.0, 5.0], "temperature_C": [20.0, 21.0]}
    heat = carry_on(model, begin(model), run)[0].channels["elongation_m"]
    assert heat == pytest.approx([0.0, 0.5e-3], rel=1e-9, abs=1e-15)


def residual_of(old, new, arcs, laws, strain, *, stretches_with_route=True):
    """Rebuild all movements from the new state and return the worst breach of any law [N].

    Bar law, cone, sign of the movement on either side, load, drive: none of it uses the solver's numbers.
    """
    soft, load = laws.rows[LAW.soft], laws.number(PLANT.load)
    pulling, releasing, force, drag = laws.rows[[LAW.pulling, LAW.releasing, LAW.force, LAW.drag], :-1]
    length, stretch = discretise(old.edge, arcs).length, soft[1:-1]
    growth = 1 - old.length / arcs.total_length if stretches_with_route else 0.0
    gained = stretch * (new.tension - (1 - growth) * old.tension)[1:-1] - (new.slack - old.slack)[1:-1]
    gained += (strain - growth) * length
    change, loosened = new.tension - old.tension, new.slack - old.slack
    series_out = soft[-1] - 1 / load
    last = new.displacement_out - old.displacement_out + series_out * change[-1] - loosened[-1]
    w = last + np.append(np.cumsum(gained[::-1])[::-1], 0.0)
    first = new.displacement_in - old.displacement_in - soft[0] * change[0] + loosened[0]
    breach = [abs(first - w[0]) / stretch.min()]
    if load < math.inf:
        carried = load * (new.displacement_out - old.displacement_out)
        breach.append(abs(change[-1] - carried))
    here = new.tension[1:] + drag * w
    low = np.exp(-pulling) * new.tension[:-1] - force
    high = np.exp(releasing) * new.tension[:-1] + force
    moved = 1e-12  # less than an atom
    breach += [np.max(low - here), np.max(here - high)]
    breach += [np.max(np.abs(here - low)[w > moved], initial=0.0)]
    breach += [np.max(np.abs(here - high)[w < -moved], initial=0.0)]
    assert (new.tension >= 0).all()
    assert not (new.tension * new.slack).any()
    return max(breach)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=60)
def test_every_step_obeys_bar_law_cone_and_signs(seed):
    """Random moving routes, both drives, loads, asymmetric cones, drag, series springs, heat."""
    rng = np.random.default_rng(seed)
    bars, count = int(rng.integers(2, 60)), int(rng.integers(1, 6))
    compliance, stiffness = RHO * rng.uniform(0.5, 2.0, bars), rng.choice([300.0, 1000.0, math.inf])
    series = {"series_in_m_per_N": rng.choice([0.0, 1e-5]), "series_out_m_per_N": rng.choice([0.0, 1e-5])}
    way = {"stretches_with_route": bool(rng.integers(2))}
    length, angle = rng.uniform(0.02, 0.2, count), rng.uniform(0.0, 3.0, count)
    state = pretensioned_bars(rig(5.0), Arcs.exact(length, angle), bars)
    friction, skew, size = rng.choice([0.0, 0.05, 0.145, 0.4]), rng.uniform(0.5, 1.5), rng.choice([0.02, 0.3])
    drag = np.full(bars + 1, rng.choice([0.0, 100.0]))
    for _ in range(12):
        angle = np.abs(angle + size * rng.normal(size=count))
        length = length * (1 + 1e-3 * size * rng.normal(size=count))
        arcs = Arcs.exact(length, angle)
        grid = discretise(state.edge, arcs)
        laws = plant_on(state, arcs, stiffness, 5.0, **series)
        soft = np.array(laws.rows[LAW.soft])
        soft[1:-1] = compliance * grid.length
        bend = friction * grid.angle
        laws = with_cone(laws, bend, skew * bend, 0.2 * skew * grid.span)
        laws = with_laws(laws, soft=soft, drag=drag)
        strain = 1e-4 * size * rng.normal(size=bars)
        if rng.integers(2):
            drive = {"tension_in": max(state.tension_in + 5 * size * rng.normal(), 0.5)}
        else:
            drive = {"displacement_in": state.displacement_in + size * 5e-4 * abs(rng.normal())}
        new = stepped(state, arcs, laws, strain=strain, **way, **drive)
        assert residual_of(state, new, arcs, laws, strain, **way) <= 1e-6  # 1e-14 m at 1e7 N/m, and SOLVED
        state = new


def test_bars_that_go_slack_one_by_one_reach_an_equilibrium():
    """Constant friction holds tension between slack bars; the hardest case for the solver."""
    rng = np.random.default_rng(5)
    state = pretensioned_bars(rig(5.0), SETUP_A, 40)
    grid, laws = discretise(state.edge, SETUP_A), plant_on(state, SETUP_A, math.inf, 5.0)
    laws = with_cone(laws, MU * grid.angle, MU * grid.angle, 0.5 * grid.span)
    for _ in range(30):
        strain = 1e-4 + 3e-4 * rng.normal(size=40)
        new = stepped(state, SETUP_A, laws, strain=strain, displacement_in=0.0)
        assert residual_of(state, new, SETUP_A, laws, strain) <= 1e-6
        state = new
    assert (state.slack[1:-1] > 0).sum() > 10
