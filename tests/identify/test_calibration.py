"""Calibration identifies the model's numbers, and states which of them a run does not determine."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tssgeom.errors import SettingsError
from tssgeom.identify.calibration import calibrate
from tssgeom.identify.fit_quality import ChannelFit
from tssgeom.identify.turning import legs
from tssgeom.rig import Friction, Rig, ShapeSensor, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.history import driven
from tssgeom.tendon.simulation import Measured

HALF = Arcs.exact(np.array([0.5]), np.array([math.pi]))
MU, RHO, SLACK, OFFSET = 0.19, 4.1e-4, 1.69e-3, 0.3
TRUTH = Rig(friction=Friction(coefficient=MU), tendon=Tendon(compliance_per_N=RHO))
TIME = np.linspace(0.0, 20.0, 301)
TENSION = 15.0 * (1.0 - np.abs(TIME / 10.0 - 1.0)) + 0.05


def run_of(noise=0.0, seed=1, tension=TENSION, **left_out):
    """Pull and release of the paper: its slack is taken up below 4 N."""
    rng = np.random.default_rng(seed)
    ends = driven(tension, HALF, TRUTH)
    slack = SLACK * -np.expm1(-((tension / 2.0) ** 2))  # another law than the one that is fitted
    columns = {
        "tension_in": tension + noise * rng.standard_normal(len(tension)),
        "tension_out": ends.tension_out + OFFSET + noise * rng.standard_normal(len(tension)),
        "elongation": ends.elongation + slack + 2e-4 * noise * rng.standard_normal(len(tension)),
    }
    return Measured(TIME[: len(tension)], **{name: columns[name] for name in columns if name not in left_out})


def test_exact_readings_give_back_friction_compliance_and_zeros():
    result = calibrate(run_of(), HALF, Rig()).estimates
    # What is left of the slack above 4 N, 31 µm, is met by another law: to some 1e-4 of what is fitted.
    assert result["friction"].value == pytest.approx(MU, rel=1e-4)
    assert result["compliance"].value == pytest.approx(RHO, rel=2e-3)
    assert result["tension_out_offset"].value == pytest.approx(OFFSET, abs=1e-3)
    assert result["elongation_offset"].value == pytest.approx(SLACK, abs=5e-6)


def test_noisy_readings_are_met_within_the_intervals():
    result = calibrate(run_of(noise=0.03), HALF, Rig()).estimates
    truth = {"friction": MU, "compliance": RHO, "tension_out_offset": OFFSET, "elongation_offset": SLACK}
    for name, value in truth.items():
        reported = result[name]
        reach = reported.high - reported.value
        assert reported.observable
        assert abs(reported.value - value) < 1.5 * reach, name  # 3 standard errors: one draw
        assert reach < 0.02 * abs(value) + 0.02 * (name == "tension_out_offset"), name


def test_a_zero_as_large_as_the_readings_is_fitted():
    run, zero = run_of(noise=0.03), 0.05  # some twenty times the stretch
    off = Measured(run.time, run.tension_in, None, run.tension_out, run.elongation + zero)
    result, other = calibrate(off, HALF, Rig()), calibrate(run, HALF, Rig())
    assert result.failures == ()
    assert result.estimates["elongation_offset"].value == pytest.approx(SLACK + zero, abs=5e-5)
    mu, rho = (result.estimates[name].value for name in ("friction", "compliance"))
    assert mu == pytest.approx(other.estimates["friction"].value, rel=1e-4)
    assert rho == pytest.approx(other.estimates["compliance"].value, rel=1e-4)


def test_an_uncertain_angle_widens_the_interval_of_the_friction_as_much():
    """Friction and a gain of all angles are tied: only μΦ is identifiable."""
    sure = calibrate(run_of(noise=0.03), HALF, Rig()).estimates["friction"]
    rig = Rig(shape=ShapeSensor(angle_gain_sd=0.05))
    unsure = calibrate(run_of(noise=0.03), HALF, rig).estimates["friction"]
    assert unsure.value == pytest.approx(sure.value, rel=1e-6)
    half = 0.5 * math.log(unsure.high / unsure.low)
    assert half == pytest.approx(1.97 * 0.05, rel=0.05)  # Student's quantile of some hundred readings
    assert math.log(sure.high / sure.low) < 0.2 * half


def test_a_run_without_distal_tension_identifies_friction_and_no_zero_of_its_sensor():
    result = calibrate(run_of(noise=0.03, tension_out=None), HALF, Rig())
    assert result.estimates["friction"].value == pytest.approx(MU, rel=0.03)
    assert not result.estimates["tension_out_offset"].observable
    assert any("no tension_out_N" in warning for warning in result.warnings)


def test_a_run_without_elongation_keeps_the_compliance_of_the_rig():
    result = calibrate(run_of(noise=0.03, elongation=None), HALF, Rig())
    assert not result.estimates["compliance"].observable
    applied = result.applied(Rig())
    assert applied.tendon.compliance_per_N == Rig().tendon.compliance_per_N
    assert applied.friction.coefficient == pytest.approx(MU, rel=0.03)


def test_far_off_readings_hardly_count():
    run = run_of(noise=0.03)
    out = np.array(run.tension_out)
    out[::40] += 5.0
    result = calibrate(Measured(run.time, run.tension_in, None, out, run.elongation), HALF, Rig())
    assert result.estimates["friction"].value == pytest.approx(MU, rel=0.02)


@pytest.mark.parametrize(("over_noise", "warned"), [(2.2, False), (3.0, True)])
def test_lasting_residuals_lack_an_effect_beyond_what_sound_runs_leave(over_noise, warned):
    met = ChannelFit("tension_out", "N", over_noise * 0.03, 300, 300.0, 0.03, 15.0, whiteness_p=0.0)
    assert met.lacks_an_effect == warned
    assert met.passes
    assert not replace(met, whiteness_p=1.0).lacks_an_effect


def test_residuals_of_a_few_times_the_noise_are_warned_of():
    run = run_of(noise=0.03)
    wavy = run.tension_out + 0.18 * np.sin(2.0 * math.pi * TIME / 3.0)
    result = calibrate(Measured(run.time, run.tension_in, None, wavy, run.elongation), HALF, Rig())
    met = next(each for each in result.channels if each.name == "tension_out")
    assert 3.0 < met.over_noise < 5.0
    assert any("tension_out is met within" in warning for warning in result.warnings)
    assert not any("is met within" in warning for warning in calibrate(run, HALF, Rig()).warnings)


def test_a_pull_alone_is_warned_of():
    result = calibrate(run_of(noise=0.03, tension=TENSION[:150]), HALF, Rig())
    assert any("never turns back" in warning for warning in result.warnings)


def test_a_straight_route_is_refused():
    with pytest.raises(SettingsError, match="shows no friction"):
        calibrate(run_of(), Arcs.exact(np.array([0.5]), np.array([0.01])), Rig())


def test_a_run_without_drive_or_response_is_refused():
    with pytest.raises(SettingsError, match="no drive"):
        calibrate(Measured(TIME, None, None, TENSION), HALF, Rig())
    with pytest.raises(SettingsError, match="no response"):
        calibrate(Measured(TIME, TENSION), HALF, Rig())


def test_the_drive_between_turns_is_monotone_and_its_peak_is_not_that_of_the_noise():
    peaks = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        observed = legs(TENSION + 0.1 * rng.standard_normal(len(TENSION)), TIME)
        assert len(observed.turns) == 1
        assert np.all(np.diff(observed.values[: observed.turns[0]]) >= 0)
        assert np.all(np.diff(observed.values[observed.turns[0] :]) <= 0)
        peaks.append(observed.turn_values[0] - TENSION.max())
    # The largest raw reading is some 0.1 N too high; the error of the line is about half of the noise.
    assert abs(np.mean(peaks)) < 3 * 0.05 / math.sqrt(20) + 0.02


def test_a_turn_lies_where_its_flatter_side_ends():
    position = np.arange(120.0)
    drive = np.where(position < 90.4, 5.0 + 0.02 * position, 5.0 + 0.02 * 90.4 - 0.5 * (position - 90.4))
    (result,) = legs(drive, position).turn_values
    # the flatter side is off by what it rises in a part of a step; the other by some 0.2 N
    assert result == pytest.approx(5.0 + 0.02 * 90.4, abs=0.02)


def test_the_paper_s_rig_is_identified_from_a_rig_with_twice_its_values():
    """Section III-B: μ = 0.145, ρ = 3.16e-4 /N, and 1.69 mm of elongation beyond the model above 4 N."""
    tension, rng = TENSION, np.random.default_rng(5)
    ends = driven(tension, HALF, Rig())
    slack = 1.69e-3 * np.minimum(tension / 4.0, 1.0)  # not linear below 4 N, constant above
    run = Measured(
        TIME,
        tension + 0.02 * rng.standard_normal(len(TIME)),
        None,
        ends.tension_out + 0.02 * rng.standard_normal(len(TIME)),
        ends.elongation + slack + 5e-6 * rng.standard_normal(len(TIME)),
    )
    off = Rig(friction=Friction(coefficient=0.29), tendon=Tendon(compliance_per_N=1.6e-4))
    result = calibrate(run, HALF, off).estimates
    for name, value in (("friction", 0.145), ("compliance", 3.16e-4), ("elongation_offset", 1.69e-3)):
        reach = result[name].high - result[name].value
        assert abs(result[name].value - value) < 1.5 * reach, name  # 3 standard errors: one draw
        assert reach < 0.02 * value, name
