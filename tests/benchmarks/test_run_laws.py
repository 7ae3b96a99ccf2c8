"""Laws that a user would fit to a run: they recover what made synthetic runs, and their intervals hold it."""

import math

import numpy as np
import pytest

from benchmarks.real import fit
from benchmarks.run_laws import LAWS, Case, Response, bouc_wen, dead_zone, mean_cycle_error, play, stop

TIME = np.arange(0.0, 6.0, 0.01)
DRIVE = 0.02 * np.sin(2.0 * np.pi * TIME / 2.0)  # m; three cycles


def _case(response, *, resists=False, zeroed=False, noise=0.0, column="response_N"):
    rng = np.random.default_rng(3)
    columns = {"time_s": TIME, "drive_m": DRIVE, column: response + noise * rng.standard_normal(len(TIME))}
    fitted = TIME < 4.0
    one = Response(column, "drive_m", resists=resists, zeroed=zeroed)
    return Case("made", "made", columns, np.zeros(len(TIME), int), fitted, ~fitted, (one,), period=2.0)


def _fitted(name, case):
    result = fit(LAWS[name], case, case.responses[0])
    errors = (result.values - case.columns[case.responses[0].column])[case.held_out]
    return {each.name: each for each in result.parameters}, float(np.sqrt(np.mean(errors**2)))


def test_a_play_keeps_to_its_width_and_a_stop_is_the_rest():
    drive = np.array([0.0, 1.0, 3.0, 2.5, 2.0, 0.0])
    assert play(drive, 1.0) == pytest.approx([0.0, 0.0, 2.0, 2.0, 2.0, 1.0])
    assert stop(drive, 1.0) == pytest.approx([0.0, 1.0, 1.0, 0.5, 0.0, -1.0])
    assert dead_zone(np.array([-3.0, 0.5, 2.0]), 1.0) == pytest.approx([-2.0, 0.0, 1.0])


def test_bouc_wen_with_n_of_one_approaches_its_bound_exponentially():
    drive = np.linspace(0.0, 3.0, 3001)
    assert bouc_wen(drive, 1.0, 0.5, 1.0) == pytest.approx(1.0 - np.exp(-drive), abs=1e-3)  # Euler, step 1e-3


def test_the_play_is_recovered_within_its_interval():
    case = _case(1.5 * play(DRIVE, 0.003) + 0.4, noise=2e-4)
    values, error = _fitted("play", case)
    for name, true in (("w", 0.003), ("gain", 1.5)):
        assert values[name].half_width < 0.1 * true
        assert abs(values[name].value - true) < 2.0 * values[name].half_width
    assert error == pytest.approx(2e-4, rel=0.1)  # 200 rows: 5 %


def test_prandtl_ishlinskii_recovers_a_play_of_one_of_its_widths():
    case = _case(-1.5 * play(DRIVE, 0.25 * 0.02) + 0.4)
    values, error = _fitted("Prandtl–Ishlinskii", case)
    gains = [values[f"p{k}"].value for k in range(1, 7)]  # widths from 1/2 to 1/32 of the half range, 0
    assert gains == pytest.approx([0.0, -1.5, 0.0, 0.0, 0.0, 0.0], abs=1e-6)
    assert error < 1e-9


def test_the_stop_recovers_stiffness_and_force():
    case = _case(2e5 * stop(DRIVE, 0.002), resists=True, zeroed=True, noise=4.0)
    values, error = _fitted("stop", case)
    assert values["stiffness"].value == pytest.approx(2e5, abs=2.0 * values["stiffness"].half_width)
    assert values["force"].value == pytest.approx(400.0, abs=2.0 * values["force"].half_width)
    assert values["force"].half_width < 4.0
    assert error == pytest.approx(4.0, rel=0.1)


def test_backlash_before_the_stop_is_recovered_and_the_stop_alone_is_worse():
    response = 5e5 * dead_zone(stop(DRIVE, 0.003), 0.002)  # slides 0.001 m beyond the clearance
    case = _case(response, resists=True, zeroed=True, noise=4.0)
    values, error = _fitted("stop + backlash", case)
    for name, true in (("clearance", 0.002), ("stiffness", 5e5), ("force", 500.0)):
        assert values[name].value == pytest.approx(true, rel=0.02)
    assert error < 0.2 * _fitted("stop", case)[1]


def test_the_ratio_of_pulling_over_releasing_is_the_capstans():
    lagging = play(DRIVE, 0.002)
    tension = (20.0 + 300.0 * lagging) * np.exp(0.4 * (DRIVE - lagging) / 0.002)
    values, error = _fitted("play + capstan", _case(tension, resists=True))
    assert values["exponent"].value == pytest.approx(0.4, abs=1e-3)
    assert values["w"].value == pytest.approx(0.002, rel=1e-3)
    assert error < 0.02


def test_bouc_wen_fits_its_own_runs():
    response = 3e3 * DRIVE + 40.0 * bouc_wen(DRIVE / 0.02, 0.1, 0.5, 1.0)
    values, error = _fitted("Bouc–Wen", _case(response))
    assert error < 0.4  # 1 % of the hysteretic part
    assert values["yield"].value == pytest.approx(0.002, rel=0.05)


def test_the_lag_of_a_drive_that_is_read_late_is_recovered():
    true = 0.02 * np.sin(2.0 * np.pi * (TIME + 0.15) / 2.0)
    case = _case(50.0 * (play(true, 0.001) - true[0]), zeroed=True, column="bending_angle_rad")
    values, _ = _fitted("play, later", case)
    assert values["lag"].value == pytest.approx(0.15, abs=0.01)


def test_no_law_is_fitted_to_fewer_rows_than_parameters():
    case = _case(1.5 * DRIVE)
    few = Case("made", "few", case.columns, case.run, TIME < 0.05, TIME > 1.0, case.responses)
    assert fit(LAWS["Prandtl–Ishlinskii"], few, few.responses[0]) is None


def test_a_repeating_response_has_no_cycle_error_and_a_drift_has_its_own():
    assert mean_cycle_error(_case(DRIVE), "response_N") < 1e-9
    drifting = mean_cycle_error(_case(0.1 * TIME), "response_N")
    assert drifting == pytest.approx(0.3, rel=0.01)  # 2 s after the second cycle, 4 s after the first
    one_run = _case(DRIVE)
    assert math.isnan(mean_cycle_error(Case(**_without_period(one_run)), "response_N"))


def _without_period(case):
    names = ("source", "name", "columns", "run", "fitted", "held_out", "responses", "known")
    return {name: getattr(case, name) for name in names}
