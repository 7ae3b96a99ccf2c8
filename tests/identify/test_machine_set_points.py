"""Motors that go straight from set point to set point, and motors that turn between two readings."""

from functools import cache

import numpy as np
import pytest

from tests.identify.test_machine_routes import PAIR
from tssgeom.identify.machine_discovery import machine_work
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_run import machine_run
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine

ROUTE = Arcs.exact(np.array([0.5]), np.array([3.0]))
NOISE = {"motor_angle_rad": 1e-5, "joint_angle_rad": 1e-4, "tension_in_1_N": 0.02, "tension_in_2_N": 0.02}
FINE, CYCLES = 10, 5
"""Samples of the simulation for each reading, and cycles of a run."""


def set_points():
    """Return a way up, one set point more there, and a slower way down [rad], at readings."""
    up, down = np.linspace(-0.3, 0.3, 14), np.linspace(0.3, -0.3, 32)
    return np.tile(np.concatenate((up, down)), CYCLES)


def run_of(name, seed, *, straight):
    points, rng = set_points(), np.random.default_rng(seed)
    read = np.arange(len(points), dtype=float)
    fine = np.arange((len(points) - 1) * FINE + 1) / FINE
    if straight:
        motor = np.interp(fine, read, points)
    else:  # at the same speeds, between two readings
        period, up = len(points) / CYCLES, 14.0
        phase = (fine + 0.4) % period
        motor = np.where(phase < up, phase / up, (period - phase) / (period - up)) * 0.6 - 0.3
    given = {"time_s": 0.05 * fine, "motor_angle_rad": motor}
    true = given | simulate_machine(machine_of(PAIR, [ROUTE], 40), given)
    columns = {"time_s": 0.05 * read}
    for channel, noise in NOISE.items():
        columns[channel] = true[channel][::FINE] + rng.normal(0.0, noise, len(read))
    return machine_run(name, columns, [ROUTE], PAIR)


@cache
def work_of(straight):
    runs = tuple(run_of(f"run{k}", k, straight=straight) for k in range(3))
    return machine_work(MachineCampaign("bench", PAIR, (), runs, ("run2",)))


@pytest.mark.parametrize("straight", [True, False])
def test_it_is_estimated_whether_a_motor_goes_straight_between_its_readings(straight):
    work, notes = work_of(straight)
    assert any("straight from reading to reading" in note for note in notes) is straight
    assert work.chosen.model.parts == ()
    assert work.zeros == ()
    for name, rms in (*work.base.fitted.items(), *work.base.held.items()):
        assert rms < 1.3 * NOISE[name]


def test_a_straight_motor_turns_at_its_outermost_readings():
    run = run_of("run", 0, straight=True)
    assert run.legs is not None
    made = run.legs.straight()
    assert np.abs(np.abs(made.turn_values) - 0.3).max() < 5e-5
    assert np.abs(np.abs(run.legs.turn_values) - 0.3).max() > 5e-3
    assert run.legs.differs_from(made)
    assert not made.differs_from(made.straight())
