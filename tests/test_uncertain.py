"""Numbers of a rig that are unknown or have an error."""

import math

import pytest

from tssgeom.errors import SettingsError
from tssgeom.rig import read_rig, read_uncertain_rig, with_values
from tssgeom.uncertain import UNKNOWNS, Prior, assumed

TEXT = """
[friction]
coefficient = { value = 0.12, sd = 0.03 }
[drive]
kind = "pair"
radius_m = 0.005
[end]
kind = "joint"
radius_m = "unknown"
[[effects]]
name = "backlash"
width_m = "unknown"
[sensors.joint_angle_rad]
lag_s = "unknown"
"""


def written(tmp_path, text):
    path = tmp_path / "rig.toml"
    path.write_text(text)
    return path


def test_values_and_unknowns_are_read_with_what_is_assumed_of_them(tmp_path):
    rig, uncertain = read_uncertain_rig(written(tmp_path, TEXT))
    by_key = {each.key: each for each in uncertain}
    assert list(by_key) == [
        "friction.coefficient",
        "end.radius_m",
        "effects[0].width_m",
        "sensors.joint_angle_rad.lag_s",
    ]
    assert rig.friction.coefficient == 0.12
    assert by_key["friction.coefficient"].stated
    assert by_key["friction.coefficient"].prior.sd == pytest.approx(0.25, abs=0.01)
    assert by_key["end.radius_m"].prior == UNKNOWNS["end.radius_m"]
    assert rig.end.radius_m == UNKNOWNS["end.radius_m"].centre
    changed = with_values(rig, {"effects[0].width_m": 1e-3, "sensors.joint_angle_rad.lag_s": 0.3})
    assert changed.effects[0].width_m == 1e-3
    assert changed.sensors["joint_angle_rad"].lag_s == 0.3
    with pytest.raises(SettingsError, match="effects"):
        with_values(rig, {"effects[0].width_m": 5.0})


def test_commands_that_need_a_value_refuse_what_is_unknown_and_take_what_has_an_error(tmp_path):
    with pytest.raises(SettingsError, match=r"end\.radius_m, .*lag_s is unknown: give a value, or find it"):
        read_rig(written(tmp_path, TEXT))
    known = "[friction]\ncoefficient = { value = 0.12, sd = 0.03 }\n"
    assert read_rig(written(tmp_path, known)).friction.coefficient == 0.12


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("[friction]\ncoefficient = { value = 0.1, sd = 0 }", r"friction\.coefficient = .*sd > 0"),
        ('[friction]\ncoefficient = { value = "x", sd = 1 }', "friction.coefficient"),
        ('[shape]\nnoise_mm = "unknown"', "shape.noise_mm cannot be unknown"),
        ("[friction]\ncoefficient = { value = 0.1, sdx = 1 }", "Expected `float`"),
        ('[[effects]]\nname = "backlash"\nwidth_mm = "unknown"', r"effects\[0\]\.width_mm cannot be unknown"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_key(tmp_path, text, reported):
    with pytest.raises(SettingsError, match=reported):
        read_uncertain_rig(written(tmp_path, text))


def test_what_is_positive_stays_so():
    prior = assumed("friction.coefficient", 0.1, 0.1)
    assert prior.log
    assert 0.0 < prior.value(-3.0) < prior.value(0.0) == 0.1
    assert prior.u(prior.value(1.3)) == pytest.approx(1.3)
    assert not assumed("end.gravity_at_rad", 0.1, 0.1).log
    assert Prior(0.0, 1.0, log=False).value(-2.0) == -2.0
    assert math.isclose(assumed("x", 2.0, 0.02).sd, 0.01, rel_tol=1e-3)


def test_unknown_play_and_friction_of_a_motor_are_before_its_gear(tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text(
        '[drive]\nradius_m = 0.01\ngear = 20.0\nplay_rad = "unknown"\nfriction_Nm = "unknown"\n', "utf-8"
    )
    priors = {each.key: each.prior for each in read_uncertain_rig(rig)[1]}
    assert priors["drive.play_rad"].centre == pytest.approx(20.0 * UNKNOWNS["drive.play_rad"].centre)
    assert priors["drive.friction_Nm"].centre == pytest.approx(UNKNOWNS["drive.friction_Nm"].centre / 20.0)
    assert priors["drive.play_rad"].sd == UNKNOWNS["drive.play_rad"].sd
