"""One state for fixed and moving routes: exact while nothing moves, then bars; saved to the last bit."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tssgeom.effects import Creep
from tssgeom.errors import SettingsError, ShapeError
from tssgeom.io.formats.states import read_state
from tssgeom.rig import Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.capstan import Corners
from tssgeom.tendon.moving import MovingRoute, between, unmoved
from tssgeom.tendon.saved import route_object, route_of, state_object, state_of
from tssgeom.tendon.state import (
    HALVINGS,
    pretensioned,
    step,
    tension,
    transmit,
)

PI, MU = math.pi, 0.145
HALF_CIRCLE = Arcs.exact([0.5], [PI])
BENT = Arcs.exact([0.2, 0.3], [1.0, 2.5])
# Bars stand for the profile at their middles: δ is off by at most 5e-4 for 60 bars over these angles.
DISCRETE = 5e-4

untimed = settings(deadline=None, max_examples=30)  # the first example compiles the kernels
histories = st.lists(st.floats(0.1, 30.0), min_size=1, max_size=6)


def sensed(length, angle, angle_se, length_se=0.0):
    """A route whose pieces have independent errors."""
    k = len(length)
    variance = np.concatenate((np.full(k, length_se**2), np.full(k, angle_se**2)))
    return Arcs(np.array(length), np.array(angle), np.diag(variance), "arcs")


def driven(history, arcs, rig=None):
    rig = rig or Rig()
    state = pretensioned(rig)
    for tension_in in history:
        state = step(state, arcs, rig, tension_in=tension_in)
    return state


# --- which of the two forms it takes ------------------------------------------------------------------------


@given(histories)
@untimed
def test_on_a_fixed_route_the_state_is_the_corner_list(history):
    corners = profile.pretensioned(Rig())
    for tension_in in history:
        corners = profile.step(corners, tension_in, MU)
    state = driven(history, HALF_CIRCLE)
    assert transmit(state, Rig()) == profile.transmit(corners, HALF_CIRCLE, Rig())


@given(histories)
@untimed
def test_the_proximal_tension_is_the_one_that_was_set(history):
    state = driven(history, HALF_CIRCLE)
    assert transmit(state, Rig()).tension_in == pytest.approx(history[-1], rel=1e-12)
    assert transmit(driven([14.0], HALF_CIRCLE), Rig()).tension_in == 14.0  # exp(ln 14) is not quite 14


def test_a_position_drive_goes_on_in_bars_from_the_same_tension():
    pulled = driven([15.0, 10.0], HALF_CIRCLE)
    before = transmit(pulled, Rig())
    held = step(pulled, HALF_CIRCLE, Rig(), displacement_in=before.displacement_in)
    after = transmit(held, Rig())
    assert isinstance(held.along, BarState)
    assert after.tension_out == pytest.approx(before.tension_out, rel=1e-12)
    assert after.elongation == pytest.approx(before.elongation, rel=DISCRETE)


def test_a_tension_that_is_uniform_needs_no_bars_on_any_route():
    rig = Rig(tendon=Tendon(pretension_N=5.0))
    state = pretensioned(rig)
    for arcs in (HALF_CIRCLE, BENT, HALF_CIRCLE):
        state = step(state, arcs, rig, tension_in=5.0)
        assert state.route is arcs
    assert isinstance(state.along, Corners)
    assert transmit(state, rig).elongation == pytest.approx(0.0, abs=1e-15)  # exp(ln 5) is not quite 5


def test_a_route_that_moves_under_load_goes_on_in_bars_and_stays_there():
    state = step(driven([15.0], HALF_CIRCLE), BENT, Rig(), tension_in=15.0)
    assert isinstance(state.along, BarState)
    assert isinstance(step(state, BENT, Rig(), tension_in=12.0).along, BarState)


def test_an_inserted_tendon_is_not_stretched_by_its_route():
    rig = Rig(tendon=Tendon(pretension_N=5.0))
    held = transmit(step(pretensioned(rig), HALF_CIRCLE, rig, displacement_in=0.0), rig)
    longer = Arcs.exact([0.6], [PI])
    state = step(
        step(pretensioned(rig), HALF_CIRCLE, rig, displacement_in=0.0), longer, rig, displacement_in=0.0
    )
    assert transmit(state, rig).tension_in == pytest.approx(held.tension_in, rel=1e-9)
    pulled = step(state, Arcs.exact([0.601], [PI]), rig, displacement_in=0.0, stretches_with_route=True)
    assert transmit(pulled, rig).tension_in > 5.1  # 1 mm on 0.6 m is 5 N between held ends, less the spring


def test_after_a_reversal_of_position_the_proximal_tension_is_that_of_the_corner_list():
    rig, positions, tensions = Rig(), [], [15.0, 14.0, 12.0, 14.5]
    corners = profile.pretensioned(rig)
    for tension_in in tensions:
        corners = profile.step(corners, tension_in, MU)
        positions.append(profile.transmit(corners, HALF_CIRCLE, rig).displacement_in)
    state = pretensioned(rig)
    for location, tension_in in zip(positions, tensions, strict=True):
        state = step(state, HALF_CIRCLE, rig, displacement_in=location)
        # known to half of the first bar, and δ to 1 µm where the dead zone is as stiff as 13 N/mm
        cone = MU * PI / 60 / 2**HALVINGS / 2
        assert state.tension_in == pytest.approx(tension_in, rel=cone, abs=0.013)


# --- noise and drift ----------------------------------------------------------------------------------------


def test_a_route_that_only_trembles_does_not_shake_the_tendon():
    rng = np.random.default_rng(4)
    state = driven([15.0, 10.0], sensed([0.2, 0.3], [1.0, 2.0], 0.01))
    before = transmit(state, Rig())
    for _ in range(50):
        angle = [1.0, 2.0] + 0.005 * rng.standard_normal(2)  # half the error, so never beyond three
        state = step(state, sensed([0.2, 0.3], angle, 0.01), Rig(), tension_in=10.0)
    assert transmit(state, Rig()) == before


def test_a_slow_drift_is_followed_although_each_step_is_less_than_the_error():
    route, state = [1.0, 2.0], driven([15.0], sensed([0.2, 0.3], [1.0, 2.0], 0.01))
    for k in range(100):
        route = [1.0 - 0.005 * k, 2.0]
        state = step(state, sensed([0.2, 0.3], route, 0.01), Rig(), tension_in=15.0)
    # never further from what was sensed than three errors of the sum and of the difference
    assert abs(state.route.total_angle - sum(route)) <= 3 * math.sqrt(4) * 0.01
    assert state.tension_out > 1.04 * 15.0 * math.exp(-3.0 * MU)


@pytest.mark.parametrize("cut", [0.3, 0.5, 0.81])
def test_the_same_route_in_other_pieces_has_not_moved(cut):
    whole = Arcs.exact([0.5], [2.0])
    assert unmoved(whole, Arcs.exact([cut * 0.5, (1 - cut) * 0.5], [cut * 2.0, (1 - cut) * 2.0]))
    assert not unmoved(
        whole, Arcs.exact([cut * 0.5, (1 - cut) * 0.5], [cut * 2.0 + 1e-6, (1 - cut) * 2.0 - 1e-6])
    )


def test_a_joint_of_unknown_position_may_lie_elsewhere():
    """Two pieces of one length with one joint that is known to 2 mm: φ between them is as uncertain."""
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = 2e-3**2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    slope = 10.0  # [1/m] of the second piece, straight before: a longer straight piece takes its angle
    covariance[3, 3] = (slope * 2e-3) ** 2
    covariance[0, 3] = covariance[3, 0] = -slope * 2e-3**2
    covariance[1, 3] = covariance[3, 1] = slope * 2e-3**2
    here = Arcs(np.array([0.25, 0.25]), np.array([0.0, 2.5]), covariance, "arcs")
    near = Arcs(np.array([0.252, 0.248]), np.array([0.0, 2.48]), covariance, "arcs")
    far = Arcs(np.array([0.265, 0.235]), np.array([0.0, 2.35]), covariance, "arcs")
    assert unmoved(here, near)
    assert not unmoved(here, far)


def test_what_no_point_shows_of_a_route_is_the_same_in_each_frame_and_hides_no_movement():
    noise, form = np.diag([0.0, 0.0, 1e-4, 1e-4]), np.zeros((4, 4))
    form[2:, 2:] = 0.09  # [rad²] of an angle of 2 rad, half of it in each piece
    here, far = (
        Arcs(np.array([0.2, 0.3]), np.array([angle, angle]), noise + form, "arcs") for angle in (1.0, 1.1)
    )
    assert unmoved(here, far)
    here, far = (replace(route, form_variance=0.36) for route in (here, far))
    assert here.noise_covariance == pytest.approx(noise)
    assert not unmoved(here, far)
    assert here.scaled(angle=0.5).noise_covariance[2:, 2:] == pytest.approx(0.25 * noise[2:, 2:])
    assert between(here, far, 0.5).form_variance == pytest.approx(0.18)
    assert not unmoved(here, route_of(json.loads(json.dumps(route_object(far)))))


def test_what_the_model_leaves_unknown_of_frames_that_share_it_hides_no_movement_from_the_tendon():
    noise, models = np.diag([0.0, 0.0, 1e-4, 1e-4]), np.zeros((4, 4))
    models[2:, 2:] = 0.09  # [rad²] of an angle of 3.5 rad: 0.6 rad in all
    wide = [
        Arcs(np.array([0.2, 0.3]), share * np.array([1.75, 1.75]), noise + share**2 * models, "arcs")
        for share in (1.0, 0.9, 0.8, 0.9, 1.0)
    ]
    shared = [replace(route, model_variance=4.0 * route.covariance[2, 3]) for route in wide]
    ends = []
    for routes in (wide, [wide[0], *shared]):  # the first fit is from nothing, and the second replaces it
        state = pretensioned(Rig())
        for route in routes:
            state = step(state, route, Rig(), tension_in=10.0)
        ends.append(transmit(state, Rig()).tension_out)
    still, least = (10.0 * math.exp(-MU * angle) for angle in (3.5, 0.8 * 3.5))
    assert ends == pytest.approx([still, least], rel=1e-3)
    far = shared[1]
    assert far.covariance_without_form == pytest.approx(far.covariance)
    assert far.scaled(angle=0.5).noise_covariance[2:, 2:] == pytest.approx(0.25 * noise[2:, 2:])
    assert far.with_errors(0.5).model_variance == pytest.approx(0.25 * far.model_variance)
    assert between(far, far, 1e-12).model_variance == pytest.approx(far.model_variance)
    assert route_of(json.loads(json.dumps(route_object(far)))).model_variance == far.model_variance


# --- between frames -----------------------------------------------------------------------------------------


def test_halfway_between_two_routes_length_and_angle_are_halfway_everywhere():
    first, second = sensed([0.2, 0.3], [1.0, 2.0], 0.01), sensed([0.1, 0.2, 0.3], [0.0, 3.0, 1.0], 0.02)
    middle = between(first, second, 0.5)
    assert middle.total_length == pytest.approx(0.55, rel=1e-12)
    assert middle.total_angle == pytest.approx(3.5, rel=1e-12)
    assert middle.total_angle_se == pytest.approx(0.5 * math.sqrt(2 * 0.01**2 + 3 * 0.02**2), rel=1e-9)
    share = 0.4  # both at a joint or inside a piece
    first_there, second_there = 1.0, 3.0 * (share - 1 / 6) * 3
    cut = np.cumsum(middle.length) <= share * middle.total_length * (1 + 1e-12)
    assert middle.angle[cut].sum() == pytest.approx(0.5 * (first_there + second_there), rel=1e-9)


def test_a_recorded_route_is_held_before_its_first_and_after_its_last_frame():
    route = MovingRoute(np.array([1.0, 2.0]), [HALF_CIRCLE, BENT])
    assert route.at(0.0) is HALF_CIRCLE
    assert route.at(1.0) is HALF_CIRCLE
    assert route.at(9.0) is BENT
    assert route.at(1.25).total_angle == pytest.approx(0.75 * PI + 0.25 * 3.5, rel=1e-12)
    with pytest.raises(ShapeError, match="no frame"):
        MovingRoute(np.array([]), [])


# --- slip front, drawing, saving ----------------------------------------------------------------------------


def test_the_slip_front_is_where_the_dead_zone_ends():
    """docs/model.md (4): φ* = ln(T_max/T_in)/(2μ), for corners and for bars."""
    state = driven([15.0, 10.0], HALF_CIRCLE)
    assert transmit(state, Rig()).slip_front == pytest.approx(math.log(1.5) / (2 * MU), rel=1e-9)
    bars = driven([15.0], HALF_CIRCLE)
    bars = step(bars, HALF_CIRCLE, Rig(), displacement_in=transmit(bars, Rig()).displacement_in)
    bars = step(bars, HALF_CIRCLE, Rig(), tension_in=10.0)
    width = PI / 60  # of a bar
    assert transmit(bars, Rig()).slip_front == pytest.approx(math.log(1.5) / (2 * MU), abs=width)
    assert transmit(driven([15.0], HALF_CIRCLE), Rig()).slip_front == pytest.approx(PI, rel=1e-12)


def test_bars_on_a_sensed_route_have_the_standard_errors_of_corners():
    arcs = sensed([0.2, 0.3], [1.0, 2.0], 0.02)
    corners = transmit(driven([15.0], arcs), Rig())
    bars = step(pretensioned(Rig()), arcs, Rig(), displacement_in=corners.displacement_in)
    observed = transmit(bars, Rig())
    assert observed.tension_out_se == pytest.approx(corners.tension_out_se, rel=1e-3)  # δ is known to 5e-4
    assert observed.elongation_se == pytest.approx(corners.elongation_se, rel=1e-3)


def test_the_ends_of_bars_have_the_tensions_of_the_state():
    pulled = driven([15.0], HALF_CIRCLE)
    bars = step(pulled, BENT, Rig(), tension_in=15.0)
    ends = tension(bars, np.array([0.0, 3.5]))
    assert ends == pytest.approx([bars.tension_in, bars.tension_out], rel=1e-9)


@given(histories, st.booleans())
@untimed
def test_a_saved_state_goes_on_bit_for_bit(history, moving):
    state = driven(history, HALF_CIRCLE)
    if moving:
        state = step(state, BENT, Rig(), tension_in=history[-1])
    revived = state_of(json.loads(json.dumps(state_object(state), allow_nan=False)))
    assert transmit(revived, Rig()) == transmit(state, Rig())
    forward = [step(one, BENT, Rig(), tension_in=7.0) for one in (state, revived)]
    assert transmit(forward[0], Rig()) == transmit(forward[1], Rig())


SETTINGS = Path(__file__).parents[1] / "io" / "corpus" / "settings"
OF_VERSION_3 = [
    ("state_bars.json", Rig(), (1.8434849578560712, 2.648935282572277), 0.009764115472200631),
    (
        "state_effects.json",
        Rig(effects=(Creep(ratio=0.1),)),
        (1.8226376546710934, 2.618979433614654),
        0.005005813978398253,
    ),
]


@pytest.mark.parametrize(("file", "rig", "tensions", "position"), OF_VERSION_3)
def test_a_state_that_an_older_program_saved_goes_on_as_it_did_there(file, rig, tensions, position):
    """The numbers are those of the program that wrote version 3; 1e-11 is ten times what is solved to."""
    state, bent = read_state(SETTINGS / file), Arcs.exact([0.2, 0.3], [1.0, 1.5])
    located = step(state, bent, rig, displacement_in=0.003, time=2.0)
    assert (located.tension_in, located.tension_out) == pytest.approx(tensions, rel=1e-9)
    pulled = transmit(step(state, bent, rig, tension_in=6.0, time=2.0), rig)
    assert pulled.displacement_in == pytest.approx(position, rel=1e-11)


@pytest.mark.parametrize("spoilt", [{"version": 99}, {"kind": "knots"}, {"along": {"angle": [0.0]}}])
def test_a_saved_state_that_is_none_is_refused(spoilt):
    with pytest.raises(SettingsError, match="saved state"):
        state_of(state_object(driven([15.0], HALF_CIRCLE)) | spoilt)


def test_a_tendon_on_no_route_has_no_distal_end():
    with pytest.raises(SettingsError, match="no route yet"):
        transmit(pretensioned(Rig()), Rig())


def test_a_tendon_that_hangs_loose_pulls_again_once_its_slack_is_taken_up():
    """Released by 2 mm beyond its rest, pulled again: nothing for 2 mm, then as on the first pull."""
    rig, state = Rig(), driven([15.0], HALF_CIRCLE)
    for location in (-2e-3, -1.5e-3, -0.3e-3, 0.0):
        state = step(state, HALF_CIRCLE, rig, displacement_in=location)
        assert (state.tension_in, state.tension_out) == (0.0, 0.0)
    # bars took over at 15 N with a δ that is off by up to 5e-4 of 1.9 mm: the slack ends that much off zero
    first = step(pretensioned(rig), HALF_CIRCLE, rig, displacement_in=5e-3)
    again = step(state, HALF_CIRCLE, rig, displacement_in=5e-3)
    assert again.tension_out == pytest.approx(first.tension_out, abs=1e-3)


def test_a_drive_that_lets_go_leaves_no_tension_and_the_load_at_rest():
    rig = Rig(tendon=Tendon(pretension_N=4.0))
    state = step(driven([15.0], HALF_CIRCLE, rig), BENT, rig, tension_in=15.0)
    loose = transmit(step(state, BENT, rig, tension_in=0.0), rig)
    assert (loose.tension_in, loose.tension_out) == (0.0, 0.0)
    assert loose.displacement_out == pytest.approx(-4e-3, rel=1e-9)  # the spring has lost its 4 N
    assert loose.elongation == pytest.approx(-4.0 * 3.16e-4 * 0.5, rel=DISCRETE)


def test_a_short_tendon_on_a_soft_load_moves_far_without_losing_accuracy():
    """What rounding leaves of a residual grows with stiffness times movement: here 1e8 N/m times 1 m."""
    rig, short = Rig(load=Load(stiffness_N_per_m=10.0)), Arcs.exact([0.02], [2.0])
    state = step(pretensioned(rig), short, rig, displacement_in=1.0)
    assert state.along.iterations < 20
    assert state.tension_out == pytest.approx(10.0, rel=1e-3)
    assert state.tension_out == pytest.approx(state.tension_in * math.exp(-2.0 * MU), rel=1e-9)


def test_no_drive_or_two_are_refused():
    for drives in ({}, {"tension_in": 5.0, "displacement_in": 0.001}):
        with pytest.raises(SettingsError, match="one drive"):
            step(pretensioned(Rig()), HALF_CIRCLE, Rig(load=Load(stiffness_N_per_m=500.0)), **drives)
