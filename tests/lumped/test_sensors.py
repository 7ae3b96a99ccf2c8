"""The sensor chain: each fault as large as it was asked for, the same for the same seed."""

import numpy as np
import pytest

from tests.lumped import (
    CHANNELS,
    Distal,
    Drive,
    Joint,
    Motor,
    Physics,
    Segment,
    Sensor,
    from_pieces,
    machine_channels,
    measure,
    measure_machine,
    simulate,
    simulate_machine,
    true_channels,
)
from tests.lumped.sensors import bend


@pytest.fixture(scope="module")
def run():
    drive = Drive(
        "force", np.array([0.0, 5.0, 10.0]), np.array([2.0, 15.0, 2.0]), np.array([20.0, 21.0, 25.0])
    )
    path = from_pieces([0.5], [np.pi], 32)
    times = np.linspace(0.0, 10.0, 2001)
    return simulate(path, Physics(pretension_N=2.0), drive, Distal("spring", 3000.0), times)


def observed(run, channel="tension_in_N", seed=0, **faults):
    return measure(run, {channel: Sensor(**faults)}, seed)[channel]


def test_perfect_sensors_show_the_run(run):
    columns = measure(run, {name: Sensor() for name in CHANNELS}, 0)
    truth = true_channels(run)
    assert list(columns) == ["time_s", *CHANNELS]
    assert all(np.array_equal(columns[name], truth[name]) for name in CHANNELS)


def test_a_seed_gives_its_digits_whatever_other_channels_there_are(run):
    noisy = Sensor(noise=0.1, nonlinearity=1e-3, full_scale=50.0, drift=0.1)
    alone = measure(run, {"tension_out_N": noisy}, 7)
    both = measure(run, {"tension_in_N": noisy, "tension_out_N": noisy}, 7)
    assert np.array_equal(alone["tension_out_N"], both["tension_out_N"])
    assert not np.array_equal(both["tension_in_N"], measure(run, {"tension_in_N": noisy}, 8)["tension_in_N"])


def test_noise_is_white_and_of_its_size(run):
    noise = observed(run, noise=0.1) - run.tension_in
    assert noise.std() == pytest.approx(0.1, rel=0.1)  # 1/√4000 = 1.6 % is one standard error
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.1  # 2.2 % is one


def test_readings_have_digits_and_an_end(run):
    read = observed(run, resolution=0.25, full_scale=10.0)
    assert np.all(read % 0.25 == 0.0)
    assert np.abs(read - np.minimum(run.tension_in, 10.0)).max() <= 0.125 + 1e-12  # half a step
    assert read.max() == 10.0


def test_gain_and_offset_are_a_straight_line(run):
    assert observed(run, gain=1.02, offset=-0.3) == pytest.approx(1.02 * run.tension_in - 0.3, abs=1e-12)


@pytest.mark.parametrize("shape", np.linspace(0.0, 6.0, 7))
def test_nonlinearity_peaks_at_its_size_and_leaves_the_ends(shape):
    share = np.linspace(-1.0, 1.0, 4001)
    deviation = bend(share, shape)
    assert np.abs(deviation).max() == pytest.approx(1.0, abs=1e-3)  # the peak lies between points of a grid
    assert np.abs(deviation[[0, 2000, 4000]]).max() < 1e-12


def test_nonlinearity_is_a_share_of_the_full_scale(run):
    off = observed(run, nonlinearity=2e-3, full_scale=20.0) - run.tension_in
    assert 0.01 < np.abs(off).max() <= 0.04 + 1e-9


def test_drift_starts_at_nothing_and_is_slow(run):
    off = observed(run, drift=0.2, drift_time_s=100.0) - run.tension_in
    assert off[0] == 0.0
    assert 0.0 < np.abs(off).max() <= 0.4
    assert np.abs(np.diff(off)).max() <= 0.2 * 2 * np.pi / 100.0 * 0.005 * (
        1 + 1e-6
    )  # amplitude × rate × sample


def test_lag_delays_a_ramp_by_its_time_constant(run):
    lagged = observed(run, lag_s=0.1)
    ramp = (run.times > 2.0) & (run.times < 5.0)
    assert (run.tension_in - lagged)[ramp] == pytest.approx(
        0.1 * 13.0 / 5.0, abs=1e-6
    )  # e^-20 of the start is left


def test_a_late_recorder_reads_what_was(run):
    delayed = observed(run, delay_s=0.1)
    assert delayed[0] == run.tension_in[0]
    assert delayed == pytest.approx(np.interp(run.times - 0.1, run.times, run.tension_in), abs=1e-12)


def test_crosstalk_adds_a_share_of_the_other_channel(run):
    read = observed(run, "tension_out_N", crosstalk={"tension_in_N": 0.03})
    assert read == pytest.approx(run.tension_out + 0.03 * run.tension_in, abs=1e-12)


PAIR = [(from_pieces([0.5], [np.pi], 16), Physics(pretension_N=5.0))] * 2
TIMES = np.array([0.0, 5.0, 10.0])


@pytest.fixture(scope="module")
def machine():
    motor = Motor("angle", TIMES, np.array([0.0, 0.3, 0.0]), 0.01)
    return simulate_machine(PAIR, motor, Joint(0.01, 0.2), np.linspace(0.0, 10.0, 1001))


def test_a_machine_has_the_channels_of_what_it_is_made_of(machine):
    ends = [f"{side}_{k}" for side in ("in", "out") for k in (1, 2)]
    tendon = {f"displacement_{end}_m" for end in ends} | {f"tension_{end}_N" for end in ends}
    joint = {"motor_angle_rad", "motor_torque_Nm", "joint_angle_rad", "joint_torque_Nm", "load_torque_Nm"}
    truth = machine_channels(machine)
    assert set(truth) == tendon | joint | {"temperature_C"}
    assert np.array_equal(truth["tension_in_2_N"], machine.tendons[1].tension_in)
    drives = [Drive("displacement", TIMES, np.array([0.0, each, 0.0])) for each in (1e-3, -1e-3)]
    bent = simulate_machine(PAIR, drives, Segment(0.01, (0.0, np.pi), 0.2), [0.0, 5.0])
    tip = {"bending_x_rad", "bending_y_rad", "tip_x_m", "tip_y_m", "tip_z_m"}
    assert set(machine_channels(bent)) == tendon | tip | {"temperature_C"}
    assert machine_channels(bent)["tip_x_m"][1] == bent.tip[1, 0] > 0.0


def test_sensors_of_a_machine_add_what_they_are_asked_for(machine):
    sensors = {"joint_angle_rad": Sensor(noise=1e-3), "tension_out_2_N": Sensor(noise=0.1, offset=0.2)}
    read, truth = measure_machine(machine, sensors, 3), machine_channels(machine)
    assert list(read) == ["time_s", *sensors]
    assert (read["joint_angle_rad"] - truth["joint_angle_rad"]).std() == pytest.approx(1e-3, rel=0.1)
    off = read["tension_out_2_N"] - truth["tension_out_2_N"]
    assert off.mean() == pytest.approx(0.2, abs=0.02)  # 0.1/√1000 = 0.003 is one standard error
    alone = measure_machine(machine, {"joint_angle_rad": Sensor(noise=1e-3)}, 3)
    assert np.array_equal(alone["joint_angle_rad"], read["joint_angle_rad"])
