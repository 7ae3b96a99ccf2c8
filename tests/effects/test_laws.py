"""Laws that are curves: beside the formulae of the library, and beside scipy."""

import math
from typing import get_args

import msgspec
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tssgeom import Arcs, core, read_rig
from tssgeom.effects import (
    KINDS,
    LAWS,
    ChannelLag,
    Creep,
    CreepLaw,
    CurvatureDependentFriction,
    FrictionDrift,
    FrictionLaw,
    LoadDependentFriction,
    LoadLaw,
    SensorLaw,
    SlackTakeUp,
    StretchLaw,
    ToeRegion,
    VelocityDependentFriction,
)
from tssgeom.effects.kinds import Hook
from tssgeom.errors import FitError, SettingsError
from tssgeom.mechanism import Drive, End
from tssgeom.plausibility.frames import unused_parts
from tssgeom.rig import Friction, Load, Rig, Tendon, write_rig
from tssgeom.tendon.bars.model import predict
from tssgeom.tendon.bars.sensors import CHANNELS

RIG = Rig(
    tendon=Tendon(compliance_per_N=2e-4, pretension_N=2.0),
    load=Load(stiffness_N_per_m=1000.0),
    friction=Friction(coefficient=0.15),
)
ROUTE = Arcs.exact([0.2, 0.3], [1.0, math.pi])
TIME = np.linspace(0.0, 60.0, 400)
RUN = {"time_s": TIME, "displacement_in_m": 0.004 * (1.0 - np.cos(TIME / 4.0))}
TENSION = np.concatenate((np.linspace(0.0, 5.0, 8), [7.0, 9.0, 11.0, 14.0]))
SPEED = np.array([0.0, 1e-5, 3e-5, 1e-4, 2e-4, 4e-4, 6e-4, 8e-4, 1e-3, 1.5e-3])
PATH = np.linspace(0.0, 0.06, 12)


def friction(over, x, factor):
    return FrictionLaw(over=over, x=tuple(map(float, x)), factor=tuple(map(float, factor)))


def stretch(of, x, y):
    return StretchLaw(of=of, x=tuple(map(float, x)), stretch=tuple(map(float, y)))


def predicted(*effects, run=RUN, **given):
    return predict(run, ROUTE, RIG, effects, **given)


ALIKE = {
    "tension": (
        LoadDependentFriction(exponent=-0.2),
        friction("tension", load := np.geomspace(1.0, 17.0, 12), (load / 10.0) ** -0.2),
    ),
    "speed": (
        VelocityDependentFriction(gain=0.08),
        friction("speed", SPEED, 1.0 + 0.08 * np.log1p(SPEED / 1e-3)),
    ),
    "travel": (
        FrictionDrift(gain=0.3, travel_m=0.02),
        friction("travel", PATH, 1.0 - 0.3 * np.expm1(-PATH / 0.02)),
    ),
    "curvature": (
        CurvatureDependentFriction(gain_m=0.012),
        friction("curvature", [0.0, 10.0, 20.0], [1.0, 1.12, 1.24]),
    ),
    "sheath": (
        ToeRegion(strain=8e-4, scale_N=2.0),
        stretch("sheath", TENSION, 8e-4 * (1.0 - np.exp(-TENSION / 2.0))),
    ),
    "distal": (
        SlackTakeUp(slack_m=5e-4, scale_N=2.0, end="distal"),
        stretch("distal", TENSION, 5e-4 * (1.0 - np.exp(-TENSION / 2.0))),
    ),
    "creep": (
        Creep(ratio=0.06, time_s=20.0),
        CreepLaw(time_s=(19.9, 20.0, 20.1), ratio=(0.02, 0.02, 0.02)),
    ),
}


@pytest.mark.parametrize("name", ALIKE)
def test_a_curve_through_points_of_a_formula_does_what_the_formula_does(name):
    formula, law = ALIKE[name]
    base, wanted, result = predicted(), predicted(formula), predicted(law)
    for channel in ("tension_in_N", "tension_out_N"):
        change = np.abs(wanted[channel] - base[channel]).max()
        assert change > 5e-3
        assert np.abs(result[channel] - wanted[channel]).max() < 0.01 * change


@pytest.mark.parametrize("over", ["arc_length", "time", "position"])
def test_a_factor_of_one_changes_nothing_and_another_one_does(over):
    x = {"arc_length": [0.0, 0.25, 0.5], "time": [0.0, 30.0, 60.0], "position": [0.0, 4e-3, 8e-3]}[over]
    base, same = predicted(), predicted(friction(over, x, [1.0, 1.0, 1.0]))
    more = predicted(friction(over, x, [1.0, 1.0, 1.5]))
    for channel in CHANNELS:
        np.testing.assert_allclose(same[channel], base[channel], atol=1e-10)
    assert np.abs(more["tension_out_N"] - base["tension_out_N"]).max() > 0.05


def test_more_friction_all_along_is_more_of_the_coefficient():
    more = predict(RUN, ROUTE, RIG, [friction("arc_length", [0.0, 0.5], [1.2, 1.2])])
    rig = Rig(tendon=RIG.tendon, load=RIG.load, friction=Friction(coefficient=0.18))
    wanted = predict(RUN, ROUTE, rig)
    np.testing.assert_allclose(more["tension_out_N"], wanted["tension_out_N"], atol=1e-9)


def test_the_path_of_the_load_is_read_at_the_load():
    law = stretch("load", [0.0, 5.0, 15.0], [0.0, 1e-3, 2e-3])
    result = predicted(law)
    out = result["tension_out_N"]
    curve = PchipInterpolator(law.x, law.stretch)
    wanted = (out - 2.0) / 1000.0 + curve(out) - curve(2.0)
    np.testing.assert_allclose(result["displacement_out_m"], wanted, atol=1e-12)


def test_a_sensor_reads_beside_the_truth_over_reading_and_time():
    bent = SensorLaw(channel="tension_out_N", over="reading", x=(0.0, 5.0, 10.0), error=(0.0, 0.1, 0.3))
    late = SensorLaw(channel="displacement_out_m", over="time", x=(0.0, 60.0), error=(0.0, 3e-4))
    base, result = predicted(), predicted(bent, late)
    error = PchipInterpolator(bent.x, bent.error)(np.clip(base["tension_out_N"], 0.0, 10.0))
    np.testing.assert_allclose(result["tension_out_N"] - base["tension_out_N"], error, atol=1e-12)
    drift = result["displacement_out_m"] - base["displacement_out_m"]
    np.testing.assert_allclose(np.diff(drift), drift[-1] / (len(TIME) - 1), atol=1e-6)


@pytest.mark.parametrize("over", ["reading", "time"])
def test_a_drive_whose_sensor_is_off_drives_by_the_truth(over):
    x = (0.0, 0.004, 0.008) if over == "reading" else (0.0, 30.0, 60.0)
    law = SensorLaw(channel="displacement_in_m", over=over, x=x, error=(0.0, 1e-4, 3e-4))
    at = (
        RUN["displacement_in_m"] if over == "reading" else np.cumsum(np.diff(TIME, prepend=TIME[0] - TIME[1]))
    )
    read = RUN["displacement_in_m"] + PchipInterpolator(x, law.error)(np.clip(at, x[0], x[-1]))
    result = predicted(law, run=RUN | {"displacement_in_m": read})
    np.testing.assert_allclose(result["tension_out_N"], predicted()["tension_out_N"], atol=2e-6)


def test_values_of_a_table_are_those_of_scipy_and_constant_beyond():
    rng = np.random.default_rng(3)
    for _ in range(100):
        n = int(rng.integers(2, 13))
        x, y = np.cumsum(rng.uniform(0.1, 1.0, n)), rng.normal(size=n)
        table = core.table_of(x, y)
        at = rng.uniform(x[0] - 1.0, x[-1] + 1.0, 50)
        wanted = PchipInterpolator(x, y)(np.clip(at, x[0], x[-1]))
        np.testing.assert_allclose(core.tabulated(table, at), wanted, rtol=1e-12, atol=1e-12)
    assert np.isnan(core.tabulated(np.full(37, 40.0), np.ones(1))).all()
    with pytest.raises(FitError, match="do not belong"):
        core.table_of(np.arange(13.0), np.arange(13.0))


def test_a_rig_file_holds_laws(tmp_path):
    laws = tuple(law for _, law in ALIKE.values() if not isinstance(law, CreepLaw | FrictionLaw))
    rig = Rig(
        effects=(friction("speed", [0.0, 1e-3], [1.0, 0.7]), CreepLaw(time_s=(5.0,), ratio=(0.1,)), *laws)
    )
    write_rig(tmp_path / "rig.toml", rig, [])
    assert read_rig(tmp_path / "rig.toml").effects == rig.effects


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: friction("speed", [0.0], [1.0]), "1 x and 1 factor: give 2 to 12"),
        (lambda: friction("speed", [0.0, 1.0], [1.0]), "2 x and 1 factor"),
        (lambda: friction("speed", [1.0, 0.0], [1.0, 1.0]), "x has to increase"),
        (lambda: friction("speed", [0.0, 1.0], [1.0, -1.0]), "factor: give 0 to 100"),
        (lambda: friction("speed", [0.0, 1.0], [1.0, math.nan]), "finite"),
        (lambda: CreepLaw(time_s=(1.0,), ratio=()), "one to 3 times"),
        (lambda: CreepLaw(time_s=(-1.0,), ratio=(0.1,)), "positive times"),
        (lambda: predicted(*2 * [friction("speed", [0.0, 1.0], [1.0, 1.0])]), "two laws over the same"),
        (lambda: predicted(stretch("sheath", [0.0, 5.0], [0.0, -1.0])), "shorter under more tension"),
        (lambda: predicted(Creep(ratio=0.1), CreepLaw(time_s=(1.0,), ratio=(0.1,))), "keep creep or"),
    ],
)
def test_a_law_that_is_none_is_refused_with_the_hint(make, said):
    with pytest.raises(SettingsError, match=said):
        make()


FALLING = {
    "time": friction("time", np.linspace(0.0, 60.0, 6), np.linspace(1.0, 0.5, 6)),
    "position": friction("position", np.linspace(0.0, 0.01, 6), np.linspace(1.0, 0.5, 6)),
    "travel": FrictionDrift(gain=-0.4, travel_m=0.005),
}


@pytest.mark.parametrize("over", FALLING)
def test_friction_that_falls_acts_behind_contacts_that_stand(over):
    """A balance of all contacts, which friction by speed needs, gives the same as a step without it.

    After a short way back contacts near the drive stand; farther on friction of the pull acts, and falls.
    """
    alone = predicted(FALLING[over])
    balanced = predicted(FALLING[over], VelocityDependentFriction(gain=1e-9))
    # friction by speed cuts a step after a turn; contacts that are taken for at rest are 0.18 N off and more
    assert alone["tension_in_N"] == pytest.approx(balanced["tension_in_N"], abs=0.02)
    assert alone["tension_out_N"] == pytest.approx(balanced["tension_out_N"], abs=1e-3)


@pytest.mark.parametrize(
    "law",
    [
        friction("travel", (0.0, 0.01, 0.03), (1.2, 1.0, 0.8)),
        friction("time", (0.0, 20.0, 40.0), (1.2, 1.0, 0.8)),
        friction("speed", (0.0, 5e-4, 1e-3), (1.2, 1.0, 0.8)),
    ],
    ids=["travel", "time", "speed"],
)
def test_friction_that_follows_from_the_steps_before_needs_no_second_pass(law):
    one = predict(RUN, ROUTE, RIG, (law,))
    bent = ToeRegion(strain=1e-15, scale_N=1.0)  # its stretch is curved, so that passes go on
    several = predict(RUN, ROUTE, RIG, (law, bent))
    for name in ("tension_in_N", "tension_out_N"):
        np.testing.assert_allclose(one[name], several[name], rtol=0.0, atol=1e-9)


def test_laws_act_on_a_machine():
    joint = End(kind="joint", radius_m=0.01)
    load = LoadLaw(x=(0.0, 1.0), torque=(0.0, 0.1))
    those = (friction("tension", [0.0, 5.0], [1.0, 0.9]), stretch("sheath", [0.0, 5.0], [0.0, 1e-3]), load)
    sensor = SensorLaw(channel="joint_angle_rad", over="time", x=(0.0, 60.0), error=(0.0, 0.1))
    of = {"drive": Drive(kind="pair", radius_m=0.01), "end": joint}
    late = ChannelLag(lag_s=0.1, channel="tension_out_N")
    assert not list(unused_parts(Rig(effects=(*those, sensor), **of), fitted=False))
    assert any("channel_lag" in each for each in unused_parts(Rig(effects=(late,), **of), fitted=False))
    with pytest.raises(SettingsError, match="no channel 'tension_out_N': tension_in_1_N, "):
        Rig(effects=(msgspec.structs.replace(sensor, channel="tension_out_N"),), **of)
    assert {kind.hook for kind in (KINDS | LAWS).values()} <= set(get_args(Hook))
