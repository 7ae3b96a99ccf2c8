"""The referee against its own refinement."""

import math

import numpy as np
import pytest

from tests.lumped import Distal, Drive, Joint, Motor, Physics, from_pieces, simulate, simulate_machine

PI = math.pi
TIMES = np.linspace(0.0, 10.0, 41)
STROKES = Drive(
    "displacement", np.linspace(0.0, 10.0, 401), 2e-3 * np.sin(0.9 * np.linspace(0.0, 10.0, 401)) ** 2
)
PHYSICS = Physics(pretension_N=3.0)
SPRING = Distal("spring", 5000.0)


def moving(cells):
    times = np.linspace(0.0, 10.0, 41)
    angles = [1.5 + 0 * times, 1.0 + np.sin(times), 1.0 + np.cos(2 * times), 0.5 + 0.5 * np.sin(3 * times)]
    lengths = 0.125 * (1.0 + 5e-4 * np.sin(times))
    return from_pieces(np.repeat(lengths[:, None], 4, axis=1), np.stack(angles, axis=1), cells, times)


def static(cells):
    return from_pieces([0.1, 0.3, 0.1], [0.5, PI, 0.0], cells)


def run(path, max_step=0.025):
    return simulate(path, PHYSICS, STROKES, SPRING, TIMES, max_step)


def errors(runs, size=lambda d: np.abs(d).max()):
    """Greatest differences of T_in [N], T_out [N] and distal displacement [m] from the last of the runs."""
    best = runs[-1]
    names = ("tension_in", "tension_out", "displacement_out")
    return np.array([[size(getattr(r, n) - getattr(best, n)) for n in names] for r in runs[:-1]])


def rms(difference):
    return np.sqrt(np.mean(difference**2))


@pytest.mark.parametrize("path", [static, moving])
def test_error_falls_with_the_square_of_the_cell(path):
    runs = [run(path(cells)) for cells in (20, 40, 80, 160, 480)]
    # Second order gives 16 between the first and the third. The proximal tension has less: as the drive
    # turns back, before the front has passed the first vertex, its order is one, which alone would give 4.
    mean = errors(runs, rms)
    assert np.all(mean[0] / mean[2] > [6.0, 12.0, 12.0])
    assert np.all(errors(runs)[3] < [0.01, 0.01, 1e-6])  # the promise, at 160 cells and every instant
    assert np.all(mean[2] < [0.01, 0.001, 2e-7])


def test_error_of_a_moving_path_falls_with_the_step_in_time():
    observed = errors([run(moving(40), step) for step in (0.025, 0.0125, 0.00625, 0.0015625)])
    assert np.all(
        observed[0] / observed[2] > 3.0
    )  # 4 for first order, 5 against a reference that is not infinitely fine
    assert np.all(observed[1] < [0.01, 0.01, 1e-6])


def test_steps_in_time_change_nothing_on_a_static_path():
    observed = errors([run(static(40), step) for step in (0.025, 0.005)])
    assert np.all(observed < [1e-6, 1e-6, 1e-10])  # no more than rounding: strokes are monotone between knots


def test_extrapolated_elongation_of_the_half_circle_is_1_90362_mm():
    drive = Drive("force", np.array([0.0, 1.0]), np.array([0.0, 15.0]))
    fine, coarse = (
        simulate(from_pieces([0.5], [PI], n), Physics(), drive, Distal("blocked"), [1.0], 0.5).elongation[0]
        for n in (128, 64)
    )
    # 1.903617 mm = ρ L T (1 − r)/ln(1/r) with r = 0.634111, the paper's ratio; Richardson leaves h⁴
    assert fine + (fine - coarse) / 3.0 == pytest.approx(1.903617e-3, abs=2e-9)


def pair(drive, max_step, load=None):
    tendons = [(from_pieces([0.5], [PI], 60), PHYSICS), (from_pieces([0.6], [1.5], 60), PHYSICS)]
    run = simulate_machine(tendons, drive, Joint(0.01, 0.2, load=load), TIMES, max_step)
    return np.concatenate([[run.joint_angle * 10.0], *([t.tension_in, t.tension_out] for t in run.tendons)])


def test_steps_in_time_change_nothing_where_one_motor_drives_a_machine():
    motor = Motor("angle", STROKES.times, 200.0 * STROKES.values, 0.01)
    assert pair(motor, 0.025) == pytest.approx(pair(motor, 0.005), abs=1e-6)


def test_error_of_a_machine_with_two_drives_and_a_load_falls_with_the_step_in_time():
    knots = np.linspace(0.0, 10.0, 11)
    first, second, torque = np.random.default_rng(5).uniform(-1.0, 1.0, (3, 11))
    drives = [Drive("displacement", knots, 3e-3 * first), Drive("force", knots, 10.0 + 7.0 * second)]
    best, *runs = [pair(drives, step, (knots, 0.05 * torque)) for step in (0.0025, 0.08, 0.04, 0.02)]
    coarse, middle, fine = (np.abs(each - best).max() for each in runs)
    assert coarse > 1.5 * middle  # twice for first order
    assert middle > 1.5 * fine
    assert fine < 0.05  # N, and 5 mrad
