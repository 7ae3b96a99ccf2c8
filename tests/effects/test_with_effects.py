"""A rig with effects, step by step: the same run as in one march, on routes that stand and that move."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests.effects.rig import ARCS, FORCE, POSITION, PULLS, RIG, RUNS, TEMPERATURE, TIME
from tssgeom.effects import (
    KINDS,
    Backlash,
    ChannelLag,
    Creep,
    HiddenBend,
    TensionInGain,
    ThermalDrift,
    VelocityDependentFriction,
    ViscousDrag,
    with_size,
)
from tssgeom.errors import FitError, SettingsError
from tssgeom.rig import Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import predict
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.saved import state_object, state_of
from tssgeom.tendon.sensor_errors import readings, sensors_err
from tssgeom.tendon.simulation import simulate
from tssgeom.tendon.state import (
    pretensioned,
    step,
    tension,
    transmit,
)

STILL = MovingRoute(np.zeros(1), [ARCS])
DRIVES = {FORCE: "tension_in", POSITION: "displacement_in"}
BY_SPEED = ("velocity_dependent_friction", "viscous_drag")
BY_THEMSELVES = (*BY_SPEED, "creep", "thermal_drift")
AT_ONCE = ("presliding",)  # the load answers a little before anything slides


def with_effects(*effects):
    return changed(RIG, effects=effects)


MARCH = with_effects(Creep(ratio=0.0, time_s=9.0))  # no effect, but the bars and the steps of effects


def moments(drive, rig, route=STILL):
    return list(simulate(TIME, route, rig, **{DRIVES[drive]: RUNS[drive][drive]}, temperature=TEMPERATURE))


def driven(rig, tensions, route=ARCS):
    state = pretensioned(rig)
    for i, tension_in in enumerate(tensions):
        state = step(state, route, rig, tension_in=tension_in, time=float(i))
    return state


@pytest.mark.parametrize("name", KINDS)
def test_an_effect_of_size_zero_is_the_base_bit_for_bit(name):
    absent = with_effects(with_size(KINDS[name], 0.0))
    for drive in (FORCE, POSITION):
        assert [m.transmission for m in moments(drive, absent)] == [
            m.transmission for m in moments(drive, RIG)
        ]


@pytest.mark.parametrize("drive", [FORCE, POSITION])
@pytest.mark.parametrize("name", KINDS)
def test_a_simulated_run_is_the_prediction_of_the_march(name, drive):
    rig = with_effects(with_size(KINDS[name]))
    expected, result = predict(RUNS[drive], ARCS, rig, drive=drive), moments(drive, rig)
    read = [m.readings or true(m) for m in result]
    for channel in true(result[0]):
        assert [row[channel] for row in read] == pytest.approx(expected[channel], rel=1e-12, abs=1e-14)
    assert bool(result[0].readings) == sensors_err(rig) == (KINDS[name].hook == "observation")


def true(moment):
    result = moment.transmission
    return {
        "tension_in_N": result.tension_in,
        "tension_out_N": result.tension_out,
        "elongation_m": result.elongation,
        "displacement_in_m": result.displacement_in,
        "displacement_out_m": result.displacement_out,
    }


def test_a_sensor_that_errs_changes_what_is_read_and_not_what_is():
    spoilt = with_effects(with_size(KINDS["tension_out_gain"]))
    for one, other in zip(moments(FORCE, spoilt), moments(FORCE, MARCH), strict=True):
        result = other.transmission
        assert one.transmission == result
        assert one.readings["tension_out_N"] == pytest.approx(1.03 * result.tension_out, rel=1e-12)


def test_a_drive_read_by_a_cell_that_errs_pulls_with_what_is():
    rig = with_effects(TensionInGain(gain_error=0.25))
    (result,) = simulate(TIME[:1], STILL, rig, tension_in=np.array([10.0]))
    assert result.transmission.tension_in == pytest.approx(8.0, rel=1e-15)
    assert result.readings["tension_in_N"] == 10.0


SOME = (
    HiddenBend(at_m=0.2, angle_rad=0.6),
    Creep(ratio=0.06),
    Backlash(width_m=2e-4),
    ChannelLag(lag_s=0.3),
    ThermalDrift(expansion_per_K=1.5e-5),
)


@pytest.mark.parametrize("drive", [FORCE, POSITION])
def test_a_saved_state_goes_on_bit_for_bit(drive):
    rig, route = with_effects(*SOME), swaying()
    whole = moments(drive, rig, route)
    saved = json.dumps(state_object(whole[59].state), allow_nan=False)
    rest = simulate(
        TIME[60:],
        route,
        rig,
        **{DRIVES[drive]: RUNS[drive][drive][60:]},
        temperature=TEMPERATURE[60:],
        state=state_of(json.loads(saved)),
    )
    for one, other in zip(rest, whole[60:], strict=True):
        assert one.transmission == other.transmission
        assert one.readings == other.readings


def test_a_state_saved_before_it_moved_is_discretised_on_its_first_route_again():
    rig = with_effects(*SOME)
    state = driven(rig, (5.0, 12.0))
    revived = state_of(json.loads(json.dumps(state_object(state))))
    assert revived.along.cut is revived.route
    assert transmit(revived, rig) == transmit(state, rig)


def swaying(parts=12, by=0.3):
    """The route with bends that sway, each in its own time."""
    bent = [ARCS.angle * (1.0 + by * np.sin(k + np.arange(4))) for k in range(parts + 1)]
    return MovingRoute(np.linspace(0.0, 24.0, parts + 1), [Arcs.exact(ARCS.length, angle) for angle in bent])


def test_on_a_moving_route_effects_of_no_size_are_the_bars_of_the_base():
    """Other bars and another way through a step: T_out within the error of 60 and 30 bars."""
    for drive in (FORCE, POSITION):
        for one, other in zip(moments(drive, MARCH, swaying()), moments(drive, RIG, swaying()), strict=True):
            assert one.transmission.tension_out == pytest.approx(other.transmission.tension_out, abs=0.02)
            assert one.transmission.displacement_out == pytest.approx(
                other.transmission.displacement_out, abs=7e-6
            )


@pytest.mark.parametrize("name", [n for n in KINDS if n not in (*BY_THEMSELVES, *AT_ONCE)])
def test_the_load_answers_beyond_the_dead_zone_and_not_inside_it(name):
    rig = with_effects(with_size(KINDS[name]))
    for tensions in ((14.0, 8.0), (14.0, 3.0, 5.0)):
        state = driven(rig, tensions)
        result = transmit(state, rig)
        assert result.dead_zone
        for share, answers in ((0.999, False), (1.001, True)):
            further = tensions[-1] + result.direction_index * share * result.dead_zone_width
            moved = transmit(step(state, ARCS, rig, tension_in=further, time=9.0), rig)
            assert moved.dead_zone != answers
            by = RIG.load.stiffness_N_per_m * (moved.displacement_out - result.displacement_out)
            assert (abs(by) > 1e-6) == answers


def test_backlash_is_a_dead_zone_of_a_driven_position():
    rig = with_effects(Backlash(width_m=1e-3))
    pulled = step(pretensioned(rig), ARCS, rig, displacement_in=6e-3)
    eased = step(pulled, ARCS, rig, displacement_in=5.2e-3)
    assert transmit(eased, rig).tension_in == transmit(pulled, rig).tension_in
    assert transmit(eased, rig).direction_index == -1
    assert transmit(eased, rig).dead_zone


def test_the_front_is_where_the_corner_list_has_it():
    for tensions in ((3.0,), (14.0,), (14.0, 9.0), (14.0, 9.0, 9.0)):
        exact, result = (transmit(driven(rig, tensions), rig).slip_front for rig in (RIG, MARCH))
        assert result == pytest.approx(exact, abs=0.25)  # one bar of thirty


@pytest.mark.parametrize("name", KINDS)
def test_the_drive_may_change_between_tension_and_position(name):
    rig = with_effects(with_size(KINDS[name]))
    state = driven(rig, (5.0, 14.0, 9.0))
    for time in (3.0, 5.0):
        position = state.along.displacement_in
        state = step(state, ARCS, rig, displacement_in=position, time=time)
        state = step(state, ARCS, rig, tension_in=state.tension_in, time=time + 1.0)
        # by speed and with creep two seconds more are not nothing; 1 µm is 3 mN
        slack = 2e-4 if name in (*BY_SPEED, "creep") else 1e-9
        assert state.along.displacement_in == pytest.approx(position, abs=slack)
        assert state.tension_in == pytest.approx(9.0, abs=3e3 * slack)


def test_a_hidden_bend_on_a_straight_piece_changes_the_tension_over_its_length():
    straight = Arcs.exact(np.array([0.2, 0.2, 0.1]), np.array([1.0, 0.0, 1.0]))
    rig = changed(Rig(), effects=(HiddenBend(at_m=0.3, angle_rad=1.0),))
    state = driven(rig, (10.0,), straight)
    before, behind, end = tension(state, np.array([1.0, 1.0, 1.5]), np.array([0.25, 0.36, 0.45]))
    assert before == pytest.approx(10.0 * math.exp(-0.145), rel=1e-3)  # bars stand for their mean angle
    assert behind == pytest.approx(10.0 * math.exp(-0.29), rel=1e-3)
    assert end == pytest.approx(10.0 * math.exp(-0.145 * 2.5), rel=1e-3)


def test_the_last_step_sets_how_long_one_at_the_same_time_takes():
    rig = with_effects(ViscousDrag(coefficient_Ns_per_m2=300.0))
    state = step(driven(rig, (5.0,)), ARCS, rig, tension_in=9.0, time=0.5)
    again = step(state, ARCS, rig, tension_in=12.0, time=0.5)
    assert again.along.span == 0.5
    assert transmit(again, rig) == transmit(step(state, ARCS, rig, tension_in=12.0, time=1.0), rig)


def test_a_tendon_goes_on_with_effects_that_come_and_go():
    rig = with_effects(HiddenBend(at_m=0.2, angle_rad=0.6))
    base = driven(RIG, (5.0, 14.0, 9.0))
    held = step(base, ARCS, rig, tension_in=9.0)
    assert held.tension_out == pytest.approx(base.tension_out, rel=1e-9)
    # at the positions of the tensions: δ of 30 bars
    assert transmit(held, rig).elongation == pytest.approx(transmit(base, RIG).elongation, abs=2e-6)
    back = step(held, ARCS, RIG, tension_in=9.0)
    assert back.tension_out == pytest.approx(base.tension_out, rel=1e-9)


def test_a_pretension_that_errs_is_that_of_the_tendon_at_rest():
    rig = with_effects(with_size(KINDS["pretension_error"]))
    assert pretensioned(rig).tension_in == pytest.approx(2.6)
    assert transmit(driven(rig, (2.6,)), rig).displacement_out == 0.0


@pytest.mark.parametrize(
    ("drives", "expected"),
    [
        ({"tension_in": 5.0}, "act over time"),
        ({"tension_in": 5.0, "time": 0.5}, "from 1 to 0.5 s: give increasing"),
        ({"tension_in": -1.0, "time": 2.0}, "only pulls"),
        ({"time": 2.0}, "one drive"),
        ({"tension_in": 5.0, "time": 2.0, "stretches_with_route": True}, "cannot stretch"),
        ({"tension_in": 5.0, "time": 2.0, "temperature": math.nan}, "give a finite one"),
    ],
)
def test_a_step_that_effects_cannot_take_is_refused(drives, expected):
    rig = with_effects(Creep(ratio=0.1))
    with pytest.raises(SettingsError, match=expected):
        step(driven(rig, (3.0, 5.0)), ARCS, rig, **drives)


def test_a_saved_state_goes_on_with_a_sensor_that_lags_since():
    state = driven(with_effects(Creep(ratio=0.1)), (5.0, 8.0))
    saved = state_of(json.loads(json.dumps(state_object(state))))
    rig = with_effects(Creep(ratio=0.1), ChannelLag(lag_s=0.05))
    after = step(saved, ARCS, rig, tension_in=9.0, time=2.0)
    assert readings(after, rig)["tension_out_N"] == after.tension_out  # a sensor begins at its first reading
    again = state_of(json.loads(json.dumps(state_object(after))))
    assert step(again, ARCS, rig, tension_in=9.5, time=3.0).tension_out > after.tension_out


def test_a_stream_reads_what_a_late_recorder_stores_and_goes_on_after_a_restart():
    rig, spans = with_effects(ChannelLag(lag_s=0.25, channel="distal")), 0.1 * np.arange(12)
    pulled = 5.0 + 10.0 * spans * (1.0 - spans / 1.1)
    state, true, read = pretensioned(rig), list[float](), list[float]()
    for time, pull in zip(spans, pulled, strict=True):
        state = step(state, ARCS, rig, tension_in=float(pull), time=float(time))
        true.append(state.tension_out)
        read.append(readings(state, rig)["tension_out_N"])
        state = state_of(json.loads(json.dumps(state_object(state))))
    assert read == pytest.approx(np.interp(spans - 0.25, spans, true), abs=1e-12)
    wrong = state_object(state)
    wrong["along"]["lags"]["tension_out_N"] = [5.0, 5.0, 0.1]
    with pytest.raises(SettingsError, match="lags"):
        state_of(wrong)


def test_the_error_of_a_loose_tendon_is_none():
    rig = changed(RIG, tendon=Tendon(pretension_N=1.5), effects=(VelocityDependentFriction(gain=0.3),))
    result = transmit(step(pretensioned(rig), ARCS, rig, tension_in=0.0, time=0.0), rig)
    assert math.isfinite(result.elongation_se)
    assert result.tension_out_se == 0.0


def test_a_weight_that_runs_away_and_a_drive_that_lags_are_refused():
    weight = Rig(tendon=Tendon(pretension_N=5.0), load=Load(stiffness_N_per_m=0.0))
    hanging = changed(weight, effects=(Creep(ratio=0.1),))
    with pytest.raises(FitError, match="tension_in 50 N"):
        step(pretensioned(hanging), ARCS, hanging, tension_in=50.0, time=0.0)
    with pytest.raises(SettingsError, match="tension_in_N is the drive"):
        next(simulate(TIME, STILL, with_effects(ChannelLag(lag_s=0.1, channel=FORCE)), tension_in=PULLS))
    with pytest.raises(SettingsError, match="the rig lacks"):
        transmit(driven(with_effects(Creep(ratio=0.1)), (5.0,)), RIG)
    with pytest.raises(SettingsError, match="sensors read what"):
        readings(driven(RIG, (5.0,)), RIG)


# --- standard errors ----------------------------------------------------------------------------------------

# Of the exact derivative through the whole run: known is what friction is used, not its history; a constant
# force of friction, which does not shrink with the tension, is passed over.
WITHIN = dict.fromkeys(BY_SPEED, (0.75, 2.3)) | {"creep": (0.75, 1.1), "thermal_drift": (0.7, 1.1)}


@pytest.mark.parametrize("name", KINDS)
def test_standard_errors_are_those_of_the_whole_run_on_other_routes(name):
    rig, k = with_effects(with_size(KINDS[name])), len(ARCS.length)
    spread = np.random.default_rng(0).standard_normal((2 * k, 2 * k))
    root = spread * np.concatenate((np.full(k, 2e-4), np.full(k, 0.02))) / math.sqrt(2 * k)
    rows = [10, 25, 45, 70, 100]  # pulled, held, in a dead zone, in a loop inside of a loop, released
    expected = moments(FORCE, rig, MovingRoute(np.zeros(1), [replace(ARCS, covariance=root.T @ root)]))
    at, variance = moments(FORCE, rig), np.zeros((2, len(rows)))
    for way in root:  # C = Σ way way', each a direction in which the whole run is gone through again
        length, angle = ARCS.length + 1e-3 * way[:k], ARCS.angle + 1e-3 * way[k:]
        moved = moments(FORCE, rig, MovingRoute(np.zeros(1), [Arcs.exact(length, angle)]))
        for row, i in enumerate(rows):
            one, other = moved[i].transmission, at[i].transmission
            variance[0, row] += (1e3 * (one.elongation - other.elongation)) ** 2
            variance[1, row] += (1e3 * (one.tension_out - other.tension_out)) ** 2
    low, high = WITHIN.get(name, (0.8, 1.2))
    for row, i in enumerate(rows):
        result = expected[i].transmission
        assert low < result.elongation_se / math.sqrt(variance[0, row]) < high
        assert low < result.tension_out_se / math.sqrt(variance[1, row]) < high
