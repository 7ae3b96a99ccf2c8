"""Bars on a moving route, and the laws that every step obeys."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

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
    blocked,
    driven,
    histories,
    pieces,
    rig,
    untimed,
)
from tests.tendon.steps import pretensioned_bars, step
from tssgeom.effects import Setup
from tssgeom.errors import SettingsError
from tssgeom.rig import Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import state as tendon
from tssgeom.tendon.bars.contact_grid import discretise
from tssgeom.tendon.bars.model import begin, carry_on, model_of, setup_of
from tssgeom.tendon.bars.with_effects import cut


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
    pulled = blocked(state, SETUP_A, rig(), displacement_in=1.5e-3)
    unbent = Arcs.exact(SETUP_A.length, [0.0, 0.0])
    after = blocked(pulled, unbent, rig(), displacement_in=1.5e-3)
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
    after = blocked(state, longer, rig(5.0), displacement_in=0.0)
    stretch = RHO * 0.5 * 5.0 + 0.001  # nothing but the path makes it longer
    np.testing.assert_allclose(after.tension, stretch / (RHO * 0.501), rtol=1e-9)
    after = blocked(state, longer, rig(5.0), stretches_with_route=False, displacement_in=0.0)
    np.testing.assert_allclose(after.tension, 5.0, rtol=1e-12)


def test_a_tendon_that_grows_counts_the_growth_as_elongation():
    state, warm = pretensioned_bars(rig(5.0), STRAIGHT, 10), 1e-3
    model = model_of(Setup(MU, RHO, 5.0, 1e3, expansion_per_K=warm), STRAIGHT, "tension_in_N", state.edge)
    run = {"time_s": [0.0, 1.0], "tension_in_N": [5.0, 5.0], "temperature_C": [20.0, 21.0]}
    heat = carry_on(model, begin(model), run)[0].channels["elongation_m"]
    assert heat == pytest.approx([0.0, 0.5e-3], rel=1e-9, abs=1e-15)


def residual_of(old, new, arcs, hardware, load, *, stretches_with_route=True):
    """Rebuild all movements from the new state and return the worst breach of any law [N].

    Bar law, cone, sign of the movement on either side, load, drive: none of it uses the solver's numbers.
    """
    grid = discretise(old.edge, arcs)
    stretch, bend = hardware.tendon.compliance_per_N * grid.length, hardware.friction.coefficient * grid.angle
    growth = 1 - old.length / arcs.total_length if stretches_with_route else 0.0
    gained = stretch * (new.tension - (1 - growth) * old.tension)[1:-1] - (new.slack - old.slack)[1:-1]
    gained -= growth * grid.length
    change, loosened = new.tension - old.tension, new.slack - old.slack
    last = new.displacement_out - old.displacement_out - loosened[-1]
    w = last + np.append(np.cumsum(gained[::-1])[::-1], 0.0)
    first = new.displacement_in - old.displacement_in + loosened[0]
    breach = [abs(first - w[0]) / stretch.min()]
    if load < math.inf:
        carried = load * (new.displacement_out - old.displacement_out)
        breach.append(abs(change[-1] - carried))
    here, low, high = (
        new.tension[1:],
        np.exp(-bend) * new.tension[:-1],
        np.exp(bend) * new.tension[:-1],
    )
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
    """Random moving routes, both drives, loads, friction and compliance that vary."""
    rng = np.random.default_rng(seed)
    bars, count = int(rng.integers(2, 60)), int(rng.integers(1, 6))
    stiffness, way = rng.choice([300.0, 1000.0, math.inf]), {"stretches_with_route": bool(rng.integers(2))}
    length, angle = rng.uniform(0.02, 0.2, count), rng.uniform(0.0, 3.0, count)
    state = pretensioned_bars(rig(5.0), Arcs.exact(length, angle), bars)
    friction, size = rng.choice([0.0, 0.05, 0.145, 0.4]), rng.choice([0.02, 0.3])
    hardware = replace(
        rig(5.0, friction, 0.0 if stiffness == math.inf else stiffness),
        tendon=Tendon(compliance_per_N=RHO * rng.uniform(0.5, 2.0), pretension_N=5.0),
    )
    for _ in range(12):
        angle = np.abs(angle + size * rng.normal(size=count))
        length = length * (1 + 1e-3 * size * rng.normal(size=count))
        arcs = Arcs.exact(length, angle)
        if rng.integers(2):
            drive = {"tension_in": max(state.tension_in + 5 * size * rng.normal(), 0.5)}
        else:
            drive = {"displacement_in": state.displacement_in + size * 5e-4 * abs(rng.normal())}
        new = (blocked if stiffness == math.inf else step)(state, arcs, hardware, **way, **drive)
        assert (
            residual_of(state, new, arcs, hardware, stiffness, **way) <= 1e-6
        )  # 1e-14 m at 1e7 N/m, and SOLVED
        state = new


@pytest.mark.parametrize("history", [[14.0], [14.0, 7.0], [3.0, 12.0, 11.0]])
def test_a_tendon_that_is_cut_into_bars_stands_at_both_ends_where_it_stood(history):
    hardware, arcs = Rig(tendon=Tendon(pretension_N=2.0), load=Load(stiffness_N_per_m=2000.0)), SETUP_A
    state = tendon.pretensioned(hardware)
    for tension_in in history:
        state = tendon.step(state, arcs, hardware, tension_in=tension_in)
    ends, bars = tendon.transmit(state, hardware), cut(state.along, arcs, setup_of(hardware))
    assert bars.displacement_in == pytest.approx(ends.displacement_in, rel=5e-4)  # that of bars
    assert bars.displacement_out == pytest.approx(ends.displacement_out, rel=1e-9)
    assert bars.elongation == pytest.approx(ends.elongation, rel=2e-3)
    np.testing.assert_allclose(
        bars.memory.displacement[[0, -1]], [bars.displacement_in, bars.displacement_out], rtol=1e-9
    )
    assert np.all(np.diff(bars.memory.displacement) <= 0.0)  # a tendon that only stretches


@pytest.mark.parametrize(
    ("time", "which"), [([0.0, 1.0, 1.0, 2.0], "1 to 1"), ([0.0, 3.0, 4.0, 2.5], "4 to 2.5")]
)
def test_times_that_do_not_increase_are_named(time, which):
    model = model_of(setup_of(Rig()), Arcs.exact([0.5], [PI]), "tension_in_N", np.linspace(0.0, 1.0, 9))
    run = {"time_s": np.array(time), "tension_in_N": np.full(4, 5.0)}
    with pytest.raises(SettingsError, match=f"time_s goes from {which} s"):
        carry_on(model, begin(model), run)
