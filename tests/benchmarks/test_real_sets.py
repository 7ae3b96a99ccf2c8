"""Measured runs that stand beside the project: they are read as their README describes them."""

import math

import numpy as np
import pytest

from benchmarks.real import fit, rms
from benchmarks.real_sets import (
    BAND,
    RADIUS,
    ROBOTS,
    STRETCH,
    TOOL,
    band_cases,
    bending_angle,
    robot_cases,
    stretch_cases,
    tool_cases,
    without_jumps,
)
from benchmarks.run_laws import LAWS, mean_cycle_error
from benchmarks.run_machines import predictions

needs_tool = pytest.mark.skipif(not TOOL.is_dir(), reason="needs the torques of the cable-driven instrument")
needs_robots = pytest.mark.skipif(not ROBOTS.is_dir(), reason="needs the tendon robots")
needs_stretch = pytest.mark.skipif(not STRETCH.is_dir(), reason="needs the stretched tendons")
needs_band = pytest.mark.skipif(not BAND.is_dir(), reason="needs the band round a drum")


KIP, INCH = 4448.2216, 0.0254  # N, m


def test_the_bending_angle_is_that_of_the_arc_that_made_the_end():
    angle, length, beyond = np.array([-1.2, -0.1, 0.3, 1.0]), 0.06, 0.13
    lateral = length * (1.0 - np.cos(angle)) / angle + beyond * np.sin(angle)
    height = length * np.sin(angle) / angle + beyond * np.cos(angle)
    assert bending_angle(lateral, height, length, beyond) == pytest.approx(angle, abs=1e-5)


def test_jumps_of_a_tracker_are_left_out():
    length = np.array([9.0, 9.5, 24.0, 10.5, 0.0, 11.0])
    assert without_jumps(length, np.array([9.0, 11.0])) == pytest.approx([9.0, 9.5, 10.0, 10.5, 10.75, 11.0])


@needs_tool
def test_the_instrument_holds_out_cycles_a_load_and_a_pitch():
    cases = tool_cases()
    assert len(cases) == 12 + 3 + 1
    for case in cases:
        assert not np.any(case.fitted & case.held_out)
        held = set(case.run[case.held_out].tolist())
        shared = held & set(case.run[case.fitted].tolist())
        assert shared == ({0} if case.period else set())  # cycles of one run, or whole runs
    run = cases[0].columns
    moving = np.ptp(run["joint_angle_rad"]) / np.ptp(run["motor_angle_rad"])
    assert 0.85 < moving < 0.95
    assert run["joint_torque_Nm"].max() < 0.0
    assert all(mean_cycle_error(case, "tension_in_N") < 0.3 for case in cases[:12])


def play_fit(case, play):
    """Return gain over that of ideal geometry, play [mm], and rms [degrees] of fitted and held-out rows."""
    values = {each.name: each.value for each in play.parameters}
    errors = [rms(case, "bending_angle_rad", play, rows) for rows in (case.fitted, case.held_out)]
    return values["gain"] * RADIUS, 1e3 * values["w"], *map(math.degrees, errors)


def stop_fit(case, stop):
    """Return stiffness [kip/in], force [kip] and rms of held-out rows [kip]."""
    values = {each.name: each.value for each in stop.parameters}
    error = rms(case, "friction_force_N", stop, case.held_out)
    return values["stiffness"] * INCH / KIP, values["force"] / KIP, error / KIP


@needs_tool
def test_a_fit_begins_where_the_whole_run_has_an_equilibrium():
    """The best start of few samples of this run is one where the whole run has none."""
    case = tool_cases(quick=True)[0]
    made = predictions(case)
    assert made is not None
    assert rms(case, "tension_out_N", made["tension_out_N"], case.held_out) < 0.12  # the best peer has 0.089


@needs_band
def test_the_stop_fits_of_the_band_are_those_of_the_sets_readme():
    known = zip((10.3, 14.0, 17.9, 14.6), (1.40, 2.04, 2.78, 2.16), (0.22, 0.33, 0.37, 0.46), strict=True)
    for case, figures in zip(band_cases(), known, strict=True):
        friction = case.responses[0]
        here = stop_fit(case, fit(LAWS["stop"], case, friction))
        assert here == pytest.approx(figures, rel=0.05)  # the mean of 8 samples here
        backlash = stop_fit(case, fit(LAWS["stop + backlash"], case, friction))
        assert backlash[2] < 0.85 * here[2]


@needs_robots
def test_the_play_fits_of_the_robots_are_those_of_the_sets_readme():
    """How the README drops rows of the other segments is not stated in full; the first needs none dropped."""
    cases = {case.name: case for case in robot_cases()}
    for name, figures, tolerance in (
        ("v4 segment 1", (0.93, 0.065, 0.56, 1.39), 0.01),
        ("v4 segment 2", (1.01, 0.11, 1.20, 2.35), 0.15),
        ("v6 segment 1", (0.97, 0.02, 2.4, 0.8), 0.15),
    ):
        case = cases[name]
        assert play_fit(case, fit(LAWS["play"], case, case.responses[0])) == pytest.approx(
            figures, rel=tolerance
        )
    third = cases["v6 segment 3"]
    assert play_fit(third, fit(LAWS["play"], third, third.responses[0]))[3] > 10.0  # its lengths are wrong


@needs_stretch
def test_a_line_through_the_plateaus_has_the_makers_stiffness_and_misses_the_second_half():
    known = {"filament5": (2.52, 1.8), "sc11": (9.0417, 2.4), "sc21": (19.4539, 7.4), "ss21": (20.5721, 8.9)}
    cases = stretch_cases()
    for case, (stiffness, missed) in zip(cases[:4], known.values(), strict=True):
        length, force = 100.0 * case.columns["length_m"], case.columns["force_N"]
        assert np.polyfit(length, force, 1)[0] == pytest.approx(stiffness, rel=1e-3)
        result = fit(LAWS["gain only"], case, case.responses[0])
        error = np.sqrt(np.mean((result.values - force)[case.held_out] ** 2))
        assert error == pytest.approx(missed, abs=0.05)
    for case in cases[4:]:  # one clock for both recordings
        assert np.corrcoef(case.columns["length_m"], case.columns["force_N"])[0, 1] > 0.93
