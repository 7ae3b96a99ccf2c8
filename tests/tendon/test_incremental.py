"""The tendon as bars on a moving route: against closed forms, the corner list and its own laws."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tssgeom.errors import SettingsError
from tssgeom.rig import Friction, Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.bars.contact_grid import lay, pretensioned_bars, to_bars, to_corners
from tssgeom.tendon.bars.equilibrium import equilibrium
from tssgeom.tendon.bars.incremental import Cone, Line, advance, coulomb, line, step
from tssgeom.tendon.transmission import transmit

MU, RHO, PI = 0.145, 3.16e-4, math.pi  # the paper's tendon and sheath, section III-B
HALF_CIRCLE = Arcs.exact([0.5], [PI])
WITH_STRAIGHTS = Arcs.exact([0.1, 0.3, 0.1], [0.0, PI, 0.0])
STRAIGHT = Arcs.exact([0.5], [0.0])
HALF, LOOP = PI * 0.0847, 2 * PI * 0.0372  # radii inferred from figure 6 of the paper [m]
SETUP_A = Arcs.exact([HALF, LOOP], [PI, 2 * PI])
SETUP_B = Arcs.exact([LOOP, HALF], [2 * PI, PI])

# The tension at a bar's mean angle against its mean tension: (μθ)²/24 where it slides, 2e-5 for 60 bars over
# 3π; a corner of the profile inside a bar costs up to μθ/8 of that bar, 5e-5 of the whole, and there are few.
DISCRETE = 5e-4
# An equilibrium is accepted at 1e-10 of the greatest tension on the way, which may be many times the last.
SOLVED = 1e-7

untimed = settings(deadline=None, max_examples=30)  # the first example compiles the kernels
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


def arcs_of(drawn):
    length, angle = np.array(drawn).T
    return Arcs.exact(length, angle)


def driven(history, arcs, hardware, bars=60):
    state = pretensioned_bars(hardware, arcs, bars)
    for tension_in in history:
        state = step(state, arcs, hardware, tension_in=tension_in)
    return state


def cornered(state, arcs):
    return to_corners(state.edge, state.tension, state.direction_index, arcs)


def by_corners(history, hardware):
    state = profile.pretensioned(hardware)
    for tension_in in history:
        state = profile.step(state, tension_in, hardware.friction.coefficient)
    return state


def line_of(bars, stiffness=1000.0, pretension=0.0, **others):
    return Line(np.full(bars, RHO), pretension, stiffness, **others)


# --- fixed route: the paper's numbers -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arcs", "pretension", "history", "elongation_mm"),
    [
        (HALF_CIRCLE, 0.0, [15.0], 1.9036),
        (HALF_CIRCLE, 0.0, [15.0, 10.0], 1.7284),
        (HALF_CIRCLE, 0.0, [15.0, 6.031], 1.2071),
        (WITH_STRAIGHTS, 0.0, [15.0], 1.9167),
        (HALF_CIRCLE, 10.0, [11.0], 0.0163),
        (HALF_CIRCLE, 5.0, [7.0], 0.1102),
    ],
)
def test_elongation_is_that_of_the_closed_form(arcs, pretension, history, elongation_mm):
    state = driven(history, arcs, rig(pretension))
    # 5e-5 mm is the last printed digit
    assert 1e3 * state.elongation == pytest.approx(elongation_mm, abs=1e-4 + DISCRETE * elongation_mm)


def test_setups_of_figure_6_differ_in_elongation_and_not_in_tension():
    a, b = driven([15.0], SETUP_A, rig()), driven([15.0], SETUP_B, rig())
    assert a.tension_out == pytest.approx(15.0 * math.exp(-3 * PI * MU), rel=1e-12)
    assert b.tension_out == pytest.approx(a.tension_out, rel=1e-12)
    assert 1e3 * (a.elongation - b.elongation) == pytest.approx(0.34, abs=0.005)  # two digits are printed


@given(histories, pieces, st.sampled_from([0.0, 5.0]), st.floats(0.01, 0.4))
@untimed
def test_any_history_of_force_gives_the_tensions_of_the_corner_list(history, drawn, pretension, friction):
    arcs, hardware = arcs_of(drawn), rig(pretension, friction)
    state, corners = driven(history, arcs, hardware, 25), by_corners(history, hardware)
    expected = to_bars(corners, arcs, hardware, 25)
    # the corner list treats changes of 1e-12 in ln T as rounding; bars solve to 1e-10 of 30 N
    np.testing.assert_allclose(state.tension, expected.tension, rtol=1e-9, atol=1e-8)
    width = friction * arcs.total_angle / 25
    bound = (
        RHO * arcs.total_length * max(*history, pretension) * (width**2 / 6 + 4 * len(history) * width / 25)
    )
    assert abs(state.elongation - transmit(corners, arcs, hardware).elongation) <= bound + 1e-15


@pytest.mark.parametrize("arcs", [HALF_CIRCLE, WITH_STRAIGHTS, SETUP_A, Arcs.exact([0.11, 0.2], [2.0, 0.7])])
def test_elongation_converges_with_order_two(arcs):
    truth = transmit(by_corners([15.0], rig()), arcs, rig()).elongation
    bars = np.array([12, 24, 48, 96, 192])
    errors = [abs(driven([15.0], arcs, rig(), n).elongation - truth) for n in bars]
    order = -np.polyfit(np.log(bars), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.15)  # joints of pieces fall unevenly into bars


def test_elongation_with_inner_corners_stays_within_an_envelope_of_order_two():
    history = [15.0, 5.0, 9.0, 7.0]
    truth = transmit(by_corners(history, rig()), SETUP_A, rig()).elongation
    for n in range(10, 200, 13):
        error = abs(driven(history, SETUP_A, rig(), n).elongation / truth - 1)
        # three corners, each μθ/8 of 1/n, on the loop with 2/3 of the angle on 0.47 of the length: ×1.4
        assert error <= 3 * 1.4 * MU * 3 * PI / (8 * n) / n * 15.0 / 7.0


def test_distal_tension_and_displacement_are_exact_with_any_number_of_bars():
    for bars in (1, 2, 7, 60):
        state = driven([15.0], HALF_CIRCLE, rig(), bars)
        assert state.tension_out == pytest.approx(15.0 * math.exp(-PI * MU), rel=1e-12)
        assert state.displacement_out == pytest.approx(state.tension_out / 1000.0, rel=1e-9)
        assert state.displacement_in == pytest.approx(state.elongation + state.displacement_out, rel=1e-9)


@given(histories)
@untimed
def test_position_drive_retraces_force_drive(history):
    hardware = rig(5.0)
    by_force = by_place = pretensioned_bars(hardware, SETUP_A, 30)
    for tension_in in history:
        before, by_force = by_force, step(by_force, SETUP_A, hardware, tension_in=tension_in)
        by_place = step(by_place, SETUP_A, hardware, displacement_in=by_force.displacement_in)
        np.testing.assert_allclose(by_place.tension[1:], by_force.tension[1:], atol=SOLVED)
        if abs(by_force.displacement_in - before.displacement_in) > 1e-12:  # less does not pass a contact
            assert by_place.tension_in == pytest.approx(tension_in, abs=SOLVED)


@pytest.mark.parametrize("parts", [2, 37])
def test_many_small_steps_give_what_one_big_step_gives(parts):
    one = many = driven([15.0, 9.0], SETUP_A, rig(2.0))
    start = one.displacement_in
    one = step(one, SETUP_A, rig(2.0), displacement_in=start - 2e-3)
    for k in range(1, parts + 1):
        many = step(many, SETUP_A, rig(2.0), displacement_in=start - 2e-3 * k / parts)
    np.testing.assert_allclose(many.tension, one.tension, atol=SOLVED)


def test_an_inner_loop_of_position_is_forgotten():
    top, outer = driven([15.0], SETUP_A, rig()), driven([15.0, 5.0], SETUP_A, rig())
    place, state = outer.displacement_in, outer
    for share in (0.8, 0.3, 0.6, 0.0):
        back = place + share * (top.displacement_in - place)
        state = step(state, SETUP_A, rig(), displacement_in=back)
        assert share == 0.0 or state.tension_in > outer.tension_in + 1.0
    np.testing.assert_allclose(state.tension, outer.tension, atol=SOLVED)


def test_without_friction_the_tension_is_the_same_all_along():
    state = pretensioned_bars(rig(3.0, 0.0), SETUP_A, 20)
    for place, arcs in ((1e-3, SETUP_A), (0.5e-3, HALF_CIRCLE), (2e-3, STRAIGHT)):
        state = step(state, arcs, rig(3.0, 0.0), displacement_in=place)
        np.testing.assert_allclose(state.tension, state.tension_in, atol=SOLVED)


# --- the route moves ----------------------------------------------------------------------------------------


@given(pieces, histories)
@untimed
def test_the_same_route_in_other_pieces_gives_the_same_answer(drawn, history):
    arcs = arcs_of(drawn)
    halved = Arcs.exact(np.repeat(arcs.length, 2) / 2, np.repeat(arcs.angle, 2) / 2)
    hardware, one = rig(4.0), pretensioned_bars(rig(4.0), arcs, 17)
    other = one
    for k, tension_in in enumerate(history):
        one = step(one, arcs, hardware, tension_in=tension_in)
        other = step(other, halved if k % 2 == 0 else arcs, hardware, tension_in=tension_in)
        np.testing.assert_allclose(other.tension, one.tension, atol=SOLVED)


def test_bends_that_vanish_under_a_held_position_leave_the_mean_tension_all_along():
    """Between two fixed ends the stretch is shared out and none is lost."""
    tendon = line_of(40, math.inf)
    state, edge = pretensioned_bars(rig(), SETUP_A, 40), np.linspace(0, 1, 41)
    bed = lay(edge, SETUP_A)
    pulled = advance(state, bed, coulomb(bed, MU), tendon, displacement_in=1.5e-3)
    bed = lay(edge, Arcs.exact(SETUP_A.length, [0.0, 0.0]))
    after = advance(pulled, bed, coulomb(bed, MU), tendon, displacement_in=1.5e-3)
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
    bed = lay(state.edge, Arcs.exact([0.501], [0.0]))
    after = advance(state, bed, coulomb(bed, MU), line_of(10, math.inf, 5.0), displacement_in=0.0)
    stretch = RHO * 0.5 * 5.0 + 0.001  # nothing but the path makes it longer
    np.testing.assert_allclose(after.tension, stretch / (RHO * 0.501), rtol=1e-9)
    more_in_view = line_of(10, math.inf, 5.0, stretches_with_route=False)
    after = advance(state, bed, coulomb(bed, MU), more_in_view, displacement_in=0.0)
    np.testing.assert_allclose(after.tension, 5.0, rtol=1e-12)


def test_a_tendon_that_grows_between_fixed_ends_loses_tension_and_counts_the_growth_as_elongation():
    state = pretensioned_bars(rig(5.0), STRAIGHT, 10)
    bed = lay(state.edge, STRAIGHT)
    warm = np.full(10, 1e-3)
    after = advance(
        state, bed, coulomb(bed, MU), line_of(10, math.inf, 5.0), displacement_in=0.0, eigenstrain=warm
    )
    np.testing.assert_allclose(after.tension, 5.0 - 1e-3 / RHO, rtol=1e-9)
    assert after.elongation == pytest.approx(0.0, abs=1e-15)  # both ends are fixed
    creep = advance(state, bed, coulomb(bed, MU), line_of(10, 1e3, 5.0), tension_in=5.0, eigenstrain=warm)
    assert creep.elongation == pytest.approx(0.5e-3, rel=1e-9)


def residual_of(old, new, bed, cone, tendon, strain):
    """Rebuild all movements from the new state and return the worst breach of any law [N].

    Bar law, cone, sign of the movement on either side, load, drive: none of it uses the solver's numbers.
    """
    stretch = tendon.compliance * bed.length
    growth = 1 - old.length / bed.length.sum() if tendon.stretches_with_route else 0.0
    gained = stretch * (new.tension - (1 - growth) * old.tension)[1:-1] - (new.slack - old.slack)[1:-1]
    gained += (strain - growth) * bed.length
    change, loosened = new.tension - old.tension, new.slack - old.slack
    last = new.displacement_out - old.displacement_out + tendon.compliance_out * change[-1] - loosened[-1]
    w = last + np.append(np.cumsum(gained[::-1])[::-1], 0.0)
    first = new.displacement_in - old.displacement_in - tendon.compliance_in * change[0] + loosened[0]
    breach = [abs(first - w[0]) / stretch.min()]
    if 0 < tendon.load_stiffness < math.inf:
        carried = tendon.load_stiffness * (new.displacement_out - old.displacement_out)
        breach.append(abs(change[-1] - carried))
    here = new.tension[1:] + cone.drag * w
    low = np.exp(-cone.pulling) * new.tension[:-1] - cone.force
    high = np.exp(cone.releasing) * new.tension[:-1] + cone.force
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
    tendon = Line(
        RHO * rng.uniform(0.5, 2.0, bars),
        5.0,
        rng.choice([300.0, 1000.0, math.inf]),
        rng.choice([0.0, 1e-5]),
        rng.choice([0.0, 1e-5]),
        bool(rng.integers(2)),
    )
    length, angle = rng.uniform(0.02, 0.2, count), rng.uniform(0.0, 3.0, count)
    state = pretensioned_bars(rig(5.0), Arcs.exact(length, angle), bars)
    friction, skew, size = rng.choice([0.0, 0.05, 0.145, 0.4]), rng.uniform(0.5, 1.5), rng.choice([0.02, 0.3])
    drag = np.full(bars + 1, rng.choice([0.0, 100.0]))
    for _ in range(12):
        angle = np.abs(angle + size * rng.normal(size=count))
        length = length * (1 + 1e-3 * size * rng.normal(size=count))
        bed = lay(state.edge, Arcs.exact(length, angle))
        cone = Cone(friction * bed.angle, skew * friction * bed.angle, 0.2 * skew * bed.span, drag)
        strain = 1e-4 * size * rng.normal(size=bars)
        if rng.integers(2):
            drive = {"tension_in": max(state.tension_in + 5 * size * rng.normal(), 0.5)}
        else:
            drive = {"displacement_in": state.displacement_in + size * 5e-4 * abs(rng.normal())}
        new = advance(state, bed, cone, tendon, **drive, eigenstrain=strain)
        assert residual_of(state, new, bed, cone, tendon, strain) <= 1e-6  # 1e-14 m at 1e7 N/m, and SOLVED
        state = new


# --- ends ---------------------------------------------------------------------------------------------------


def test_a_dead_weight_keeps_its_tension_and_is_lifted_once_friction_is_overcome():
    state, tendon = pretensioned_bars(rig(5.0), HALF_CIRCLE, 30), line_of(30, 0.0, 5.0)
    bed = lay(state.edge, HALF_CIRCLE)
    cone = coulomb(bed, MU)
    lifted = advance(state, bed, cone, tendon, displacement_in=10e-3)
    assert lifted.tension_out == 5.0
    assert lifted.tension_in == pytest.approx(5.0 * math.exp(PI * MU), rel=1e-9)
    assert lifted.displacement_out == pytest.approx(10e-3 - lifted.elongation, rel=1e-9)
    lowered = advance(lifted, bed, cone, tendon, displacement_in=-10e-3)
    assert lowered.tension_in == pytest.approx(5.0 * math.exp(-PI * MU), rel=1e-9)


@pytest.mark.parametrize("tension_in", [8.0, 3.0])
def test_a_force_that_no_dead_weight_balances_is_refused(tension_in):
    state = pretensioned_bars(rig(5.0), HALF_CIRCLE, 10)
    with pytest.raises(SettingsError, match=r"dead weight of 5 N .* 3\.171 to 7\.885 N; drive by position"):
        step(state, HALF_CIRCLE, rig(5.0, MU, 0.0), tension_in=tension_in)


def test_springs_in_series_add_their_stretch_to_the_movements_and_none_to_the_elongation():
    bed = lay(np.linspace(0, 1, 21), HALF_CIRCLE)
    state, cone = pretensioned_bars(rig(), HALF_CIRCLE, 20), coulomb(bed, MU)
    plain = advance(state, bed, cone, line_of(20), tension_in=15.0)
    tendon = line_of(20, compliance_in=2e-5, compliance_out=3e-5)
    soft = advance(state, bed, cone, tendon, tension_in=15.0)
    np.testing.assert_allclose(soft.tension, plain.tension, rtol=1e-9)
    assert soft.elongation == pytest.approx(plain.elongation, rel=1e-9)
    extra = 2e-5 * 15.0 + 3e-5 * soft.tension_out
    assert soft.displacement_in == pytest.approx(plain.displacement_in + extra, rel=1e-9)
    assert soft.displacement_out == pytest.approx(plain.displacement_out, rel=1e-9)
    again = advance(state, bed, cone, tendon, displacement_in=soft.displacement_in)
    np.testing.assert_allclose(again.tension, soft.tension, atol=SOLVED)


def test_slack_is_taken_up_before_tension_rises():
    pulled = driven([15.0], HALF_CIRCLE, rig())
    loose = step(pulled, HALF_CIRCLE, rig(), displacement_in=-5e-3)
    assert not loose.tension.any()
    assert loose.slack.sum() == pytest.approx(5e-3, rel=1e-9)
    assert loose.displacement_in == -5e-3
    nearly = step(loose, HALF_CIRCLE, rig(), displacement_in=-1e-6)
    assert not nearly.tension.any()
    assert nearly.slack.sum() == pytest.approx(1e-6, rel=1e-6)
    again = step(nearly, HALF_CIRCLE, rig(), displacement_in=pulled.displacement_in)
    np.testing.assert_allclose(again.tension, pulled.tension, rtol=1e-8)
    assert not again.slack.any()


def test_letting_go_by_force_slackens_the_whole_tendon():
    state = driven([15.0, 0.0], SETUP_A, rig(5.0))
    np.testing.assert_allclose(state.tension, 0.0, atol=SOLVED)
    assert step(state, SETUP_A, rig(5.0), tension_in=4.0).tension_out == pytest.approx(
        4.0 * math.exp(-3 * PI * MU), rel=1e-9
    )


# --- the cone -----------------------------------------------------------------------------------------------


def test_each_number_of_the_cone_acts_on_its_side():
    bed = lay(np.linspace(0, 1, 6), HALF_CIRCLE)
    state = pretensioned_bars(rig(5.0), HALF_CIRCLE, 5)
    cone = Cone(0.1 * bed.angle, 0.2 * bed.angle, np.linspace(0.0, 0.1, 6), np.zeros(6))
    up, down, expected_up, expected_down = 15.0, 1.0, [15.0], [1.0]
    for i in range(6):
        up = math.exp(-0.1 * bed.angle[i]) * up - cone.force[i]
        down = math.exp(0.2 * bed.angle[i]) * down + cone.force[i]
        expected_up.append(up)
        expected_down.append(down)
    pulled = advance(state, bed, cone, line_of(5, pretension=5.0), tension_in=15.0)
    np.testing.assert_allclose(pulled.tension, expected_up, rtol=1e-9)
    released = advance(pulled, bed, cone, line_of(5, pretension=5.0), tension_in=1.0)
    np.testing.assert_allclose(released.tension, expected_down, rtol=1e-9)


def test_drag_takes_force_in_proportion_to_the_movement_and_nothing_where_it_sticks():
    bed, drag = lay(np.linspace(0, 1, 9), STRAIGHT), np.full(9, 30.0)
    cone = Cone(np.zeros(9), np.zeros(9), np.zeros(9), drag)
    state, tendon = pretensioned_bars(rig(5.0), STRAIGHT, 8), line_of(8, 0.0, 5.0)
    rigid = Line(np.full(8, 1e-8), 5.0, 0.0)  # all contacts move alike
    moved = advance(state, bed, cone, rigid, displacement_in=2e-3)
    assert moved.tension_in == pytest.approx(
        5.0 + 9 * 30.0 * 2e-3, rel=1e-4
    )  # it stretches by 1e-8 per newton
    held = advance(moved, bed, cone, tendon, displacement_in=2e-3)
    assert held.tension_in < moved.tension_in


# --- the solver ---------------------------------------------------------------------------------------------


def balanced(trial, stiffness, low, high, force, drive):
    """The slow twin: move one contact after the other into its cone, by bisection, until nothing moves."""
    w = np.zeros(len(low))

    def tension(j):
        near, far = w[j - 1] if j > 0 else 0.0, w[j] if j < len(w) else 0.0
        return trial[j] + stiffness[j] * (near - far)

    for _ in range(3000):
        before = w.copy()
        for i in range(len(w)):
            side, breach = 0.0, lambda i=i: tension(i + 1) - low[i] * tension(i) + force[i]
            w[i] = 0.0
            if breach() < 0:
                side = 1.0
            else:
                breach = lambda i=i: tension(i + 1) - high[i] * tension(i) - force[i]  # noqa: E731
                side = -1.0 if breach() > 0 else 0.0
            if side:
                at_rest = breach()
                w[i] = side * 1e-3
                w[i] = -at_rest / ((breach() - at_rest) / w[i])  # linear as long as nothing is slack
        if np.max(np.abs(w - before)) < 1e-17:
            break
    return np.array([tension(j) for j in range(len(trial))])


def random_chain(rng, bars):
    angle = rng.uniform(0.0, 0.3, bars + 1)
    stiffness = np.concatenate(([0.0], rng.uniform(1e4, 3e4, bars), [1000.0]))
    trial = rng.uniform(4.0, 12.0, bars + 2)
    force = rng.uniform(0.0, 0.2, bars + 1)
    none = np.zeros(bars + 1)
    return trial, stiffness, np.exp(-angle), np.exp(1.3 * angle), force, none, (False, False), 0.0


@pytest.mark.parametrize("patience", [(6, 10), (0, 10), (0, 0)])
@pytest.mark.parametrize("seed", range(8))
def test_newton_and_nested_iteration_find_the_equilibrium_of_the_slow_twin(seed, patience):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, 6)
    before = rng.integers(-1, 2, 7).astype(np.int8)
    _, tension, _, _, residual = equilibrium(chain, False, before, patience)
    assert residual <= 1e-9 * 12.0  # ten times what is accepted, of the greatest tension
    expected = balanced(*chain[:5], chain[0][0])
    np.testing.assert_allclose(
        tension, expected, atol=1e-8
    )  # the twin stops at 1e-17 m and creeps by 1e-2 a sweep


# --- handing over -------------------------------------------------------------------------------------------


@given(histories, tensions, pieces)
@untimed
def test_it_does_not_matter_when_corners_are_exchanged_for_bars(history, last, drawn):
    arcs, hardware = arcs_of(drawn), rig(5.0)
    corners = by_corners(history, hardware)
    late = to_bars(profile.step(corners, last, MU), arcs, hardware, 20)
    early = step(to_bars(corners, arcs, hardware, 20), arcs, hardware, tension_in=last)
    np.testing.assert_allclose(early.tension, late.tension, rtol=1e-9, atol=1e-8)
    assert early.displacement_in - early.displacement_out == pytest.approx(early.elongation, abs=1e-12)


@given(histories, pieces)
@untimed
def test_bars_exchanged_for_corners_and_back_keep_their_tension(history, drawn):
    arcs, hardware = arcs_of(drawn), rig(5.0)
    state = driven(history, arcs, hardware, 20)
    back = to_bars(cornered(state, arcs), arcs, hardware, 20)
    # corners on one line are dropped within 1e-9 in ln T; SOLVED where all is slack
    np.testing.assert_allclose(back.tension, state.tension, rtol=1e-7, atol=SOLVED)
    assert cornered(state, arcs).direction_index == state.direction_index


def test_a_full_pull_exchanged_for_corners_is_one_line():
    corners = cornered(driven([15.0], SETUP_A, rig()), SETUP_A)
    np.testing.assert_allclose(corners.angle, [0.0, 3 * PI], rtol=1e-12)
    np.testing.assert_allclose(np.exp(corners.log_tension), [15.0, 15.0 * math.exp(-3 * PI * MU)], rtol=1e-9)


# --- the boundary -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({}, "give tension_in .* or displacement_in .*, not both"),
        ({"tension_in": 1.0, "displacement_in": 0.0}, "not both"),
        ({"tension_in": -1.0}, "tension_in is -1 N: .*>= 0 N"),
        ({"tension_in": math.nan}, "tension_in is nan N"),
        ({"displacement_in": math.inf}, "displacement_in is inf m: give a finite position"),
    ],
)
def test_a_step_without_one_possible_drive_is_refused(drive, message):
    with pytest.raises(SettingsError, match=message):
        step(pretensioned_bars(rig(), HALF_CIRCLE), HALF_CIRCLE, rig(), **drive)


def test_a_tendon_that_does_not_stretch_is_refused():
    with pytest.raises(SettingsError, match=r"tendon\.compliance_per_N is 0 1/N: .* at least 1e-09 1/N"):
        line(Rig(tendon=Tendon(compliance_per_N=0.0)), 10)


def test_a_step_leaves_the_old_state_as_it_was():
    state = driven([15.0, 10.0], SETUP_A, rig())
    before = state.tension.copy()
    step(state, HALF_CIRCLE, rig(), tension_in=3.0)
    np.testing.assert_array_equal(state.tension, before)
    for array in (state.edge, state.tension, state.slack, state.inelastic, state.slip):
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("history", "sign"), [([], 1), ([15.0], 1), ([15.0, 9.0], -1), ([15.0, 9.0, 9.0], -1)]
)
def test_the_direction_index_is_that_of_the_last_movement(history, sign):
    assert driven(history, HALF_CIRCLE, rig()).direction_index == sign


def test_bars_that_go_slack_one_by_one_reach_an_equilibrium():
    """Constant friction holds tension between slack bars; the hardest case for the solver."""
    rng = np.random.default_rng(5)
    state, tendon = pretensioned_bars(rig(5.0), SETUP_A, 40), line_of(40, math.inf, 5.0)
    bed = lay(state.edge, SETUP_A)
    cone = Cone(MU * bed.angle, MU * bed.angle, 0.5 * bed.span, np.zeros(41))
    for _ in range(30):
        strain = 1e-4 + 3e-4 * rng.normal(size=40)
        new = advance(state, bed, cone, tendon, displacement_in=0.0, eigenstrain=strain)
        assert residual_of(state, new, bed, cone, tendon, strain) <= 1e-6
        state = new
    assert (state.slack[1:-1] > 0).sum() > 10
