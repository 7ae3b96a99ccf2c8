"""The table of rules, its page, and examples that break each rule on frames, rigs, commands and campaigns."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tssgeom import Frame, Rig, process
from tssgeom.effects import FrictionLaw, HiddenBend, SensorLaw
from tssgeom.errors import SettingsError
from tssgeom.mechanism import Drive, DriveLimits, End, GivenRoute
from tssgeom.plausibility.frames import FrameWatch, command_remarks, rig_remarks
from tssgeom.plausibility.rules import RULES, warnings_of
from tssgeom.plausibility.runs import campaign_remarks, fit_remarks, law_remarks
from tssgeom.plausibility.series import Series
from tssgeom.rig import Friction, Sensor, Tendon
from tssgeom.stream import FrameResult, Rejected

HOME = Path(__file__).parents[2]
ANGLE = np.linspace(0.0, np.pi, 40)
HALF = 0.5 / np.pi * np.column_stack((np.sin(ANGLE), 1.0 - np.cos(ANGLE), 0.0 * ANGLE))


def test_the_page_is_that_of_the_table():
    ended = subprocess.run([sys.executable, HOME / "docs" / "checks.py", "--check"], check=False, cwd=HOME)
    assert ended.returncode == 0, "run python docs/checks.py"


def test_every_rule_is_complete_and_is_used_by_the_code():
    code = "".join(
        p.read_text("utf-8")
        for p in (HOME / "tssgeom" / "plausibility").glob("*.py")
        if not p.stem.endswith("rules")
    )
    for name, rule in RULES.items():
        assert rule.severity
        assert all((rule.test, rule.reason.endswith("."), rule.hint))
        assert f'"{name}"' in code


def of_frame(frame: Frame, rig: Rig | None = None) -> set[str]:
    (result,) = process([frame], rig or Rig(), tension_in=5.0)
    assert isinstance(result, FrameResult)
    return {warning.rpartition("[")[2].rstrip("]") for warning in result.warnings}


@pytest.mark.parametrize(
    ("frame", "rule"),
    [
        (Frame(HALF, temperature=295.0), "temperature"),
        (Frame(HALF, temperature=77.0), "warm"),
        (Frame(HALF, elongation=1.9), "stretch_unit"),
        (Frame(HALF, tension_in=5.0, tension_out=9.0), "tension_excess"),
        (Frame(HALF, tension_in=5.0, tension_out=-4.0), "negative_tension"),
    ],
)
def test_an_implausible_frame_is_used_with_a_warning(frame, rule):
    assert rule in of_frame(frame)
    assert not of_frame(Frame(HALF, tension_in=5.0, tension_out=3.0, temperature=21.0, elongation=1e-3))


def test_a_hidden_bend_beyond_the_route_is_named():
    rig = Rig(effects=(HiddenBend(at_m=0.9, angle_rad=0.1),))
    assert "hidden_bend_beyond" in of_frame(Frame(HALF, tension_in=5.0), rig)


@pytest.mark.parametrize(
    ("route", "named"),
    [
        (GivenRoute(length_m=0.5, angle_rad=np.pi), False),
        (GivenRoute(length_m=0.9), False),  # a sheath that is sensed in part
        (GivenRoute(length_m=0.3), True),
        (GivenRoute(angle_rad=1.0), True),
        (GivenRoute(angle_rad=180.0), True),
    ],
)
def test_a_route_of_the_rig_that_the_points_contradict_is_named(route, named):
    drive, end = Drive(kind="pair", radius_m=0.01), End(kind="joint", radius_m=0.01, stiffness_Nm_per_rad=0.1)
    rig = Rig(drive=drive, end=end, tendon=Tendon(pretension_N=5.0), route=route)
    frame = Frame(HALF, of_machine={"motor_angle_rad": 0.1})
    assert ("given_route" in of_frame(frame, rig)) is named


def test_points_that_freeze_are_named_once_in_a_hundred_frames_and_a_route_that_always_stood_is_not():
    rng, watch, still = np.random.default_rng(1), FrameWatch(), FrameWatch()
    moving = [Frame(HALF + 1e-4 * rng.standard_normal(HALF.shape), time=0.01 * k) for k in range(50)]
    frozen = [replace(moving[-1], points=moving[-1].points.copy(), time=0.5 + 0.01 * k) for k in range(250)]
    named = [text for frame in moving + frozen for text in watch.take(frame)]
    assert len(named) == 2
    assert all("[frozen_frames]" in text for text in named)
    assert not [text for k in range(250) for text in still.take(Frame(HALF, time=0.01 * k))]


def test_a_pause_between_frames_is_named_once():
    watch, times = FrameWatch(), [0.01 * k for k in range(60)] + [9.0 + 0.01 * k for k in range(60)]
    named = [text for time in times for text in watch.take(Frame(HALF, time=time))]
    assert len(named) == 1
    assert "[frame_time_jump]" in named[0]


@pytest.mark.parametrize("other", [HALF[::-1], 1e3 * HALF, HALF * [1, -1, 1]])
def test_a_route_that_leaps_and_comes_back_is_named_twice(other):
    frames = [Frame(other if k == 8 else HALF + 1e-4 * k, time=0.01 * k) for k in range(20)]
    watch, unordered = FrameWatch(), FrameWatch()
    named = [text for frame in frames for text in watch.take(frame)]
    assert len(named) == 2
    assert all("[frame_leap]" in text for text in named)
    assert not [text for frame in frames for text in unordered.take(frame, in_order=False)]


def test_a_route_of_another_second_is_no_leap():
    watch = FrameWatch()
    frames = [Frame(HALF[::-1] if k == 8 else HALF, time=float(k)) for k in range(20)]
    assert not [text for frame in frames for text in watch.take(frame)]


def test_two_targets_are_rejected():
    both = Frame(HALF, displacement_target=2e-3, tension_out_target=3.0)
    (rejected,) = process([both], Rig(), tension_in=5.0)
    assert isinstance(rejected, Rejected)
    assert "two targets" in rejected.reason


@pytest.mark.parametrize(
    ("bad", "rule"),
    [
        (Frame(HALF, time=0.5, tension_in=1e9), "strain"),
        (Frame(HALF, time=0.5, tension_in=15e3), "strain"),
        (Frame(HALF, time=0.5, displacement_in=5.0), "stroke"),
        (Frame(HALF, time=0.5, tension_in=5.0, noise=0.2), "noise_unit"),
    ],
)
def test_a_frame_that_cannot_be_is_rejected_and_the_next_ones_are_as_if_it_had_not_come(bad, rule):
    rig = Rig(drive=Drive(limits=DriveLimits(speed_m_per_s=0.05)))
    times = np.arange(0.4, 0.7, 0.1)
    good = [Frame(HALF, time=time, displacement_target=0.002 * time) for time in times]
    without = process(good, rig, tension_in=5.0)
    results = list(process([*good[:1], bad, *good[1:]], rig, tension_in=5.0))
    (rejected,) = [each for each in results if isinstance(each, Rejected)]
    assert rejected.reason.endswith(f"[{rule}]")
    commands, expected = (
        [each.displacement_command for each in some if isinstance(each, FrameResult)]
        for some in (results, without)
    )
    assert commands == expected


def test_a_route_may_grow_as_fast_as_an_instrument_is_inserted():
    frames = [Frame((0.1 + 0.05 * k) * HALF, time=0.1 * k, tension_in=5.0) for k in range(20)]
    assert not [each for each in process(frames, Rig(), tension_in=5.0) if isinstance(each, Rejected)]


def test_a_frame_without_its_target_holds_the_tendon_and_says_so():
    frames = [Frame(HALF, time=0.1 * k, displacement_target=0.002) for k in range(3)]
    frames += [Frame(HALF, time=0.3), Frame(HALF, time=0.4, displacement_target=0.002)]
    results = process(frames, Rig(), tension_in=15.0)
    before, held, after = [each for each in results if isinstance(each, FrameResult)][2:]
    assert held.state.tension_in == before.state.tension_in
    assert [text for text in held.warnings if "neither drive nor target" in text]
    assert after.displacement_command == pytest.approx(before.displacement_command, rel=1e-12)


def test_a_target_beyond_reason_is_rejected_and_leaves_the_tendon_as_it_was():
    frames = [Frame(HALF, time=0.0, tension_in=5.0), Frame(HALF, time=1.0, displacement_target=2.0)]
    first, second, third = process([*frames, Frame(HALF, time=2.0, tension_in=5.0)], Rig(), tension_in=5.0)
    assert isinstance(second, Rejected)
    assert second.reason.endswith("[strain]")
    assert third.transmission.tension_out == first.transmission.tension_out


def test_commands_are_held_against_strain_full_scale_and_route():
    rig = Rig(sensors={"tension_in_N": Sensor(full_scale=20.0)})
    assert [each.rule for each in command_remarks(rig, 0.5, 15.0, 0.01)] == []
    assert [each.rule for each in command_remarks(rig, 0.5, 25.0, 0.01)] == ["beyond_scale"]
    assert [each.rule for each in command_remarks(rig, 0.5, 70.0, 1.2)] == ["full_scale", "stroke"]
    assert [each.rule for each in command_remarks(Rig(), 0.5, 2875.0, 0.5)] == ["strain"]


@pytest.mark.parametrize(
    ("rig", "rule"),
    [
        (Rig(friction=Friction(coefficient=4.8)), "rig_friction"),
        (Rig(tendon=Tendon(compliance_per_N=0.3)), "rig_strain"),
        (Rig(sensors={"tension_in_N": Sensor(noise=20.0, full_scale=10.0)}), "rig_sensor"),
        (
            Rig(tendon=Tendon(pretension_N=5.0), sensors={"tension_in_N": Sensor(full_scale=4.0)}),
            "rig_sensor",
        ),
    ],
)
def test_an_implausible_rig_is_named(rig, rule):
    assert [each.rule for each in rig_remarks(rig)] == [rule]
    assert not list(rig_remarks(Rig()))


def test_what_a_campaign_needs_is_named():
    time, pull = np.arange(30.0), np.linspace(0.0, 5.0, 30)
    assert [each.rule for each in fit_remarks({"time_s": time, "tension_out_N": pull})] == ["no_drive"]
    assert [each.rule for each in fit_remarks({"time_s": time, "tension_in_N": pull})] == ["no_response"]
    apart = np.where(time < 15, np.nan, pull)
    both = {"time_s": time, "tension_in_N": np.where(time < 15, pull, np.nan), "tension_out_N": apart}
    assert [each.rule for each in fit_remarks(both)] == ["few_rows"]
    measured = pull + 0.02 * np.random.default_rng(1).standard_normal(30)
    runs = [(name, {"time_s": time, "tension_in_N": measured}) for name in ("one", "two")]
    assert [each.rule for each in campaign_remarks(runs)] == ["same_readings"]
    assert not list(campaign_remarks([runs[0], ("two", {"time_s": time, "tension_in_N": measured + 0.01})]))


def test_a_refusal_is_one_line_with_its_position_and_the_name_of_its_rule():
    remarks = fit_remarks({"time_s": np.arange(3.0)})
    with pytest.raises(SettingsError, match=r"^run\.csv: no drive: .*\[no_drive\]$"):
        warnings_of("run.csv", remarks)


def test_check_reports_a_rig_beyond_reason(tmp_path, capsys):
    from pipelines.cli import main

    (tmp_path / "rig.toml").write_text("[friction]\ncoefficient = 4.8\n")
    with pytest.raises(SystemExit):
        main(["check", str(tmp_path / "rig.toml"), "--json"])
    (report,) = json.loads(capsys.readouterr().out)
    assert "[rig_friction]" in report["warnings"][0]


def test_a_run_beyond_a_law_of_the_rig_is_warned_about():
    laws = (
        FrictionLaw(over="tension", x=(0.0, 8.0), factor=(1.0, 1.1)),
        FrictionLaw(over="speed", x=(0.0, 0.01), factor=(1.0, 1.1)),
        SensorLaw(channel="tension_out_N", over="time", x=(0.0, 20.0), error=(0.0, 0.1)),
    )
    time = np.linspace(0.0, 10.0, 200)
    pull, moved = 5.0 + 5.0 * np.sin(time), 1e-3 * np.sin(time)
    columns = {"time_s": time, "tension_in_N": pull, "displacement_in_m": moved}
    (one,) = law_remarks(Series(columns, Rig(effects=laws)))
    assert (one.rule, one.severity) == ("beyond_law", "warn")
    assert "the law over tension ends at 8 N, the run goes to 10 N" in one.text
    inside = columns | {"tension_in_N": 0.8 * columns["tension_in_N"]}
    assert not list(law_remarks(Series(inside, Rig(effects=laws))))
