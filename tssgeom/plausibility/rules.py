"""The rules of plausibility, in one table: what is tested, why, how severe it is, and what helps.

`python docs/checks.py` writes docs/checks.md from it. Its limits are in limits.py.
"""

from __future__ import annotations

from collections.abc import Iterable

from tssgeom.core.constants import CHANCE
from tssgeom.errors import SettingsError
from tssgeom.plausibility.kinds import Remark, Rule, Severity, Subject
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.machine_rules import MACHINE_RULES


def remark(rule: str, subject: Subject, measured: str) -> Remark:
    """Return the remark that a rule is broken; `measured` states by what, with numbers and units."""
    row = RULES[rule]
    return Remark(rule, row.severity[subject], f"{measured}: {row.hint} [{rule}]")


def warnings_of(where: object | None, remarks: Iterable[Remark]) -> list[str]:
    """Return the warnings among remarks, a line each.

    Raises SettingsError where one of them refuses; its message begins with `where`, unless that is None.
    """
    listed = list(remarks)
    for each in listed:
        if each.severity == "refuse":
            raise SettingsError(each.text if where is None else f"{where}: {each.text}")
    return [each.text for each in listed]


_REFUSED: dict[Subject, Severity] = {"run": "refuse"}
_WARNED: dict[Subject, Severity] = {"run": "warn"}
_L = LIMITS
RULES: dict[str, Rule] = {
    "inverted_cell": Rule(
        "more than half of a tension's readings are below zero, and the least is farther from it "
        "than the most",
        _REFUSED,
        "A tendon only pulls.",
        "a tendon only pulls: change the sign of the column",
    ),
    "negative_tension": Rule(
        f"a tension is below zero by more than {_L.negative:.0%} of its range and {CHANCE.never:g} × "
        "its noise",
        {"run": "warn", "frame": "warn"},
        "A tendon only pulls; a cell's zero may be off.",
        "a tendon only pulls: zero the cell",
    ),
    "strain": Rule(
        f"a tension strains the tendon of the rig by more than {_L.largest_strain:.0%}",
        dict.fromkeys(("run", "frame", "command"), "refuse"),
        "No tendon recovers from that: mN stand for N, or the compliance is wrong.",
        "give newtons and metres, or mend tendon.compliance_per_N of the rig",
    ),
    "high_strain": Rule(
        f"a tension strains the tendon of the rig by more than {_L.usual_strain:.0%}",
        _WARNED,
        "Steel yields at 1 %, polymers are used to 5 %.",
        "check the unit of the tension, and tendon.compliance_per_N of the rig",
    ),
    "tension_unit": Rule(
        f"a tension varies by less than {_L.weakest_N:g} N, or reaches {_L.strongest_N:g} N",
        _WARNED,
        "kN or mN may stand for N.",
        "check the unit of the column",
    ),
    "full_scale": Rule(
        f"a tension is beyond {_L.gross:.1f} × the full scale of its sensor in the rig",
        {"run": "refuse", "command": "refuse"},
        "A cell cannot read that, and may break.",
        "give newtons, or mend full_scale of the sensor in the rig",
    ),
    "beyond_scale": Rule(
        "a tension is beyond the full scale of its sensor in the rig",
        {"run": "warn", "command": "warn"},
        "Beyond it a cell is not specified.",
        "check full_scale of the sensor in the rig",
    ),
    "temperature": Rule(
        f"a temperature is above {_L.hottest_C:g} °C or below {-_L.warmest_C:g} °C",
        {"run": "refuse", "frame": "warn"},
        "Kelvin or raw counts stand for degrees Celsius.",
        "give degrees Celsius, not kelvin",
    ),
    "warm": Rule(
        f"a temperature is above {_L.warmest_C:g} °C",
        {"run": "warn", "frame": "warn"},
        "Rooms and bodies are colder; degrees Fahrenheit may stand for degrees Celsius.",
        "check that the column is in degrees Celsius, not Fahrenheit",
    ),
    "stroke": Rule(
        f"a displacement moves by more than {_L.largest_stroke:g} × the length of the route",
        dict.fromkeys(("run", "frame", "command"), "refuse"),
        "The tendon would leave its sheath: mm stand for m.",
        "give metres",
    ),
    "stretch_unit": Rule(
        f"a stretch changes by more than {_L.stretch_ratio:.0f} × what compliance and tension give, "
        f"or is more than {_L.largest_strain:.0%} of the route",
        {"run": "refuse", "frame": "warn"},
        "mm stand for m.",
        "check its unit, elongation_m or elongation_mm, or mend tendon.compliance_per_N of the rig",
    ),
    "stretch_size": Rule(
        f"a stretch changes by more than {_L.usual_stretch:g} × or less than a {_L.usual_stretch:g}th "
        "of what "
        "compliance and tension give",
        _WARNED,
        "kgf stand for N (9.8 ×), m for mm, or the compliance is wrong.",
        "check its unit and that of the tension (kgf?), or tendon.compliance_per_N of the rig",
    ),
    "tension_ratio": Rule(
        f"T_out is more than {_L.gross:.1f} × T_in while the drive pulls farther than before",
        _REFUSED,
        "Friction only takes tension; no zero of a cell is so far off.",
        "check both units (mN, kgf?), and that the columns are not exchanged",
    ),
    "channels_exchanged": Rule(
        "T_out is above T_in while the drive pulls farther than before, and below it on release",
        _REFUSED,
        "Friction takes tension from the drive to the load.",
        "exchange tension_in_N and tension_out_N",
    ),
    "tension_excess": Rule(
        f"T_out is above T_in by {_L.slight:.0%} of the range while the drive pulls farther "
        "than before",
        {"run": "warn", "frame": "warn"},
        "Friction only takes tension: a zero or a gain of a cell is wrong, or the load drives.",
        "check zero and gain of both cells",
    ),
    "apparent_friction": Rule(
        f"T_in and T_out at the peak mean a friction coefficient above {_L.largest_friction:g}, where end "
        f"fittings take {_L.fitting_share:.0%} of T_in",
        _WARNED,
        "Liners have 0.05 to 0.2, dry steel 0.3: a unit (kgf) or the angle of the route is wrong.",
        "check the unit of both tensions (kgf?), and the shape",
    ),
    "sign": Rule(
        f"a displacement or an elongation falls where the tension rises (correlation below {_L.opposite:g})",
        _REFUSED,
        "Displacements and elongations are positive where the tendon is pulled.",
        "change the sign of the column: positive where the tendon is pulled",
    ),
    "inconsistent_stretch": Rule(
        f"elongation and displacement_in less displacement_out differ by {_L.usual_error:.0%} of "
        "their range",
        _WARNED,
        "They are one quantity; docs/model.md (44).",
        "check unit, sign and zero of the three columns",
    ),
    "lag": Rule(
        f"a channel turns {_L.lag_share:.0%} of a leg before or after the drive, and {_L.lag_rows:g} "
        "rows or more",
        _WARNED,
        "Tendons answer at once; a filter or another clock delays a channel.",
        "align the channels in time",
    ),
    "two_clocks": Rule(
        f"the lag of a channel grows from turn to turn, by {2.0 * _L.lag_share:.0%} of a leg and more",
        _WARNED,
        "Two recorders with clocks of their own.",
        "bring both to one clock",
    ),
    "zero_at_rest": Rule(
        f"the first readings of a tension differ from the rig's pretension by {_L.usual_error:.0%} of "
        "the range",
        _WARNED,
        "A cell was not zeroed, or the run begins in mid-history.",
        "zero the cell, or mend tendon.pretension_N of the rig",
    ),
    "drive_never_turns": Rule(
        f"the drive of a run to be fitted never goes back by {_L.turn_share:.0%} of its range",
        {"run": "warn"},
        "Friction shows in the difference of pull and release.",
        "record a pull and a release",
    ),
    "unresponsive": Rule(
        f"a channel stays within ± {CHANCE.never:g} × its noise while the drive moves; "
        "displacement_out_m may, and "
        "tension_out_N that is not near zero",
        _WARNED,
        "A cable is off, or the channel is another.",
        "check the wiring and the column",
    ),
    "copied_channel": Rule(
        "two channels have the same readings in all rows",
        _WARNED,
        "Noise alone makes two sensors differ.",
        "check which columns are which",
    ),
    "clipped": Rule(
        f"{_L.clipped_rows} readings or more stay at the greatest value while another channel rises by "
        f"{_L.slight:.0%} of its range, or readings are at full scale; of angles only the latter",
        _WARNED,
        "The range of the recorder ends there.",
        "leave these cells empty, or record with a wider range",
    ),
    "frozen": Rule(
        "a channel repeats one value while the drive goes its whole range",
        _WARNED,
        "The sensor or its connection stopped; no dead zone is so wide.",
        "leave these cells empty",
    ),
    "quantised": Rule(
        f"a step of a channel is above {_L.slight:.0%} of its range, and hides its noise",
        _WARNED,
        "Digits of that size hide friction and turns.",
        "record with a finer resolution",
    ),
    "repeated_block": Rule(
        f"{_L.repeated_rows} rows or more occur twice, digit by digit, in channels that have noise",
        _WARNED,
        "Noise never repeats: a buffer was written twice.",
        "remove the repeated rows",
    ),
    "time_order": Rule(
        "time_s does not increase from row to row",
        _REFUSED,
        "Rows were mixed, or a clock was set back.",
        "times must be finite and increase: put the rows in order, each once",
    ),
    "time_jump": Rule(
        f"two rows are {_L.pause:g} × as far apart in time as most",
        _WARNED,
        "A recorder stopped, or changed its unit of time.",
        "check time_s, or cut the run there",
    ),
    "two_recorders": Rule(
        f"every tenth row or more follows the last within a {_L.pause:g}th of the usual time",
        _WARNED,
        "The rows of two recorders were merged.",
        "bring the channels to common rows",
    ),
    "spike": Rule(
        f"single readings are off both neighbours by {_L.spike:.0%} of the range",
        _WARNED,
        "A connection is loose: no drive moves so in one row.",
        "leave these cells empty",
    ),
    "missing": Rule(
        "readings of a channel are missing",
        _WARNED,
        "They are left out of fits.",
        "fill them if they were recorded",
    ),
    "no_drive": Rule(
        "a run of a campaign has neither tension_in_N nor displacement_in_m",
        {"campaign": "refuse"},
        "The model needs what the tendon was given.",
        "add a column tension_in_N or displacement_in_m",
    ),
    "no_response": Rule(
        "a run of a campaign has a drive and no other channel",
        {"campaign": "refuse"},
        "Nothing can be compared.",
        "add one of tension_out_N, elongation_m, displacement_out_m",
    ),
    "few_rows": Rule(
        f"drive and response of a run of a campaign are both there in fewer than {_L.fewest_rows} rows",
        {"campaign": "refuse"},
        "A fit needs more rows than parameters; or two recorders took turns.",
        f"give at least {_L.fewest_rows} rows, on one clock",
    ),
    "same_readings": Rule(
        "two runs of a campaign have the same readings",
        {"campaign": "warn"},
        "Noise never repeats; as fitted and held-out run they test nothing.",
        "list each measurement once",
    ),
    "hidden_bend_beyond": Rule(
        "a hidden_bend of the rig is beyond the end of the route",
        {"frame": "warn"},
        "It does nothing there.",
        "mend at_m of the effect, or the shape",
    ),
    "given_route": Rule(
        f"the rig of a machine gives a route that turns by {_L.usual_error:.0%} more or less than the shape, "
        "beyond three of its standard errors, or that is by as much shorter",
        {"frame": "warn"},
        "The numbers of the rig count: the shape may be that of another sheath, or in another unit.",
        "leave route.length_m and route.angle_rad out of the rig, or mend them or the shape",
    ),
    "frozen_frames": Rule(
        f"{_L.frozen_frames} frames repeat the points, or a tension, that varied before",
        {"frame": "warn"},
        "Noise makes frames differ: the sensor stopped.",
        "check the sensor",
    ),
    "frame_time_jump": Rule(
        f"a frame comes {_L.pause:g} × later than frames usually do",
        {"frame": "warn"},
        "A sender stopped, or changed its unit of time.",
        "check the times of the frames",
    ),
    "frame_leap": Rule(
        f"more than half of the points of a frame have moved faster than {_L.fastest_m_per_s:g} m/s",
        {"frame": "warn"},
        "A wrong unit, axis or order of the points, another route or a step of the time; the tendon was "
        "moved by it.",
        "check units, axes and order of the points and the times",
    ),
    "noise_unit": Rule(
        f"the stated noise of a coordinate is more than {_L.largest_noise:.0%} of the route",
        {"frame": "refuse"},
        "mm stand for m: no bend would be left.",
        "give metres",
    ),
    "rig_friction": Rule(
        f"the friction coefficient of a rig is above {_L.most_rig_friction:g}",
        {"rig": "warn"},
        "No pair of materials of tendon and sheath has it; a fit went astray.",
        "check friction.coefficient",
    ),
    "rig_strain": Rule(
        f"{_L.judged_N:g} N, or the pretension, strains the tendon of a rig by more than "
        f"{_L.usual_strain:.0%}",
        {"rig": "warn"},
        "Compliance is a strain for each newton, not an elongation, and not in percent.",
        "check tendon.compliance_per_N and tendon.pretension_N",
    ),
    "beyond_law": Rule(
        f"a run goes beyond the end of a law of the rig by more than {_L.slight:.0%} of its range",
        _WARNED,
        "The law was not learnt there; it is taken as constant.",
        "measure there and run discover again, or stay within",
    ),
    "rig_sensor": Rule(
        "noise or resolution of a sensor is above its full scale, or the full scale of a tension is "
        "below the "
        "pretension",
        {"rig": "warn"},
        "The sensor would measure nothing.",
        "check the unit of the sensor's numbers",
    ),
} | MACHINE_RULES  # fmt: skip
