"""Each extra effect against what it must do on a rig simple enough to say so."""

import math

import numpy as np
import pytest

from tests.lumped import Distal, Drive, Physics, from_pieces, simulate

PI, RHO, L = math.pi, 3.16e-4, 0.5
HELD, WEIGHT = Distal("blocked"), Distal("weight")
STRAIGHT = from_pieces([L], [0.0], 32)
HALF = from_pieces([L], [PI], 64)
SLOW = 1e-3  # m/s
EXACT_N, EXACT_M = (
    1e-5,
    1e-9,
)  # what the nearly rigid bars at the ends give way under 15 N, and what that holds


def dragged(path, distance=0.02, speed=SLOW, back=0.0, stop=0.0, samples=5, step=0.02, **effects):
    """Drag 5 N along, `distance` to the proximal end and then `back`, then stop; T_in over time."""
    span = distance / speed
    knots = np.cumsum([0.0, span, back / speed, stop])
    drive = Drive(
        "displacement", *_increasing(knots, np.array([0.0, distance, distance - back, distance - back]))
    )
    times = np.linspace(0.0, knots[-1], samples)
    return simulate(path, Physics(pretension_N=5.0, **effects), drive, WEIGHT, times, step).tension_in


def _increasing(knots, values):
    fresh = np.concatenate(([True], np.diff(knots) > 0.0))
    return knots[fresh], values[fresh]


def pulled(path, *tensions, physics=None, distal=HELD, span=1.0, samples=2, step=0.1):
    drive = Drive("force", np.linspace(0.0, span, len(tensions)), np.array(tensions))
    return simulate(path, physics or Physics(), drive, distal, np.linspace(0.0, span, samples), step)


def frictionless(**effects):
    return Physics(friction=0.0, **effects)


def test_effects_of_no_size_leave_every_digit():
    silent = Physics(
        load_reference=3.0,
        load_measure="normal",
        wear_travel_m=1e-3,
        speed_reference_m_per_s=1.0,
        clearance_scale_N=7.0,
        toe_scale_N=0.3,
        take_up_in_scale_N=1.0,
        bend_at_m=0.2,
        creep_ratios=(0.0,),
        creep_times_s=(3.0,),
        speed_lag_s=0.3,
    )
    plain, other = (pulled(HALF, 0.0, 15.0, 5.0, physics=p, samples=20) for p in (Physics(), silent))
    for name in ("tension", "friction", "position", "elongation", "tension_out", "heat"):
        assert np.array_equal(getattr(plain, name), getattr(other, name))


def test_asymmetry_is_more_friction_pulling_and_less_releasing():
    there = dragged(HALF, asymmetry=0.2)[-1], dragged(HALF, friction=0.145 * 1.2)[-1]
    back = dragged(HALF, back=0.01, asymmetry=0.2)[-1], dragged(HALF, back=0.01, friction=0.145 * 0.8)[-1]
    assert there[0] == pytest.approx(there[1], abs=EXACT_N)
    assert back[0] == pytest.approx(back[1], abs=EXACT_N)


def test_curvature_gain_acts_with_the_curvature():
    gain = 0.02
    assert dragged(HALF, curvature_gain_m=gain)[-1] == pytest.approx(
        dragged(HALF, friction=0.145 * (1 + gain * PI / L))[-1], abs=EXACT_N
    )


@pytest.mark.parametrize(("measure", "reference"), [("tension", 10.0), ("normal", 10.0 * 0.2 / L)])
def test_friction_that_depends_on_load_is_the_nominal_one_times_a_power(measure, reference):
    bend = from_pieces([L], [0.2], 16)  # so little that the tension is nearly one
    load = {"load_exponent": -1 / 3, "load_measure": measure, "load_reference": reference}
    loss = dragged(bend, **load)[-1] - 5.0
    nominal = dragged(bend)[-1] - 5.0
    assert loss / nominal == pytest.approx(0.5 ** (-1 / 3), rel=0.01)  # the tension rises by 3 %


def test_a_rough_stretch_counts_by_the_turn_in_it():
    rough = {"profile_s_m": (0.2, 0.2, 0.3, 0.3), "profile": (1.0, 3.0, 3.0, 1.0)}
    path = from_pieces([0.2, 0.1, 0.2], [0.4 * PI, 0.2 * PI, 0.4 * PI], 80)
    more = from_pieces([0.2, 0.1, 0.2], [0.4 * PI, 0.6 * PI, 0.4 * PI], 400)
    assert dragged(path, **rough)[-1] == pytest.approx(dragged(more)[-1], abs=0.005)  # cells differ


def test_friction_wears_with_the_travel_of_each_vertex():
    observed = dragged(HALF, samples=21, wear_gain=0.5, wear_travel_m=1e-3)
    assert observed[1] < observed[5] < observed[-1]
    assert observed[-1] == pytest.approx(dragged(HALF, friction=0.145 * 1.5)[-1], abs=1e-4)  # e^-20 is left


def test_friction_by_speed_takes_the_speed_of_sliding():
    for speed in (SLOW, 10 * SLOW):
        factor = 1 + 0.1 * math.log1p(speed / SLOW)
        observed = dragged(HALF, speed=speed, step=0.01, speed_gain=0.1, speed_reference_m_per_s=SLOW)[-1]
        assert observed == pytest.approx(dragged(HALF, friction=0.145 * factor)[-1], abs=EXACT_N)


def test_friction_that_falls_with_speed_is_stationary_after_its_lag():
    falls = {"stribeck_gain": 0.3, "stribeck_speed_m_per_s": SLOW, "speed_lag_s": 1.0}
    factor = 1 + 0.3 * math.exp(-1.0)
    assert dragged(HALF, **falls)[-1] == pytest.approx(dragged(HALF, friction=0.145 * factor)[-1], abs=1e-4)


def test_straight_friction_is_a_force_per_length():
    assert dragged(STRAIGHT, straight_friction_N_per_m=2.0)[-1] == pytest.approx(5.0 + 2.0 * L, abs=EXACT_N)
    assert dragged(STRAIGHT, back=0.01, straight_friction_N_per_m=2.0)[-1] == pytest.approx(4.0, abs=EXACT_N)


def test_viscous_drag_grows_with_the_speed_and_ends_with_it():
    drag = {"viscous_drag_Ns_per_m2": 300.0}
    assert dragged(STRAIGHT, **drag)[-1] == pytest.approx(5.0 + 300.0 * L * SLOW, abs=EXACT_N)
    assert dragged(STRAIGHT, speed=10 * SLOW, **drag)[-1] == pytest.approx(
        5.0 + 3000.0 * L * SLOW, abs=EXACT_N
    )
    assert dragged(STRAIGHT, stop=5.0, **drag)[-1] == pytest.approx(5.0, abs=EXACT_N)


def test_drag_acts_where_the_tendon_slides_and_nowhere_else():
    physics = Physics(pretension_N=5.0, viscous_drag_Ns_per_m2=300.0)
    run = pulled(HALF, 5.0, 15.0, 12.0, physics=physics, samples=11, step=0.01)
    assert (run.sliding[-1, :10] == -1).all()
    assert (run.sliding[-4:, -20:] == 0).all()
    assert np.ptp(run.tension_out[-4:]) < EXACT_N  # the far end feels nothing of the sliding before it


@pytest.mark.parametrize("fitting", ["fitting_in_N", "fitting_out_N"])
def test_a_fitting_is_a_play_in_tension(fitting):
    physics = frictionless(pretension_N=5.0, **{fitting: 0.5})
    run = pulled(STRAIGHT, 5.0, 15.0, 14.2, 5.0, physics=physics, span=3.0, samples=4)
    assert run.tension_out == pytest.approx([5.0, 14.5, 14.5, 5.5], abs=EXACT_N)


@pytest.mark.parametrize("fitting", ["fitting_in_ratio", "fitting_out_ratio"])
def test_a_fitting_holds_a_share_of_the_tension(fitting):
    run = pulled(STRAIGHT, 5.0, 15.0, physics=frictionless(pretension_N=5.0, **{fitting: 0.1}))
    assert run.tension_out[-1] == pytest.approx(15.0 * 0.95 / 1.05, abs=EXACT_N)


def test_a_hidden_bend_acts_as_a_bend_that_is_there():
    bend = {"bend_at_m": 0.2, "bend_angle_rad": 1.0, "bend_width_m": 0.05}
    there = from_pieces([0.175, 0.05, 0.275], [0.0, 1.0, 0.0], 160)
    hidden = pulled(from_pieces([L], [0.0], 160), 0.0, 15.0, 9.0, 14.0, physics=Physics(**bend), samples=31)
    known = pulled(there, 0.0, 15.0, 9.0, 14.0, samples=31)
    assert hidden.tension_out == pytest.approx(known.tension_out, abs=0.001)
    assert hidden.elongation == pytest.approx(known.elongation, abs=0.1e-6)


def test_a_taut_tendon_saves_path_in_bends():
    physics = frictionless(pretension_N=2.0, clearance_m=2e-4, clearance_scale_N=3.0)
    saved = 2e-4 * PI * (math.exp(-2.0 / 3.0) - math.exp(-5.0))
    assert pulled(HALF, 2.0, 15.0, physics=physics).elongation[-1] == pytest.approx(
        RHO * L * 13.0 + saved, abs=EXACT_M
    )


def test_a_toe_stretches_by_its_strain():
    physics = frictionless(toe_strain=1e-3, toe_scale_N=3.0)
    expected = RHO * L * 15.0 + 1e-3 * L * -math.expm1(-5.0)
    assert pulled(HALF, 0.0, 15.0, physics=physics).elongation[-1] == pytest.approx(expected, abs=EXACT_M)


def test_creep_follows_its_kelvin_voigt_elements_and_rests_under_the_pretension():
    physics = frictionless(pretension_N=5.0, creep_ratios=(0.1, 0.2), creep_times_s=(1.0, 10.0))
    drive = Drive("force", np.array([0.0, 1e-6, 20.0]), np.array([5.0, 15.0, 15.0]))
    run = simulate(STRAIGHT, physics, drive, HELD, [1e-6, 3.0, 20.0], 0.1)
    grown = [1 + sum(r * -math.expm1(-t / s) for r, s in ((0.1, 1.0), (0.2, 10.0))) for t in run.times]
    assert run.elongation == pytest.approx(RHO * L * 10.0 * np.array(grown), abs=1e-9)  # 1e-6 s of ramp
    still = simulate(
        STRAIGHT, physics, Drive("force", np.array([0.0, 20.0]), np.full(2, 5.0)), HELD, [20.0], 0.1
    )
    assert still.elongation[0] == pytest.approx(0.0, abs=1e-14)


def test_creep_under_a_ramp_is_exact_whatever_the_step():
    physics = frictionless(pretension_N=5.0, creep_ratios=(0.3,), creep_times_s=(2.0,))
    ramp = Drive("force", np.array([0.0, 6.0]), np.array([5.0, 17.0]))
    late = 6.0 + 2.0 * math.expm1(-3.0)  # the ramp less what its lag of 2 s holds back [s]
    for step in (1.5, 0.1):
        run = simulate(STRAIGHT, physics, ramp, HELD, [0.0, 6.0], step)
        assert run.elongation[-1] == pytest.approx(RHO * L * 2.0 * (6.0 + 0.3 * late), abs=EXACT_M)


def test_warmth_slackens_a_held_tendon():
    warmer = Drive("displacement", np.array([0.0, 10.0]), np.zeros(2), np.array([20.0, 30.0]))
    physics = Physics(pretension_N=5.0, expansion_per_K=1e-5)
    run = simulate(HALF, physics, warmer, HELD, [0.0, 10.0], 0.1)
    assert run.tension[-1] == pytest.approx(np.full(65, 5.0 - 1e-4 / RHO), abs=EXACT_N)
    assert run.temperature == pytest.approx([20.0, 30.0], abs=1e-12)


@pytest.mark.parametrize("end", ["in", "out"])
def test_compliance_outside_the_sheath_adds_to_the_elongation(end):
    physics = frictionless(pretension_N=2.0, **{f"series_{end}_m_per_N": 5e-5, f"take_up_{end}_m": 1e-3})
    slack = 1e-3 * (math.exp(-1.0) - math.exp(-7.5))
    expected = RHO * L * 13.0 + 5e-5 * 13.0 + slack
    for distal in (HELD, Distal("spring", 3000.0)):
        run = pulled(HALF, 2.0, 15.0, physics=physics, distal=distal)
        assert run.elongation[-1] == pytest.approx(expected, abs=EXACT_M)
    back = Drive("displacement", np.array([0.0, 1.0]), np.array([0.0, expected]))
    assert simulate(HALF, physics, back, HELD, [1.0], 0.1).tension_in[0] == pytest.approx(15.0, abs=1e-4)


def test_backlash_loses_motion_on_the_way_back_and_again_on_the_way_there():
    drive = Drive("displacement", np.linspace(0.0, 4.0, 5), np.array([0.0, 2.0, 1.6, 1.0, 1.3]) * 1e-3)
    physics = frictionless(pretension_N=2.0, backlash_m=5e-4)
    run = simulate(STRAIGHT, physics, drive, HELD, drive.times, 0.1)
    passed = np.array([0.0, 2.0, 2.0, 1.5, 1.5]) * 1e-3
    assert run.tension_in == pytest.approx(2.0 + passed / (RHO * L), abs=1e-4)
    forced = pulled(STRAIGHT, 2.0, 15.0, 8.0, physics=physics, samples=3)
    assert forced.elongation == pytest.approx(
        RHO * L * np.array([0.0, 13.0, 6.0]) - np.array([0.0, 0.0, 5e-4]), abs=EXACT_M
    )
