"""The rules on signs and units of a machine's channels: rows of the table in rules.py."""

from __future__ import annotations

from tssgeom.plausibility.kinds import Rule
from tssgeom.plausibility.limits import LIMITS

_L = LIMITS
_UNIT = 'degrees are read with --map "NAME={channel}:{unit}"'
_FACTOR = 'a negative factor reverses a column, as in --map "NAME={channel}:-{unit}"'

MACHINE_RULES: dict[str, Rule] = {
    "motor_sign": Rule(
        f"the joint turns against the motor (correlation below {_L.opposite:g}), whose torque is less where "
        "it winds than where it lets out",
        {"run": "refuse"},
        "A motor that winds tendon 1 up turns the joint to positive angles, and overcomes friction.",
        "change the sign of motor_angle_rad; " + _FACTOR.format(channel="motor_angle", unit="rad"),
    ),
    "joint_sign": Rule(
        f"the joint turns against the motor, or against tendon 1 (correlation below {_L.opposite:g})",
        {"run": "refuse"},
        "Tendon 1 pulls the joint to positive angles.",
        "change the sign of joint_angle_rad, and of joint_torque_Nm with it; "
        + _FACTOR.format(channel="joint_angle", unit="rad"),
    ),
    "joint_unit": Rule(
        f"the joint moves, but by less than {_L.least_turn_rad:g} rad, or by more than a turn",
        {"run": "warn"},
        "Radians may stand for degrees, or degrees for radians: an unknown lever arm takes up the factor.",
        "check the unit of joint_angle_rad: " + _UNIT.format(channel="joint_angle", unit="deg"),
    ),
    "torque_sign": Rule(
        "the torque of the motor is less where it winds than where it lets out, at the same angle and load "
        f"(correlation with its direction below {_L.opposite:g})",
        {"run": "warn"},
        "Friction takes torque from the motor, whichever way it turns.",
        "change the sign of motor_torque_Nm, unless the load moves the motor; "
        + _FACTOR.format(channel="motor_torque", unit="Nm"),
    ),
    "load_sign": Rule(
        f"the torque of the motor falls where that on the joint rises (correlation below {_L.opposite:g} "
        "beside angle and direction)",
        {"run": "warn"},
        "joint_torque_Nm is positive where it acts against a positive angle, and the motor has to hold it.",
        "change the sign of joint_torque_Nm; " + _FACTOR.format(channel="joint_torque", unit="Nm"),
    ),
    "tendon_directions": Rule(
        "a segment does not bend to where the tendons of the rig pull it, but as surely to another side",
        {"run": "warn"},
        "A tendon bends the segment towards itself: the base is turned, mirrored, or tendons are exchanged.",
        "mend end.tendon_angles_deg of the rig, or the signs of the columns",
    ),
}
