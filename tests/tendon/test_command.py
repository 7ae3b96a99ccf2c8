"""The command turns the model round: carried out, it brings the distal end to its target."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tssgeom.errors import SettingsError
from tssgeom.rig import Friction, Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.capstan import Corners
from tssgeom.tendon.command import compensate
from tssgeom.tendon.state import pretensioned, step, transmit

PI, MU = math.pi, 0.145
HALF_CIRCLE = Arcs.exact([0.5], [PI])
WITH_STRAIGHTS = Arcs.exact([0.1, 0.3, 0.1], [0.0, PI, 0.0])

untimed = settings(deadline=None, max_examples=30)  # the first example compiles the kernels
pieces = st.lists(
    st.tuples(st.floats(0.02, 0.3), st.one_of(st.just(0.0), st.floats(0.01, 3.0))), min_size=1, max_size=4
)
# A target in newtons of at least 0.1: relative 1e-9 is then never less than the rounding of ln T.
targets = st.lists(st.floats(0.1, 30.0), min_size=1, max_size=8)


def arcs_of(parts):
    return Arcs.exact([length for length, _ in parts], [angle for _, angle in parts])


@given(targets, pieces, st.sampled_from([0.0, 5.0]), st.floats(0.0, 0.4))
@untimed
def test_on_a_fixed_route_the_model_carries_out_the_inverse(wanted, parts, pretension, friction):
    rig = Rig(tendon=Tendon(pretension_N=pretension), friction=Friction(coefficient=friction))
    arcs, state = arcs_of(parts), pretensioned(rig)
    forward = state
    for target in wanted:
        command = compensate(state, arcs, rig, tension_out=target)
        state = command.state
        forward = step(forward, arcs, rig, tension_in=command.tension_in)
        assert isinstance(forward.along, Corners)
        assert transmit(forward, rig).tension_out == pytest.approx(target, rel=1e-9)
        assert transmit(forward, rig).displacement_in == pytest.approx(command.displacement_in, abs=1e-12)


@given(targets, pieces)
@untimed
def test_on_a_fixed_route_the_inverse_finds_the_drive_wherever_the_distal_end_answers(history, parts):
    """Forward, then back: outside the dead zones the inverse returns the drive; inside it is not unique."""
    rig, arcs = Rig(), arcs_of(parts)
    forward = back = pretensioned(rig)
    tension_out = 0.0
    for tension_in in history:
        forward = step(forward, arcs, rig, tension_in=tension_in)
        observed, before = transmit(forward, rig), tension_out
        tension_out = observed.tension_out
        command = compensate(back, arcs, rig, displacement_out=observed.displacement_out)
        # a drive that comes back to the end of the dead zone leaves the distal end where it was
        replied = abs(observed.tension_out - before) > 1e-9 * before
        if not observed.dead_zone and replied:
            assert command.tension_in == pytest.approx(tension_in, rel=1e-9)
            assert command.displacement_in == pytest.approx(observed.displacement_in, rel=1e-9, abs=1e-12)
        back = forward


@given(st.lists(st.tuples(st.floats(0.1, 30.0), pieces), min_size=1, max_size=5))
@untimed
def test_on_a_moving_route_the_model_carries_out_the_inverse(moves):
    rig = Rig(tendon=Tendon(pretension_N=2.0))
    state = pretensioned(rig)
    forward = state
    for target, parts in moves:
        command = compensate(state, arcs_of(parts), rig, tension_out=target)
        state = command.state
        forward = step(forward, arcs_of(parts), rig, tension_in=command.tension_in)
        # equilibria are solved to 1e-10 of the greatest tension on the way, up to 30·exp(0.145·12) N here
        assert transmit(forward, rig).tension_out == pytest.approx(target, rel=1e-9, abs=3e-8)


def test_a_reversal_jumps_the_dead_zone():
    """docs/model.md (53): from T_out·exp(μΦ) to T_out·exp(−μΦ)."""
    state = compensate(pretensioned(Rig()), HALF_CIRCLE, Rig(), tension_out=10.0)
    assert state.tension_in == pytest.approx(10.0 * math.exp(MU * PI), rel=1e-12)
    back = compensate(state.state, HALF_CIRCLE, Rig(), tension_out=9.999)
    assert back.tension_in == pytest.approx(9.999 * math.exp(-MU * PI), rel=1e-12)


def test_a_target_that_is_reached_already_moves_nothing():
    state = compensate(pretensioned(Rig()), HALF_CIRCLE, Rig(), tension_out=10.0).state
    loosened = step(state, HALF_CIRCLE, Rig(), tension_in=9.0)
    command = compensate(loosened, HALF_CIRCLE, Rig(), tension_out=10.0)
    assert command.tension_in == pytest.approx(9.0, rel=1e-12)


def test_a_bend_that_comes_is_pulled_against_and_the_load_stays():
    state = compensate(pretensioned(Rig()), WITH_STRAIGHTS, Rig(), displacement_out=8e-3).state
    bent = Arcs.exact([0.1, 0.3, 0.1], [1.0, PI, 0.5])
    command = compensate(state, bent, Rig(), displacement_out=8e-3)
    # bends added to a stuck tendon move nothing: the drive may stay, and the load does
    assert transmit(command.state, Rig()).displacement_out == pytest.approx(8e-3, rel=1e-9)
    further = compensate(command.state, bent, Rig(), displacement_out=9e-3)
    assert further.tension_in == pytest.approx(9.0 * math.exp(MU * (PI + 1.5)), rel=1e-9)


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ({"displacement_out": -1e-3}, "only pulls"),
        ({"tension_out": math.inf}, "only pulls"),
        ({"tension_out": math.nan}, "only pulls"),
        ({}, "one target"),
        ({"tension_out": 1.0, "displacement_out": 0.0}, "one target"),
    ],
)
def test_a_target_out_of_reach_is_refused(target, said):
    with pytest.raises(SettingsError, match=said):
        compensate(pretensioned(Rig()), HALF_CIRCLE, Rig(), **target)


def test_the_displacement_of_a_dead_weight_is_no_target():
    rig = Rig(load=Load(stiffness_N_per_m=0.0))
    with pytest.raises(SettingsError, match="dead weight"):
        compensate(pretensioned(rig), HALF_CIRCLE, rig, displacement_out=0.001)
