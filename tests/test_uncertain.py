"""Numbers of a rig that are unknown or have an error."""

import math

import numpy as np
import pytest

from tssgeom.errors import SettingsError
from tssgeom.rig import Rig, read_rig, read_uncertain_rig, with_values, write_rig
from tssgeom.uncertain import UNKNOWNS, Prior, RigErrors, assumed, deviations

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


TOGETHER = """
[friction]
coefficient = { value = 0.12, sd = 0.03 }
[tendon]
compliance_per_N = { value = 3e-4, sd = 1e-5 }
pretension_N = { value = 5.0, sd = 0.5 }
[correlations]
"""


def test_errors_that_go_together_have_the_covariance_that_the_rig_states(tmp_path):
    row = '"friction.coefficient" = { "tendon.pretension_N" = -0.9, "tendon.compliance_per_N" = 0.4 }'
    _, uncertain = read_uncertain_rig(written(tmp_path, TOGETHER + row))
    keys = [each.key for each in uncertain]
    made = list(deviations(uncertain))
    assert len(made) == 2 * len(keys)
    u = np.array([[each.prior.u(one[each.key]) for each in uncertain] for one in made])
    wanted = np.eye(3)
    for other, value in (("tendon.pretension_N", -0.9), ("tendon.compliance_per_N", 0.4)):
        a, b = keys.index("friction.coefficient"), keys.index(other)
        wanted[a, b] = wanted[b, a] = value
    assert 0.5 * u.T @ u == pytest.approx(wanted, abs=1e-12)
    assert u.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)


def test_numbers_whose_errors_go_with_no_other_move_one_by_one(tmp_path):
    _, uncertain = read_uncertain_rig(written(tmp_path, TOGETHER))
    assert [list(each) for each in deviations(uncertain)] == [
        [each.key] for each in uncertain for _ in range(2)
    ]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ('"friction.coefficient" = 0.5', "no table of tables"),
        ('"friction.coefficient" = { "load.stiffness_N_per_m" = 0.5 }', "stiffness_N_per_m has no error"),
        ('"friction.coefficient" = { "tendon.pretension_N" = 1.5 }', "a number from -1 to 1"),
        ('"friction.coefficient" = { "friction.coefficient" = 0.5 }', "for two numbers"),
        (
            '"friction.coefficient" = { "tendon.pretension_N" = 0.5 }\n'
            '"tendon.pretension_N" = { "friction.coefficient" = 0.4 }',
            "stand there twice",
        ),
        (
            '"friction.coefficient" = { "tendon.pretension_N" = 0.9, "tendon.compliance_per_N" = 0.9 }\n'
            '"tendon.pretension_N" = { "tendon.compliance_per_N" = -0.9 }',
            "contradict each other",
        ),
    ],
)
def test_correlations_that_cannot_be_are_refused_with_what_to_write(tmp_path, rows, said):
    with pytest.raises(SettingsError, match=said):
        read_uncertain_rig(written(tmp_path, TOGETHER + rows))


def test_a_rig_is_written_with_its_errors_and_read_back(tmp_path):
    path, keys = tmp_path / "out.toml", ("friction.coefficient", "tendon.pretension_N")
    rig = with_values(Rig(), {"tendon.pretension_N": 8.0})
    write_rig(path, rig, (), RigErrors(keys, (0.006, 0.3), np.array([[1.0, -0.9995], [-0.9995, 1.0]])))
    assert "coefficient = { value = 0.145, sd = 0.006 }" in path.read_text()
    again, uncertain = read_uncertain_rig(path)
    assert again == rig
    one, other = uncertain if uncertain[0].key == keys[0] else uncertain[::-1]
    assert one.correlation == {keys[1]: -0.9995}
    assert other.correlation == {keys[0]: -0.9995}
    assert one.prior == assumed(keys[0], 0.145, 0.006)
