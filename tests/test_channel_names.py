"""The names of channels: quantity, unit, and the marks between them."""

import pytest

from tssgeom.channel_names import marked, numbered, quantity_of, unit_of, words_of


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("tension_in_N", "tension_in", "N"),
        ("tension_out_2_N", "tension_out_2", "N"),
        ("motor_torque_Nm", "motor_torque", "Nm"),
        ("joint_rate_rad_per_s", "joint_rate", "rad/s"),
        ("stiffness_Nm_per_rad", "stiffness", "Nm/rad"),
        ("hardening_Nm_per_rad3", "hardening", "Nm/rad3"),
        ("curvature_noise_per_m", "curvature_noise", "1/m"),
        ("frames_per_s", "frames", "1/s"),
        ("point", "point", ""),
    ],
)
def test_a_name_states_its_quantity_then_its_unit(name, quantity, unit):
    assert (quantity_of(name), unit_of(name)) == (quantity, unit)


def test_a_mark_stands_before_the_whole_unit():
    assert marked("tension_in_N", "se") == "tension_in_se_N"
    assert marked("joint_rate_rad_per_s", "target") == "joint_rate_target_rad_per_s"
    assert marked("kappa_per_m", "se") == "kappa_se_per_m"
    assert marked("point", "se") == "point_se"


def test_tendons_are_numbered_where_there_are_several():
    assert list(numbered("tension_in_N", 1)) == ["tension_in_N"]
    assert list(numbered("tension_in_N", 2)) == ["tension_in_1_N", "tension_in_2_N"]


def test_the_words_of_a_name_leave_its_unit_out():
    assert words_of("tension_out_N") == "tension out"
