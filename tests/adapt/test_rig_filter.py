"""The ensemble of tendons: exact where all is linear, tendons as `predict` has them, and what it refuses."""

import msgspec
import numpy as np
import pytest

from tssgeom.adapt.drift_rate import DRIFT
from tssgeom.adapt.followed import FollowedNumber, followed_numbers, straight_lines, with_numbers
from tssgeom.adapt.readings import Moment, Readings
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.errors import SettingsError
from tssgeom.rig import Load, Rig, Sensor, Tendon, read_rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import edges
from tssgeom.tendon.bars.model import model_of, predict, setup_of
from tssgeom.uncertain import Follow

ARCS = Arcs.exact([0.3, 0.4, 0.3], [2.0, 0.0, 3.0])
RIG = Rig(
    tendon=Tendon(pretension_N=3.0),
    load=Load(stiffness_N_per_m=1500.0),
    sensors={"tension_in_N": Sensor(noise=0.03), "tension_out_N": Sensor(noise=0.03)},
)


def number(key, value, sd, hourly=0.0):
    return FollowedNumber(key, value, sd, hourly, -np.inf, np.inf)


@pytest.mark.parametrize("drive", ["displacement_in_m", "tension_in_N"])
def test_members_are_the_tendons_of_predict(drive):
    time = np.arange(300) * 0.02
    run = {"time_s": time, "displacement_in_m": 0.003 * (1.0 - np.cos(time))}
    known = predict(run, ARCS, RIG)
    run[drive] = known[drive]
    edge, numbers = edges(ARCS, 30), [number("friction.coefficient", 0.145, 1e-12)]
    lines = straight_lines(RIG, numbers, np.array([0.145]), ARCS, edge)
    block = model_of(setup_of(RIG), ARCS, "displacement_in_m", edge).plant.block
    np.testing.assert_allclose(lines.plant, block)
    one = RigFilter(msgspec.structs.replace(RIG, sensors={}), numbers, ARCS)
    for i in range(len(time)):
        value = float(run[drive][i])
        by_position = drive == "displacement_in_m"
        given = Readings(displacement_in=value) if by_position else Readings(tension_in=value)
        ends = one.step(Moment(float(time[i]), ARCS, given)).ends
        assert ends[1] == pytest.approx(known["tension_out_N"][i], abs=1e-6)
        assert ends[0] == pytest.approx(known["tension_in_N"][i], abs=1e-6)


def test_a_member_steps_as_it_does_alone_whatever_those_before_it_do():
    numbers = [number("friction.coefficient", 0.145, 0.03)]
    one = RigFilter(RIG, numbers, ARCS)
    for i, position in enumerate((1e-3, 3e-3, 2.8e-3, 2.9e-3)):
        moment = Moment(0.1 * i, ARCS.scaled(angle=1.0 + 0.01 * i), Readings(5.0, position))
        one.step(moment)
        for back in (0.0, 5e-5, 5e-4):
            all_of, read = np.arange(len(one.members)), np.full((len(one.members), 1), position - back)
            ends = one._stepped(one.now, all_of, read, moment, 0.1, 0.1).ends
            alone = [
                one._stepped(one.now, all_of[j : j + 1], read[:1], moment, 0.1, 0.1).ends[0] for j in all_of
            ]
            np.testing.assert_allclose(ends, alone, rtol=1e-9, atol=1e-12)  # residuals are below 1e-10


def test_straight_lines_are_the_plant_of_other_numbers():
    keys = ("friction.coefficient", "tendon.compliance_per_N", "route.angle_gain", "backlash.width_m")
    values, steps = (0.145, 3.16e-4, 1.0, 1e-4), (0.01, 1e-5, 0.03, 5e-5)
    numbers = [number(key, value, step) for key, value, step in zip(keys, values, steps, strict=True)]
    edge = edges(ARCS, 30)
    lines = straight_lines(RIG, numbers, np.array(values), ARCS, edge)
    for i, key in enumerate(keys):
        rig = with_numbers(RIG, {**dict(zip(keys, values, strict=True)), key: values[i] + steps[i]})
        bent = Arcs.exact(ARCS.length, rig.route.angle_gain * ARCS.angle)
        plant = model_of(setup_of(rig), bent, "displacement_in_m", edge).plant.block
        np.testing.assert_allclose(lines.plant + steps[i] * lines.slope[i], plant, rtol=2e-4, atol=1e-12)


def test_drift_spreads_the_numbers_and_nothing_else():
    one = RigFilter(RIG, [number("friction.coefficient", 0.145, 0.01, 0.02)], ARCS)
    first = one.step(Moment(0.0, ARCS, Readings(displacement_in=0.004)))
    later = one.step(Moment(900.0, ARCS, Readings(displacement_in=0.004)))
    expected = np.sqrt(DRIFT.prior @ DRIFT.shares) * 0.02 * 0.5  # as likely as it is at the start
    assert later.se[0] == pytest.approx(np.hypot(first.se[0], expected), rel=1e-5)


def test_default_numbers_are_friction_and_the_zeros_that_are_measured():
    keys = [one.key for one in followed_numbers(RIG, ["tension_in_N"])]
    assert keys == ["friction.coefficient", "tension_in_offset.offset_N"]


@pytest.mark.parametrize("key", ["friction", "tendon.length", "backlash.angle", "hidden_bend.angle_rad"])
def test_what_cannot_be_followed_is_refused(key):
    rig = Rig(adapt={key: Follow(sd=0.1)})
    with pytest.raises(SettingsError, match=rf"adapt\.{key}"):
        followed_numbers(rig, [])


def test_a_rig_file_says_what_is_followed(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('[adapt]\n"friction.coefficient" = { sd = 0.01, hourly_change = 0.02 }\n')
    assert read_rig(path).adapt == {"friction.coefficient": Follow(sd=0.01, hourly_change=0.02)}
    path.write_text('[adapt]\n"friction.coefficient" = { sd = -1 }\n')
    with pytest.raises(SettingsError, match=r"adapt.*sd is -1"):
        read_rig(path)
