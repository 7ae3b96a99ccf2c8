"""Parts of a machine that only several channels or two parts together show: a lag of all force cells."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests import lumped
from tests.identify.test_machine_discovery import ANGLE, ARM, LENGTH, MU, PRETENSION, RHO, STIFF, columns, rig
from tssgeom.identify.fit_quality import spread
from tssgeom.identify.machine_discovery import discover_machine, machine_work
from tssgeom.identify.machine_evidence import size_of
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_fit import fit_round
from tssgeom.identify.machine_forecast import forecast
from tssgeom.identify.machine_parts import parts_of
from tssgeom.identify.machine_refit import without_needless, without_zeros
from tssgeom.identify.machine_run import machine_run
from tssgeom.identify.machine_selection import part_step, two_steps
from tssgeom.rig import with_values
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain

TIME = np.linspace(0.0, 24.0, 481)
LAG = 0.15
CELLS = ("tension_in_1_N", "tension_in_2_N")
UNKNOWN = ("end.stiffness_Nm_per_rad", "tendon.pretension_N")


@cache
def turned():
    """Return a pair that a motor turns four times to and fro."""
    path = lumped.from_pieces([LENGTH], [ANGLE], cells=60)
    physics = lumped.Physics(pretension_N=PRETENSION, friction=MU, compliance_per_N=RHO)
    motor = 0.9 * np.sin(2.0 * np.pi * TIME / 6.0) * (0.75 + 0.25 * np.sin(TIME / 4.0))
    drive = lumped.Motor("angle", TIME, motor, ARM)
    return motor, lumped.simulate_machine([(path, physics)] * 2, drive, lumped.Joint(ARM, STIFF), TIME, 0.05)


def bench(first, second):
    """Return a run whose two force cells lag [s], and its rig."""
    motor, made = turned()
    sensors = {
        name: lumped.Sensor(noise=0.03, lag_s=lag) for name, lag in zip(CELLS, (first, second), strict=True)
    }
    sensors["joint_angle_rad"] = lumped.Sensor(noise=1e-3)
    columns = lumped.measure_machine(made, sensors, 1) | {"motor_angle_rad": motor}
    return machine_run("run", columns, [route_of_rig(rig(2))], rig(2))


def finding_of(first, second):
    uncertain = tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN)
    return discover_machine(MachineCampaign("bench", rig(2), uncertain, (bench(first, second),)))


def keys(finding):
    return {effect.key for one in finding.effects for effect in one.effects}


def test_one_lag_of_all_force_cells_is_named_at_each_of_them():
    finding = finding_of(LAG, LAG)
    assert {one.names for one in finding.effects} == {("channel_lag",)}
    assert keys(finding) == {f"sensors.{name}.lag_s" for name in CELLS}
    for one in finding.effects:
        assert one.parameters[0]["lag_s"].value == pytest.approx(LAG, rel=0.05)
    for name in CELLS:
        assert finding.rig.sensors[name].lag_s == pytest.approx(LAG, rel=0.05)
        assert finding.misfit.after["held_out"][name] < 1.2 * 0.03


def test_the_lag_of_one_force_cell_is_not_that_of_all():
    finding = finding_of(0.0, LAG)
    assert keys(finding) == {"sensors.tension_in_2_N.lag_s"}


def test_cells_that_do_not_lag_have_none():
    assert finding_of(0.0, 0.0).verdict == "none"


def test_cells_are_tried_together_where_there_are_several_whose_lag_is_not_known():
    run = bench(0.0, 0.0)
    labels = {part.label for part in parts_of(rig(2), [], [run])}
    assert "channel_lag (tension_in_1_N, tension_in_2_N)" in labels
    known = with_values(rig(2), {"sensors.tension_in_1_N.lag_s": 0.1})
    labels = {part.label for part in parts_of(known, [], [run])}
    assert {each for each in labels if each.startswith("channel_lag (tension")} == {
        "channel_lag (tension_in_2_N)"
    }


def test_a_number_that_channels_share_is_set_at_each():
    made = with_values(rig(2), {"sensors.tension_in_1_N+tension_in_2_N.lag_s": 0.2})
    assert [made.sensors[name].lag_s for name in CELLS] == [0.2, 0.2]


def steps_of(**columns_of):
    """Return the base of a pair, its parts, and the step at which held-out readings refuse each alone."""
    hardware, uncertain = rig(2), tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN)
    run = machine_run(
        "run", columns(2, **{"torque": False, **columns_of}), [route_of_rig(hardware)], hardware
    )
    base = machine_work(MachineCampaign("bench", hardware, uncertain, (run,)))[0].chosen.base
    every = [
        part
        for part in parts_of(hardware, UNKNOWN, base.problem.runs)
        if part.name in ("end_play", "velocity_dependent_friction")
    ]
    now = part_step(base, base, every, ())
    refused = tuple(replace(one, contradiction="a channel gets worse") for one in now.tried)
    return base, every, replace(now, tried=refused)


def test_two_parts_that_are_refused_alone_are_taken_where_they_pass_together():
    base, every, now = steps_of(speed_gain=0.1, end_play=0.01)
    assert now.chosen is None
    first, second = two_steps(base, lambda: forecast(base), now, every, ())
    assert {first.chosen.part.name, second.chosen.part.name} == {"end_play", "velocity_dependent_friction"}
    assert second.before is first.chosen.model
    assert second.chosen.model.held["joint_angle_rad"] < 1.2 * 3e-4


def test_no_second_part_is_sought_where_the_first_leaves_nothing():
    base, every, now = steps_of(end_play=0.01)
    assert two_steps(base, lambda: forecast(base), now, every, ()) == (now,)


def test_no_two_parts_are_sought_in_noise():
    base, every, now = steps_of()
    assert two_steps(base, lambda: forecast(base), now, every, ()) == (now,)


@pytest.mark.parametrize("torque", [False, True])
def test_a_part_is_needless_only_where_held_out_readings_do_not_ask_for_it(torque):
    base, every, _ = steps_of(end_play=0.01, torque=torque)
    (speed,) = (part for part in every if part.name == "velocity_dependent_friction")
    hardware, own = speed.on(base.problem.rig)
    problem = replace(base.problem, rig=hardware, parameters=(*base.problem.parameters, *own))

    def with_friction(size):
        u = np.append(base.state.u, np.full(len(own), size))
        state = fit_round(problem, u, base.state.weight, base.state.inflation, 0)
        return replace(base, problem=problem, state=state, parts=(speed,))

    model = with_friction(1.0)
    assert without_needless(model, 0, ()).parts == ()
    helps = replace(model, held={name: 0.5 * rms for name, rms in model.held.items()})
    assert without_needless(helps, 0, ()) is None
    below = replace(with_friction(0.0), held=helps.held)
    assert without_needless(below, 0, ()).parts == ()
    if torque:  # one channel asks for it, and all together do not
        held = {name: (0.8 if name == "joint_angle_rad" else 2.0) * rms for name, rms in model.held.items()}
        assert without_needless(replace(model, held=held), 0, ()).parts == ()


def test_a_model_that_is_compared_with_one_without_a_zero_keeps_its_numbers():
    base, _, _ = steps_of(end_play=0.01, torque=True)
    (first, *_) = (each.key for each in base.problem.parameters if each.kind == "zero")
    less, same = without_zeros(base, [first], ())

    def numbers(model):
        names = [each.name for each in model.problem.parameters]
        return dict(zip(names, model.state.u, strict=True))

    assert numbers(same) == numbers(base)
    assert list(numbers(less)) == list(numbers(same))[: len(numbers(less))]


def test_the_bars_of_a_correction_are_more_where_the_readings_ask_for_it():
    base, _, _ = steps_of()
    problem, u = replace(base.problem, fine=40), base.state.u
    assert problem.refined(u).fine == 80
    (run,) = problem.runs
    exact = replace(problem, runs=(replace(run, noise=dict.fromkeys(run.noise, 1e-7)),))
    assert exact.refined(u).fine == 160


def test_few_outliers_hardly_change_the_size_of_residuals_and_many_do():
    left = np.random.default_rng(1).normal(0.0, 1.0, 1000)
    assert size_of(left) == pytest.approx(1.0, rel=0.05)
    few, many = left.copy(), left.copy()
    few[:20] = 50.0  # one in fifty: 1 + 0.02·9/(1 − 0.02·9) at most
    many[:200] = 50.0  # a turn of every cycle
    assert size_of(few) < 1.15
    assert size_of(many) == pytest.approx(np.sqrt(np.mean(many**2)), rel=1e-3)
    assert spread(many) < 2.5


def test_residuals_of_zero_have_a_size():
    assert size_of(np.zeros(10)) == 1e-12
