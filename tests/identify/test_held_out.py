"""Held-out runs against a part that the fitted runs want."""

from dataclasses import replace

import numpy as np
import pytest

from tssgeom.effects import Backlash, LoadDependentFriction, TensionInGain, TensionOutOffset
from tssgeom.identify import prediction
from tssgeom.identify.campaign import Route, Run
from tssgeom.identify.drive_noise import sampled_drives
from tssgeom.identify.fit import base_fit
from tssgeom.identify.machine_evidence import contradicted
from tssgeom.identify.misfit import _is_worse, held_out
from tssgeom.identify.readings import noise_of, readings, with_held_out
from tssgeom.rig import Rig, Sensor
from tssgeom.route.pieces import Arcs
from tssgeom.statistics import NORMAL_95


@pytest.fixture(scope="module")
def clean(campaign):
    """The held-out runs of a clean campaign, and the model that is fitted to the others."""
    measured = campaign(4)[0]
    runs, _ = readings(measured)
    _, _, fit = base_fit([run for run in runs if not run.held_out], measured.rig)
    return held_out(runs, measured.rig, fit.at), fit.at


def with_part(at, effect):
    return replace(at, effects=(effect,))


def test_held_out_runs_contradict_a_play_that_is_not_there(clean):
    held, at = clean
    assert held.rise(at, with_part(at, Backlash(width_m=1e-4))) == np.inf


def test_a_part_that_lowers_what_held_out_runs_leave_counts_for_it(clean):
    held, at = clean
    assert held.rise(with_part(at, Backlash(width_m=1e-4)), at) < -10.0


def test_held_out_runs_contradict_a_part_from_the_rise_on_that_chance_makes_in_one_of_twenty(clean):
    held, at = clean
    offsets = np.geomspace(0.01, 0.1, 40)
    rises = [held.rise(at, with_part(at, TensionOutOffset(offset_N=size))) for size in offsets.tolist()]
    assert 0.9 < max(rise for rise in rises if rise < np.inf) / NORMAL_95**2 < 1.1


def test_a_part_that_makes_one_channel_worse_is_contradicted_however_much_another_gains(clean):
    held, at = clean
    wrong, part = (
        with_part(at, TensionInGain(gain_error=0.05)),
        with_part(at, TensionOutOffset(offset_N=0.15)),
    )
    change = held.change(wrong, wrong, part)
    assert change.rise == np.inf
    assert change.worse.startswith("tension out of the held-out runs is predicted worse with it, within 0.1")
    assert held.change(wrong, wrong, at).rise < -100.0  # without it the same gain is taken


def test_a_part_that_makes_a_channel_worse_than_the_base_model_is_contradicted(clean):
    held, at = clean
    before, after = (with_part(at, TensionOutOffset(offset_N=size)) for size in (0.3, 0.15))
    assert held.change(before, before, after).rise < -10.0
    assert held.change(at, before, after).rise == np.inf


def test_errors_that_last_are_worth_fewer_readings():
    rng = np.random.default_rng(3)
    white = 3.0 * rng.standard_normal(400)
    lasting = 3.0 * np.repeat(rng.standard_normal(20), 20)
    grown = [np.sqrt(1.1) * each for each in (white, lasting)]
    assert [
        _is_worse(each, more, 400, 0.025) for each, more in zip((white, lasting), grown, strict=True)
    ] == [
        True,
        False,
    ]


def test_one_channel_that_grows_contradicts_a_part_of_a_machine():
    assert contradicted({"tension_in_N": -50.0, "motor_torque_Nm": 5.4}) == "motor_torque_Nm"
    assert contradicted({"tension_in_N": -1.0, "motor_torque_Nm": 3.8}) == ""


def test_a_part_too_small_to_be_measured_is_not_contradicted(clean):
    held, at = clean
    rises = [held.rise(at, with_part(at, LoadDependentFriction(exponent=size))) for size in (-1e-3, 1e-3)]
    assert max(rises) < 1.96**2  # no contradiction
    assert np.abs(rises).max() < 1.0  # a third of the exponent's standard error decides nothing


def test_a_model_is_simulated_once_however_often_it_is_asked_for(clean, monkeypatch):
    held, at = clean
    part, simulations = with_part(at, TensionInGain(gain_error=0.01)), []
    whole = prediction.carry_on
    counted = lambda *args, **options: simulations.append(1) or whole(*args, **options)  # noqa: E731
    monkeypatch.setattr(prediction, "carry_on", counted)
    fresh = replace(held, simulated={})
    changes = [fresh.change(at, replace(at), part) for _ in range(3)]
    assert len(simulations) == 2 * len(held.problem.stack.readings)
    assert changes == [held.change(at, at, part)] * 3


def test_all_models_share_the_sampled_drives(clean):
    reading = clean[0].problem.stack.readings[0]
    drive, noise = reading.given[reading.drive], reading.noise[reading.drive]
    first = sampled_drives(drive, noise, reading.time)
    assert sampled_drives(drive.copy(), noise, reading.time) is first
    other = sampled_drives(drive + noise, noise, reading.time)
    assert np.abs(first.denoised - first.true).max() > 0.1 * noise
    assert np.allclose(other.true - noise, first.true, atol=1e-9)


@pytest.mark.parametrize(
    ("routes", "held"), [("aabb", 3), ("aaaa", 3), ("abaa", 1), ("abca", 2), ("a", None)]
)
def test_a_run_on_a_route_of_its_own_is_held_out_or_else_the_last(routes, held):
    arcs, nodes = Arcs.exact(np.ones(1), np.ones(1)), (np.zeros((2, 3)), np.zeros(2))
    shape = {name: Route(name, arcs, *nodes) for name in routes}
    runs, notes = with_held_out(tuple(Run(f"run {k}", shape[name], {}) for k, name in enumerate(routes)))
    assert [k for k, run in enumerate(runs) if run.held_out] == ([] if held is None else [held])
    assert len(notes) == (held is not None)
    assert all(("last" if routes in ("aabb", "aaaa") else "no other run") in note for note in notes)


def test_the_noise_of_a_sensor_without_a_specification_is_that_of_its_readings():
    time, rng = np.linspace(0.0, 10.0, 400), np.random.default_rng(5)
    readings = 8.0 + 5.0 * np.sin(time) + 0.02 * rng.standard_normal(400)
    assert noise_of(Rig(), "tension_out_N", time, readings) == pytest.approx(
        0.02,
        rel=0.25,  # the least of several estimates counts
    )
    exact = {"tension_out_N": Sensor(noise=0.03)}
    assert noise_of(Rig(sensors=exact), "tension_out_N", time, readings) == 0.03
