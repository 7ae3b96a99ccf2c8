"""A calibrated rig states its errors: commands on it miss by as much as they say."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from tssgeom import calibrate, compensate, simulate
from tssgeom.effects import TensionOutOffset
from tssgeom.identify.rig_errors import of_calibration
from tssgeom.identify.workflow import discover
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Friction, Load, Rig, Tendon, read_uncertain_rig, write_rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.command_error import Step, with_rig_errors
from tssgeom.tendon.commander import Given, Target, commander_of
from tssgeom.tendon.machine_commander import output_errors
from tssgeom.tendon.state import pretensioned, step, transmit
from tssgeom.uncertain import Unexplained

OUT = "tension_out_N"
LOAD = Load(stiffness_N_per_m=5000.0)
ANGLE, ANGLE_SE = 3.1, 0.03  # of the route of the calibration [rad]


def random_run(rng):
    """Return a random tendon, and a run of it on a route whose angle is sensed with an error."""
    tendon = Tendon(compliance_per_N=rng.uniform(2e-4, 5e-4), pretension_N=1.5)
    true = Rig(friction=Friction(coefficient=rng.uniform(0.08, 0.2)), tendon=tendon, load=LOAD)
    time = np.arange(0.0, 40.0, 0.1)
    pull = 1.5 + 6.0 * (1.0 - np.cos(2.0 * np.pi * time / 20.0))
    run = simulate(Arcs.exact([0.5], [ANGLE]), {"time_s": time, "tension_in_N": pull}, true).to_pandas()
    measured = {
        "time_s": time,
        "tension_in_N": pull + rng.normal(0.0, 0.03, time.size),
        "tension_out_N": run["tension_out_N"] + rng.normal(0.0, 0.1) + rng.normal(0.0, 0.03, time.size),
        "elongation_m": run["elongation_m"] + rng.normal(0.0, 5e-6, time.size),
    }
    angle = ANGLE + rng.normal(0.0, ANGLE_SE)
    return true, measured, replace(Arcs.exact([0.5], [angle]), covariance=np.diag([1e-8, ANGLE_SE**2]))


def carried(rig, run):
    """Yield what a tendon transmits that the proximal tension of a run drives."""
    commander, state, arcs = commander_of(rig), pretensioned(rig), run.route.arcs
    for time, pull in zip(run.columns["time_s"], run.columns["tension_in_N"], strict=True):
        given = Given(float(pull), None, None, None)
        state, _, commander = commander.moved(state, Step(arcs, float(time), stands=True), given, 0.0)
        yield with_rig_errors(transmit(state, rig), commander.variants, rig, arcs, by_tension=True)


def test_commands_of_a_calibrated_tendon_miss_by_their_standard_error(tmp_path):
    guess, other, missed = Rig(tendon=Tendon(pretension_N=1.5), load=LOAD), Arcs.exact([0.6], [4.5]), []
    for seed in range(24):
        true, measured, sensed = random_run(np.random.default_rng(seed))
        fitted = calibrate(measured, sensed, guess)
        write_rig(tmp_path / "rig.toml", fitted.applied(guess), (), of_calibration(fitted, guess))
        rig, uncertain = read_uncertain_rig(tmp_path / "rig.toml")
        commander = commander_of(rig, uncertain)
        command, _ = commander.command(pretensioned(rig), Step(other, 0.0), Target(1.2e-3, None), elapsed=1.0)
        ends = transmit(step(pretensioned(true), other, true, displacement_in=command.displacement_in), true)
        missed.append((ends.displacement_out - command.displacement_reached) / command.displacement_out_se)
    # 24 draws give a standard deviation to 14 %
    assert np.sqrt(np.mean(np.square(missed))) == pytest.approx(1.0, abs=0.4)


def test_the_zero_of_the_cell_has_its_error_where_it_is_corrected():
    rng = np.random.default_rng(5)
    _, measured, sensed = random_run(rng)
    measured["tension_out_N"] = measured["tension_out_N"] + 0.5
    had = Rig(tendon=Tendon(pretension_N=1.5), load=LOAD, effects=(TensionOutOffset(offset_N=0.1),))
    fitted = calibrate(measured, sensed, had)
    errors = of_calibration(fitted, had)
    assert errors.keys == ("friction.coefficient", "tendon.compliance_per_N", "effects[0].offset_N")
    zero = fitted.estimates["tension_out_offset"]
    assert errors.sd[2] == pytest.approx((zero.high - zero.low) / 3.92, rel=1e-3)


def test_a_joint_misses_by_what_the_correlations_of_its_rig_say(tmp_path):
    """Friction and pretension of a pair are known as a product: alone, each is off by several per cent."""
    rng, arcs = np.random.default_rng(4), Arcs.exact([0.8], [4.0])
    true = Rig(
        friction=Friction(coefficient=0.12),
        tendon=Tendon(compliance_per_N=3e-4, pretension_N=6.0),
        drive=Drive(kind="pair", radius_m=0.01),
        end=End(kind="joint", radius_m=0.006, stiffness_Nm_per_rad=0.05),
        route=GivenRoute(length_m=0.8, angle_rad=4.0, bends=(1.0,)),
    )
    time = np.arange(0.0, 30.0, 0.1)
    motor = 0.8 * np.sin(2.0 * np.pi * time / 10.0) * np.minimum(1.0, 0.4 + time / 25.0)
    run = simulate(arcs, {"time_s": time, "motor_angle_rad": motor}, true).to_pandas()
    names = ("motor_torque_Nm", "joint_angle_rad")
    measured = {name: run[name] + rng.normal(0.0, 2e-3, time.size) for name in names}
    path = tmp_path / "rig.toml"
    write_rig(path, true)
    text = path.read_text()
    for line in ("compliance_per_N = 0.0003", "pretension_N = 6.0", "coefficient = 0.12"):
        assert line in text
        text = text.replace(line, f'{line.partition(" ")[0]} = "unknown"')
    path.write_text(text)
    fitted = calibrate({"time_s": time, "motor_angle_rad": motor, **measured}, None, path)
    write_rig(path, fitted.rig, (), fitted.errors)
    rig, uncertain = read_uncertain_rig(path)
    later = np.arange(0.0, 10.0, 0.5)
    command = {"time_s": later, "motor_angle_rad": 0.6 * np.sin(2.0 * np.pi * later / 7.0)}
    is_at, meant = (simulate(arcs, command, each).to_pandas()["joint_angle_rad"] for each in (true, rig))

    def errors(numbers):
        return np.sqrt(output_errors([arcs], rig, command, numbers, ["joint_angle_rad"])[:, 0, 0])

    stated = errors(uncertain)
    missed = float(np.sqrt(np.mean((is_at - meant) ** 2)))
    assert missed < 2.5 * float(np.mean(stated))
    rig = msgspec.structs.replace(rig, unexplained=Unexplained(joint_angle_rad=3e-3))
    assert errors(uncertain) == pytest.approx(np.hypot(stated, 3e-3), rel=1e-9)
    command = {name: values[1:] for name, values in command.items()}
    target = {"time_s": command["time_s"], "joint_angle_rad": 0.1 + 0.0 * command["time_s"]}
    exact = compensate(arcs, target, rig)
    np.testing.assert_allclose(exact.to_pandas()["joint_angle_se_rad"], 3e-3, rtol=1e-3)
    rig = msgspec.structs.replace(rig, unexplained=Unexplained())
    alone = [replace(each, correlation={}) for each in uncertain]
    assert float(np.mean(errors(alone))) > 2.0 * float(np.mean(stated))


def test_bars_hold_on_a_run_of_a_rig_that_no_effect_explains(campaign):
    """A route that sways has no name; what it leaves of known runs is what it does to others."""
    whole = campaign(301, "swaying_route")[0]
    *others, run = sorted(whole.runs, key=lambda one: one.held_out)
    runs = (others[0], replace(others[1], held_out=True), *others[2:])
    finding = discover(replace(whole, runs=runs))
    assert finding.verdict == "unknown"
    assert {"friction.coefficient", "tendon.compliance_per_N"} <= set(finding.errors.keys)
    held = {}
    for left in (Unexplained(), finding.unexplained):
        rig = msgspec.structs.replace(finding.rig, unexplained=left)
        within = [
            abs(read - ends.tension_out) <= 1.96 * math.hypot(ends.tension_out_se, finding.misfit.noise[OUT])
            for read, ends in zip(run.columns[OUT], carried(rig, run), strict=True)
        ]
        held[bool(left)] = np.mean(within)
    assert held[False] < 0.5
    assert held[True] > 0.85


def test_a_calibration_states_what_an_effect_that_it_lacks_leaves(tmp_path):
    """A cell that reads T_out 0.4 N too high from 8 N on has no number in the fit."""
    guess = Rig(tendon=Tendon(pretension_N=1.5), load=LOAD)
    for step_of_cell in (0.0, 0.4):
        _, measured, sensed = random_run(np.random.default_rng(7))
        measured[OUT] = measured[OUT] + step_of_cell * (measured["tension_in_N"] > 8.0)
        fitted = calibrate(measured, sensed, guess)
        errors = of_calibration(fitted, guess)
        left = next(each for each in fitted.channels if each.channel == OUT)
        assert bool(errors.unexplained) == (step_of_cell > 0.0)
    assert errors.unexplained.tension_out_N == pytest.approx(math.sqrt(left.rms**2 - left.noise**2))
    write_rig(tmp_path / "rig.toml", fitted.applied(guess), (), errors)
    rig, _ = read_uncertain_rig(tmp_path / "rig.toml")
    assert rig.unexplained == errors.unexplained
