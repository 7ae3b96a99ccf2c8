"""The shape of a drive about its turns, and what a run without any fault leaves of it."""

import numpy as np
import pytest

from tests.bristle.waves import course
from tssgeom.identify.campaign import Campaign, Route, Run
from tssgeom.identify.drive import calmed
from tssgeom.identify.fit import base_fit
from tssgeom.identify.readings import readings
from tssgeom.identify.turn_shapes import fitted_turn
from tssgeom.rig import Friction, Load, Rig, Sensor, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import begin, carry_on, prepare

NOISE = 2e-6  # of an encoder [m]
FINER = 8  # steps of a drive from sample to sample


def errors_about(true: np.ndarray, turn: int, trials: int = 60) -> np.ndarray:
    """Return errors of a calmed drive at five samples about a turn, over the noise [trials, 5]."""
    rng = np.random.default_rng(3)
    drives = true + NOISE * rng.standard_normal((trials, len(true)))
    near = slice(max(turn - 2, 0), turn + 3)
    return np.array([calmed(drive, NOISE)[near] - true[near] for drive in drives]) / NOISE


def test_a_round_turn_of_few_samples_is_no_hold():
    sample = np.arange(41.0)
    true = 3e-3 - 4e-6 * np.abs(sample - 20.3) ** 2  # steps of 4 to 160 µm, five of them below 6 sigma
    assert np.sqrt(np.mean(errors_about(true, 20) ** 2)) < 1.0  # each reading alone has 1


def test_the_first_sample_of_a_steep_leg_is_no_part_of_the_rest():
    sample = np.arange(40.0)
    true = 22e-6 * np.maximum(sample - 9.6, 0.0)  # 4.4 sigma in the first sample after the rest
    errors = errors_about(true, 10)
    assert abs(np.mean(errors[:, 2])) < 0.5  # 60 trials: three standard errors of 0.15


def test_a_long_hold_between_steep_legs_is_level_at_its_mean():
    true = np.interp(np.arange(100.0), [0, 20, 60, 99], [0.0, 3e-3, 3e-3, 0.0])
    rng = np.random.default_rng(5)
    for _ in range(20):
        calm = calmed(true + NOISE * rng.standard_normal(100), NOISE)
        held = calm[22:59]
        assert np.ptp(held) < 1e-12
        assert abs(held[0] - 3e-3) < 4.0 * NOISE / np.sqrt(len(held))  # four standard errors


def test_one_side_of_a_turn_may_have_too_few_samples_for_a_slope():
    sample = np.arange(30.0)
    true = np.where(sample < 9, 1e-3, 3e-6 * np.maximum(sample - 9.0, 0.0) ** 2)
    shape = fitted_turn(sample, true, 9, (0, 29), NOISE)
    assert shape is not None
    start, values = shape
    assert start == 9
    np.testing.assert_allclose(values, true[9 : 9 + len(values)], atol=0.1 * NOISE)  # positions of the ends


@pytest.mark.parametrize("powers", [(1, 1), (2, 2), (1, 2)])
def test_a_rest_between_two_sides_is_fitted_with_both(powers):
    sample = np.arange(45.0)
    sides = (np.maximum(20.4 - sample, 0.0), np.maximum(sample - 25.7, 0.0))
    shapes_of = {1: lambda side: 20e-6 * side, 2: lambda side: 4e-6 * side**2}
    true = shapes_of[powers[0]](sides[0]) + shapes_of[powers[1]](sides[1])
    rng = np.random.default_rng(12)
    drives = true + NOISE * rng.standard_normal((20, 45))
    shapes = [shape for drive in drives if (shape := fitted_turn(sample, drive, 22, (0, 44), NOISE))]
    assert len(shapes) > 17  # few are refused by chance
    errors = [np.mean((values - true[start : start + len(values)]) ** 2) for start, values in shapes]
    assert np.sqrt(np.mean(errors)) < NOISE  # that of each reading alone


@pytest.mark.parametrize("backwards", [False, True])
def test_a_rest_at_an_end_of_a_run_follows_none_of_its_noise(backwards):
    sample = np.arange(60.0)
    true = 5e-6 * np.maximum(sample - 30.0, 0.0) ** 2
    rng = np.random.default_rng(8)
    drives = true + NOISE * rng.standard_normal((40, 60))
    shapes = [
        fitted_turn(sample, drive[:: -1 if backwards else 1], 59 if backwards else 0, (0, 59), NOISE)
        for drive in drives
    ]
    rests = [shape[1][::-1][:28] if backwards else shape[1][:28] for shape in shapes if shape is not None]
    assert len(rests) > 30  # of 40: few are refused by chance
    assert np.mean([np.ptp(rest) == 0.0 for rest in rests]) > 0.9  # two numbers more cost 7 in evidence


def test_readings_that_no_shape_meets_have_none():
    sample = np.arange(30.0)
    saw = 50e-6 * (sample % 2) * (sample > 5)
    assert fitted_turn(sample, saw, 3, (0, 29), NOISE) is None


RIG = Rig(
    tendon=Tendon(compliance_per_N=3e-4, pretension_N=6.0),
    friction=Friction(coefficient=0.14),
    load=Load(stiffness_N_per_m=900.0),
    sensors={
        "displacement_in_m": Sensor(noise=NOISE, resolution=5e-7, full_scale=0.05),
        "tension_in_N": Sensor(noise=0.02, resolution=0.005, full_scale=40.0, nonlinearity=2e-4),
    },
)


def clean_run(kind: str, seed: int) -> Campaign:
    """Return a run of the model itself, driven by a course that turns between its samples."""
    rng = np.random.default_rng(seed)
    moved = course(kind, rng, FINER * 280 + 1)
    drive = 3e-3 * np.concatenate((np.zeros(FINER * 20), moved - moved[0]))
    time = np.linspace(0.0, 10.0, len(drive))
    arcs = Arcs.exact(np.full(3, 0.5 / 3), rng.uniform(0.5, 1.5, 3))
    fine = {"time_s": time, "displacement_in_m": drive, "tension_in_N": 0.0 * time}
    model = prepare(fine, arcs, RIG, drive="displacement_in_m", bars=240)
    tension = carry_on(model, begin(model), fine)[0].channels["tension_in_N"]
    columns = {"time_s": time[::FINER]}
    for name, values in (("displacement_in_m", drive), ("tension_in_N", tension)):
        sensor = RIG.sensors[name]
        noisy = values[::FINER] + sensor.noise * rng.standard_normal(len(values[::FINER]))
        columns[name] = np.round(noisy / sensor.resolution) * sensor.resolution
    route = Route("route", arcs, np.zeros((2, 3)), np.array([0.0, 0.5]))
    return Campaign("clean", RIG, (Run("run", route, columns),), held_out_fixed=True)


@pytest.mark.parametrize("kind", ["sinus", "chirp", "trapezoid"])
def test_noise_of_the_drive_leaves_no_more_of_the_tension_than_its_error_model_holds(kind):
    for seed in range(4):
        campaign = clean_run(kind, seed)
        problem, _, fit = base_fit(readings(campaign)[0], campaign.rig)
        assert fit.chi2 / problem.stack.size < 1.3  # 280 readings: three standard errors of 0.085
