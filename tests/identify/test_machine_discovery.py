"""discover on machines whose cause an independent chain has built in: a pair and a joint."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests import lumped
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_discovery import discover_machine, machine_work
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_forecast import contradiction, forecast
from tssgeom.identify.machine_parts import parts_of
from tssgeom.identify.machine_refit import without_part
from tssgeom.identify.machine_run import machine_run
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.tendon.bars.sensors import play
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain

LENGTH, ANGLE, ARM, STIFF = 0.5, 3.7, 0.01, 0.25
PRETENSION, MU, RHO = 6.0, 0.12, 2.5e-4
UNKNOWN = ("end.stiffness_Nm_per_rad", "tendon.pretension_N")
NOISE = {"joint_angle_rad": 3e-4, "motor_torque_Nm": 1e-3}


@cache
def lumped_run(tendons, speed_gain, **more):
    """A motor that turns a joint four times, at two rates: time, motor angle, and what the chains do."""
    time = np.linspace(0.0, 48.0, 481)
    rate = np.where((time // 12.0) % 2 == 0, 1.0, 3.0)
    phase = np.cumsum(rate * np.gradient(time)) * 2.0 * np.pi / 12.0
    motor = 0.9 * np.sin(phase) * (0.7 + 0.3 * np.cos(phase / 5.0))
    if tendons == 1:
        motor = 0.8 + motor
    path = lumped.from_pieces([LENGTH], [ANGLE], cells=60)
    physics = lumped.Physics(
        pretension_N=PRETENSION, friction=MU, compliance_per_N=RHO, speed_gain=speed_gain, **more
    )
    drive = lumped.Motor("angle", time, motor, ARM)
    run = lumped.simulate_machine([(path, physics)] * tendons, drive, lumped.Joint(ARM, STIFF), time, 0.1)
    return time, motor, run


def rig(tendons):
    return Rig(
        tendon=Tendon(pretension_N=PRETENSION, compliance_per_N=RHO),
        friction=Friction(coefficient=MU),
        drive=Drive(kind="pair" if tendons == 2 else "tendon", radius_m=ARM),
        end=End(kind="joint", radius_m=ARM, stiffness_Nm_per_rad=STIFF),
        route=GivenRoute(length_m=LENGTH, angle_rad=ANGLE),
    )


def columns(tendons, *, speed_gain=0.0, end_play=0.0, zero=0.0, lag=0.0, torque=True, seed=1, **more):
    """What a laboratory would have measured: noise, and what is between the joint and its encoder."""
    time, motor, run = lumped_run(tendons, speed_gain, **more)
    rng = np.random.default_rng(seed)
    angle = play(np.asarray(run.joint_angle), end_play)
    out = {
        "time_s": time,
        "motor_angle_rad": np.interp(time - lag, time, motor),
        "joint_angle_rad": angle + rng.normal(0.0, NOISE["joint_angle_rad"], len(time)),
    }
    if torque:
        noise = rng.normal(0.0, NOISE["motor_torque_Nm"], len(time))
        rest = ARM * PRETENSION if tendons == 1 else 0.0  # the chains count torque from rest
        out["motor_torque_Nm"] = run.motor_torque + rest + zero + noise
    return out


def finding_of(tendons, *runs, held_out=()):
    hardware = rig(tendons)
    made = [machine_run(f"run {k}", each, [route_of_rig(hardware)], hardware) for k, each in enumerate(runs)]
    uncertain = tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN)
    return discover_machine(MachineCampaign("bench", hardware, uncertain, tuple(made), held_out))


def held(finding, channel):
    return tuple(each["held_out"][channel] for each in (finding.misfit.before, finding.misfit.after))


@pytest.mark.parametrize("torque", [True, False], ids=["torque", "displacement only"])
@pytest.mark.parametrize("tendons", [1, 2], ids=["joint", "pair"])
def test_a_clean_machine_lacks_nothing(tendons, torque):
    finding = finding_of(tendons, columns(tendons, torque=torque))
    assert finding.verdict == "none"
    assert finding.effects == ()
    before, after = held(finding, "joint_angle_rad")
    assert after == before < 1.2 * NOISE["joint_angle_rad"]


@pytest.mark.parametrize("torque", [True, False], ids=["torque", "displacement only"])
def test_friction_over_speed_in_a_pair_is_named_and_its_misfit_goes(torque):
    finding = finding_of(2, columns(2, speed_gain=0.1, torque=torque))
    assert finding.verdict == "effect"
    (effect,) = finding.effects
    assert effect.names == ("velocity_dependent_friction",)
    gain = effect.parameters[0]["gain"]
    assert gain.low < 0.1 < gain.high
    assert gain.value == pytest.approx(0.1, rel=0.1)
    before, after = held(finding, "joint_angle_rad")
    assert before > 4.0 * NOISE["joint_angle_rad"]
    assert after < 1.2 * NOISE["joint_angle_rad"]
    assert finding.rig.effects[0].gain == gain.value


def test_play_of_a_joint_is_named_by_displacement_alone():
    finding = finding_of(2, columns(2, end_play=0.01, torque=False))
    (effect,) = finding.effects
    assert effect.names == ("end_play",)
    assert any("taken to bend evenly" in note for note in finding.notes)
    assert effect.parameters[0]["play_rad"].value == pytest.approx(0.01, rel=0.05)
    assert finding.rig.end.play_rad == effect.parameters[0]["play_rad"].value
    before, after = held(finding, "joint_angle_rad")
    assert after < 0.4 * before


@pytest.mark.parametrize("lag", [0.2, -0.15])
def test_a_drive_that_is_recorded_late_or_early_is_named(lag):
    finding = finding_of(2, columns(2, lag=lag, torque=False))
    (effect,) = finding.effects
    assert effect.names == ("drive_lag",)
    assert effect.parameters[0]["lag_s"].value == pytest.approx(lag, abs=0.01)
    assert finding.rig.drive.lag_s == effect.parameters[0]["lag_s"].value
    before, after = held(finding, "joint_angle_rad")
    assert after < 0.4 * before


@pytest.mark.parametrize("lag", [0.2, 0.0])
def test_a_calibration_fits_the_lag_of_a_drive_where_there_is_one(lag):
    hardware = rig(2)
    run = machine_run("run", columns(2, lag=lag, torque=False), [route_of_rig(hardware)], hardware)
    uncertain = [Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN]
    fitted = calibrate_machine([run], hardware, uncertain)
    assert fitted.rig.drive.lag_s == pytest.approx(lag, abs=0.01)
    assert [each for each in fitted.warnings if "later than what answers" in each] == list(
        fitted.warnings[: int(lag != 0.0)]
    )
    assert fitted.held_out["joint_angle_rad"][0] < 1.2 * NOISE["joint_angle_rad"]
    if lag:
        (estimate,) = (each for each in fitted.estimates if each.key == "drive.lag_s")
        assert estimate.low < lag < estimate.high


def test_the_zero_of_a_torque_cell_is_named():
    finding = finding_of(1, columns(1, zero=0.02))
    (effect,) = finding.effects
    assert effect.names == ("channel_zero",)
    assert effect.effects[0].key == "sensors.motor_torque_Nm.zero"
    assert effect.parameters[0]["zero"].value == pytest.approx(0.02, abs=1e-3)
    assert finding.rig.sensors["motor_torque_Nm"].zero == pytest.approx(0.02, abs=1e-3)
    before, after = held(finding, "motor_torque_Nm")
    assert after < 0.4 * before  # the unknown pretension takes a part of it before


def test_a_run_is_held_out_as_marked_and_only_its_own_numbers_are_fitted_to_it():
    first, second = columns(2, end_play=0.01, torque=False), columns(2, end_play=0.01, torque=False, seed=2)
    second["joint_angle_rad"] = second["joint_angle_rad"] + 0.3  # an encoder with another zero
    finding = finding_of(2, first, second, held_out=("run 0",))
    assert [(trace.run, trace.held_out) for trace in finding.traces] == [("run 1", False), ("run 0", True)]
    assert finding.effects[0].names == ("end_play",)
    before, after = held(finding, "joint_angle_rad")
    assert after < 0.4 * before
    assert any("run 0, as the campaign says" in note for note in finding.notes)


def test_what_cannot_act_in_a_machine_is_not_tried():
    hardware = rig(2)
    run = machine_run("run", columns(2, torque=False), [route_of_rig(hardware)], hardware)
    names = {part.name for part in parts_of(hardware, ["end.play_rad"], [run])}
    assert {"drive_play", "joint_friction", "velocity_dependent_friction"} <= names
    assert not names & {"end_play", "drive_friction", "tension_in_gain", "backlash", "load_stiffness"}


@pytest.mark.parametrize("share", [1.0, 0.02])
def test_the_play_of_a_motor_is_tried_at_a_width_of_its_stroke(share):
    given = columns(2, torque=False)
    given["motor_angle_rad"] = share * given["motor_angle_rad"]
    run = machine_run("run", given, [route_of_rig(rig(2))], rig(2))
    (part,) = (each for each in parts_of(rig(2), [], [run]) if each.name == "drive_play")
    assert part.switch.start == pytest.approx(0.01 * np.ptp(given["motor_angle_rad"]), rel=1e-3)
    noise = np.random.default_rng(1).normal(0.0, 0.02 * share, len(given["time_s"]))
    loud = machine_run(
        "run", given | {"motor_angle_rad": given["motor_angle_rad"] + noise}, [route_of_rig(rig(2))], rig(2)
    )
    (part,) = (each for each in parts_of(rig(2), [], [loud]) if each.name == "drive_play")
    assert part.switch.start == pytest.approx(3.0 * 0.02 * share, rel=0.1)  # noise hides what is narrower


@cache
def work_of_play():
    """What the steps leave of a pair whose joint has play."""
    hardware = rig(2)
    run = machine_run("run", columns(2, end_play=0.01, torque=False), [route_of_rig(hardware)], hardware)
    uncertain = tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN)
    return machine_work(MachineCampaign("bench", hardware, uncertain, (run,)))[0]


def test_a_part_that_fails_at_the_end_of_the_runs_is_contradicted():
    chosen = work_of_play().chosen
    base, model = chosen.base, chosen.model
    assert [part.name for part in model.parts] == ["end_play"]
    assert contradiction(forecast(base), model) == ""
    without, with_it = (
        one.problem.answers(one.state.channels)[0]["joint_angle_rad"] for one in (base, model)
    )
    (run,) = model.problem.runs
    opposite = np.where(run.given["time_s"] > 33.0, without - with_it, 0.0)  # of what the part does
    runs = (replace(run, measured={"joint_angle_rad": run.measured["joint_angle_rad"] + 2.0 * opposite}),)
    base, model = (replace(one, problem=replace(one.problem, runs=runs)) for one in (base, model))
    why = contradiction(forecast(base), model)
    assert why.startswith("with it the held-out rms of joint_angle_rad is ")
    assert why.endswith("where only the first two thirds of the runs are fitted")


def test_a_part_that_is_taken_out_leaves_no_effect_of_size_zero():
    base = work_of_play().chosen.base
    every = parts_of(base.rig, [], base.problem.runs)
    two = [part for part in every if part.name in ("asymmetric_friction", "load_dependent_friction")]
    hardware, parameters = base.problem.rig, base.problem.parameters
    for part in two:
        hardware, own = part.on(hardware)
        parameters = (*parameters, *own)
    u = np.concatenate([base.state.u, np.zeros(len(parameters) - len(base.state.u))])
    problem = replace(base.problem, rig=hardware, parameters=parameters)
    model = replace(base, problem=problem, state=replace(base.state, u=u), parts=tuple(two))
    less = without_part(model, 0, ())
    assert less.parts == (two[1],)
    (effect,) = less.rig.effects
    assert isinstance(effect, type(two[1].effect))
    assert less.problem.parameters[-1].key.startswith("effects[0].")


def test_what_the_rig_says_is_unknown_has_no_nominal_value():
    unknown = Uncertain("friction.coefficient", UNKNOWNS["friction.coefficient"], stated=False)
    campaign = MachineCampaign("bench", rig(1), (unknown,), ())
    assert replace(work_of_play(), campaign=campaign).nominal == {"compliance_per_N": RHO}


def test_threads_do_not_wait_for_each_other_over_small_matrices(library_threads):
    bench = MachineCampaign("bench", rig(1), (), ())
    assert library_threads(lambda progress: discover_machine(bench, progress=progress)) == {1}
