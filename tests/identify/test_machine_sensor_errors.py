"""Sensors of a machine that are bent within what is specified: no effect stands for that."""

from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests.identify.test_machine_routes import MOTOR, PAIR, TIME
from tssgeom.identify.machine_discovery import machine_work
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_run import machine_run
from tssgeom.identify.machine_sensor_errors import without_sensor_errors
from tssgeom.identify.prediction import sensor_bends
from tssgeom.identify.screening import stated_error
from tssgeom.rig import Sensor
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine

NOISE = {"joint_angle_rad": 1e-4, "tension_in_1_N": 0.02, "tension_in_2_N": 0.02}
CELLS = ("tension_in_1_N", "tension_in_2_N")
BENT = Sensor(noise=0.02, full_scale=40.0, nonlinearity=6e-3)
ROUTE = Arcs.exact(np.array([0.5]), np.array([3.0]))
SIZE = {"tension_in_1_N": np.array([1.0, 0.5, -1.0, 1.0]), "tension_in_2_N": np.array([-1.0, 1.0, 0.0, 1.0])}
"""Errors of the cells, in standard deviations of the waves."""


def rig(sensor):
    return changed(PAIR, sensors=dict.fromkeys(CELLS, sensor))


def run_of(name, rng, hardware, zero=0.0):
    out = simulate_machine(machine_of(PAIR, [ROUTE], 40), {"time_s": TIME, "motor_angle_rad": MOTOR})
    columns = {"time_s": TIME, "motor_angle_rad": MOTOR}
    for channel, noise in NOISE.items():
        bow = sensor_bends(out[channel], BENT) @ SIZE[channel] + zero if channel in CELLS else 0.0
        columns[channel] = out[channel] + bow + rng.normal(0.0, noise, TIME.size)
    return machine_run(name, columns, [ROUTE], hardware)


@cache
def work_of(sensor, zero=0.0):
    rng, hardware = np.random.default_rng(3), rig(sensor)
    runs = tuple(run_of(f"run{k}", rng, hardware, zero) for k in range(2))
    return machine_work(MachineCampaign("bench", hardware, (), runs, ("run1",)))[0]


def over_noise(rms):
    return max(value / NOISE[name] for name, value in rms.items())


def test_cells_that_are_bent_as_specified_are_no_effect():
    work = work_of(BENT)
    assert work.chosen.model.parts == ()
    assert work.zeros == ()
    assert over_noise(work.base.fitted) < 1.1
    assert over_noise(work.base.held) < 1.1


def test_cells_that_are_bent_beyond_their_specification_leave_more_than_noise():
    work = work_of(Sensor(noise=0.02, full_scale=40.0))
    assert work.chosen.model.parts or over_noise(work.base.held) > 1.3


def test_a_held_out_run_is_judged_without_what_the_fitted_runs_show_of_its_sensors():
    base = work_of(BENT).base
    (held,) = work_of(BENT).kept
    corrected = without_sensor_errors(held, base.problem, base.state.u)
    for name in CELLS:
        bow = held.measured[name] - corrected.measured[name]
        true = sensor_bends(held.measured[name], BENT) @ SIZE[name]
        off = (bow - bow.mean()) - (true - true.mean())  # the zero of the run takes the mean
        assert np.ptp(true) > 0.05
        assert np.std(off) < 0.25 * np.std(true)


def test_a_zero_within_the_specification_has_no_name_and_one_beyond_has():
    assert work_of(BENT, 0.1).zeros == ()
    assert {zero.channel for zero in work_of(BENT, 0.6).zeros} == set(CELLS)


def test_errors_of_a_sensor_are_none_at_zero_and_at_full_scale():
    waves = sensor_bends(np.array([0.0, 20.0, 40.0, 60.0]), BENT)
    np.testing.assert_allclose(waves[[0, 2, 3]], 0.0, atol=1e-12)
    assert waves[1] == pytest.approx([0.7 * 0.24, 0.0, -0.3 * 0.24, 0.0])
    assert stated_error(BENT, BENT.noise) == pytest.approx(0.26)


@pytest.mark.parametrize(("seed", "channel"), [(0, CELLS[0]), (4, "joint_angle_rad"), (9, CELLS[0])])
def test_as_many_numbers_as_readings_are_no_evidence(seed, channel):
    rng, at = np.random.default_rng(seed), np.linspace(0, TIME.size - 1, 9).astype(int)
    given = {"time_s": TIME[at], "motor_angle_rad": MOTOR[at]}
    true = simulate_machine(machine_of(PAIR, [ROUTE], 40), given)[channel]
    true = true * (1.0 + 0.1 * rng.standard_normal()) * np.exp(-0.05 * np.arange(9))
    read = true + (0.5 if channel in CELLS else 0.01) * rng.standard_normal(9)
    run = machine_run("run0", given | {channel: read}, [ROUTE], rig(Sensor()))
    work = machine_work(MachineCampaign("bench", rig(Sensor()), (), (run,), ()))[0]
    assert sum(map(len, work.base.state.left)) <= len(work.base.state.u)
    assert work.chosen.model.parts == ()
    assert work.zeros == ()
