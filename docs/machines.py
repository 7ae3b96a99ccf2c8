"""Draw the machines that a rig file can describe, and write the table of what is assumed of unknown numbers.

python docs/machines.py            # writes docs/machines.png, and the table of docs/machines.md
python docs/machines.py --check    # are both those of the code?
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from panel import (
    EDGE,
    FIRST,
    GREY,
    HIGH,
    INK,
    PALE,
    READ,
    SECOND,
    THIRD,
    WIDE,
    Panel,
    arch,
    on_circle,
    spring,
)
from PIL import Image

from tssgeom.channel_names import unit_of_key
from tssgeom.io.formats.columns import CHANNELS, MACHINE_CHANNELS
from tssgeom.rig import Rig, Sensor
from tssgeom.uncertain import UNKNOWNS

PICTURE, PAGE = (Path(__file__).with_suffix(ending) for ending in (".png", ".md"))
BEGIN, END = "<!-- assumed: written by docs/machines.py -->\n", "<!-- assumed: end -->\n"


def one_with_a_spring(panel: Panel) -> None:
    """Draw one tendon between a linear drive and a spring."""
    y = 2.35
    panel.axes.add_patch(Rectangle((0.55, y - 0.32), 0.75, 0.64, fc=PALE, ec=INK, lw=1.0, zorder=4))
    panel.line([[1.3, y], [2.95, y]], FIRST)
    panel.sheath(arch(2.95, 6.25, y, 1.55), FIRST)
    panel.line([[6.25, y], [7.6, y]], FIRST)
    panel.line(spring(7.6, 9.25, y), INK, 1.0)
    panel.wall(9.25, y)
    panel.channel(2.1, y + 0.45, "tension_in_N", at=(2.1, y))
    panel.channel(7.05, y + 0.45, "tension_out_N", at=(6.95, y))
    for x, name in ((1.75, "displacement_in_m"), (7.5, "displacement_out_m")):
        panel.channel(x, y - 1.1, name)
        panel.arrow((x + 0.45, y - 0.75), (x - 0.45, y - 0.75), READ)
    panel.key(8.2, y + 1.2, "load.stiffness_N_per_m", to=(8.42, y + 1.02, 8.42, y + 0.28))
    panel.key(4.5, 4.3, "route.length_m", "right")
    panel.key(4.7, 4.3, "route.angle_rad", "left")
    panel.key(4.6, y - 0.35, "friction.coefficient")
    panel.key(4.6, y - 0.75, "tendon.compliance_per_N")
    panel.key(4.6, y - 1.15, "tendon.pretension_N")


def one_with_a_joint(panel: Panel) -> None:
    """Draw one tendon from a motor's pulley to a joint with a spring and a weight."""
    motor, joint, big, small = (1.45, 2.6), (6.5, 2.75), 0.75, 0.6
    top = motor[1] + big
    panel.pulley(motor, big, -35.0)
    panel.pulley(joint, small, 200.0)
    panel.line([[motor[0], top], [2.9, top]], FIRST)
    panel.sheath(arch(2.9, 5.0, top, 0.7), FIRST)
    panel.line([[5.0, top], [joint[0], top]], FIRST)
    link = on_circle(joint, 1.75, np.array([-42.0]))[0]
    panel.line([joint, link], INK, 3.0)
    panel.axes.plot([joint[0]] * 2, [joint[1] - 0.65, joint[1] - 1.75], color=GREY, lw=0.8, ls=(0, (3, 2)))
    panel.axes.add_patch(Circle(tuple(link), 0.2, fc=GREY, ec=INK, lw=0.8, zorder=6))
    panel.arrow((link[0], link[1] - 0.2), (link[0], link[1] - 0.72))
    panel.turn(joint, 1.35, -90.0, -44.0, INK)
    panel.key(link[0], link[1] - 0.95, "end.gravity_Nm")
    panel.key(5.8, 1.1, "end.gravity_at_rad", "right", to=(5.86, 1.12, 6.75, 1.42))
    panel.key(5.3, 2.2, "end.radius_m", "right", to=(5.36, 2.22, 6.2, 2.63))
    panel.key(5.8, 1.65, "end.stiffness_Nm_per_rad", "right", to=(5.86, 1.67, 6.44, 2.66))
    panel.turn(joint, 0.95, 15.0, 72.0, READ)
    panel.channel(7.5, 3.45, "joint_angle_rad", "left")
    panel.turn(joint, 1.25, 12.0, -32.0, READ)
    panel.channel(7.85, 2.6, "joint_torque_Nm", "left")
    panel.turn(motor, 1.02, 60.0, 125.0, READ)
    panel.channel(0.4, 4.3, "motor_angle_rad", "left")
    panel.channel(0.4, 3.9, "motor_torque_Nm", "left")
    panel.channel(2.35, top - 0.42, "tension_in_N", "left", at=(2.5, top))
    panel.channel(5.75, top + 0.42, "tension_out_N", at=(5.75, top))
    panel.key(1.45, 1.35, "drive.radius_m", to=(1.6, 1.51, 1.8, 2.31))
    panel.key(1.45, 0.95, "drive.gear")


def two_pulleys(panel: Panel, *, slack: bool) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Draw two tendons, or a loop, from a motor's pulley to a joint; return both centres and the radius."""
    motor, joint, radius = (1.6, 2.5), (7.7, 2.5), 0.75
    panel.pulley(motor, radius, 0.0)
    panel.pulley(joint, radius, 180.0)
    for sign, colour in ((1.0, FIRST), (-1.0, SECOND if slack else FIRST)):
        y = motor[1] + sign * radius
        share = np.linspace(0.0, 1.0, 80)
        wave = 0.12 * np.sin(6.0 * np.pi * share) * np.sin(np.pi * share) ** 0.5
        panel.line(
            np.column_stack([motor[0] + (3.4 - motor[0]) * share, y + wave * (slack and sign < 0)]), colour
        )
        panel.sheath(arch(3.4, 5.9, y, 0.5 * sign), colour)
        panel.line([[5.9, y], [joint[0], y]], colour)
        panel.write(4.65, y + 0.1 * sign, f"tendon {1 if sign > 0 else 2}", colour)
    panel.line([joint, (9.45, joint[1])], INK, 3.0)
    panel.turn(motor, 1.02, 60.0, 125.0, READ)
    panel.channel(0.4, 4.05, "motor_angle_rad", "left")
    panel.turn(joint, 1.02, 10.0, 62.0, READ)
    panel.channel(9.65, 3.62, "joint_angle_rad", "right")
    return motor, joint, radius


def pair(panel: Panel) -> None:
    """Draw two tendons on one pulley, of which the second is slack at rest."""
    motor, _, radius = two_pulleys(panel, slack=True)
    top, bottom = motor[1] + radius, motor[1] - radius
    panel.channel(2.65, top + 0.8, "tension_in_1_N", "left", at=(2.95, top))
    panel.channel(6.45, top + 0.8, "tension_out_1_N", at=(6.45, top))
    panel.channel(6.7, bottom - 0.45, "tension_out_2_N", at=(6.7, bottom))
    panel.channel(1.4, bottom - 0.45, "tension_in_2_N", at=(1.6, bottom))
    for x in (2.95, 6.45):
        panel.axes.plot([x, x], [top, top + 0.63], color=READ, lw=0.5)
    panel.key(2.45, motor[1], "drive.radius_m", "left")
    panel.key(6.85, motor[1], "end.radius_m", "right")
    panel.key(2.95, 0.95, "drive.slack_m", to=(2.75, 1.13, 2.62, 1.62))
    panel.key(4.65, 2.12, "tendon.pretension_N")
    panel.key(0.4, 0.55, "drive.coupling", "left")
    panel.write(2.35, 0.55, "tendon 2 let out over tendon 1 wound up", GREY, "left")


def loop(panel: Panel) -> None:
    """Draw one cable round both pulleys, and the names of motor and encoder."""
    motor, joint, radius = two_pulleys(panel, slack=False)
    for centre, start in ((motor, 90.0), (joint, -90.0)):
        panel.line(on_circle(centre, radius, np.linspace(start, start + 180.0, 60)), FIRST)
        clamp = on_circle(centre, radius, np.array([start + 90.0]))[0]
        panel.axes.add_patch(Circle(tuple(clamp), 0.13, fc=INK, lw=0, zorder=6))
    panel.channel(0.4, 4.45, "motor_current_A", "left")
    panel.key(0.4, 1.25, "drive.play_rad", "left", to=(1.3, 1.4, 1.56, 2.5))
    panel.key(0.4, 0.85, "drive.friction_Nm", "left")
    panel.key(0.4, 0.45, "drive.torque_constant_Nm_per_A", "left")
    panel.key(9.65, 1.25, "end.play_rad", "right", to=(8.55, 1.4, 7.78, 2.5))
    panel.write(9.65, 0.45, "the same as a pair, without slack", GREY, "right")


def segment(panel: Panel) -> None:
    """Draw three tendons, each with a drive of its own, that bend a backbone; and its section."""
    base, length, angle = (4.75, 2.55), 2.9, np.radians(55.0)
    share = np.linspace(0.0, 1.0, 60)
    middle = np.array(base) + length / angle * np.column_stack(
        [np.sin(angle * share), 1.0 - np.cos(angle * share)]
    )
    across = np.column_stack([-np.sin(angle * share), np.cos(angle * share)])
    panel.line(middle, EDGE, 6.0)
    rows = ((0.32, 0.5, 3.7, FIRST), (-0.16, 0.0, 2.85, SECOND), (-0.32, -0.5, 2.0, THIRD))
    for k, (side, there, y, colour) in enumerate(rows):
        panel.axes.add_patch(Rectangle((0.4, y - 0.2), 0.5, 0.4, fc=PALE, ec=INK, lw=1.0, zorder=4))
        panel.line([[0.9, y], [3.1, y]], colour)
        ramp = (base[1] + there - y) * (0.5 - 0.5 * np.cos(np.pi * share))
        panel.sheath(np.column_stack([3.1 + 1.2 * share, y + ramp]), colour)
        panel.line(np.vstack([[4.3, base[1] + there], middle + side * across]), colour, 1.2)
        panel.channel(1.05, y + 0.3, f"tension_in_{k + 1}_N", "left", at=(1.3, y))
    for at in (0, 20, 40, 59):
        panel.line([middle[at] + 0.4 * across[at], middle[at] - 0.4 * across[at]], GREY, 1.6)
    tip = middle[-1] + 0.6 * np.array([np.cos(angle), np.sin(angle)])
    panel.line([middle[-1], tip], INK, 1.0)
    panel.axes.scatter(*tip, s=26, color=READ, lw=0, zorder=8)
    for k, axis in enumerate("xyz"):
        panel.channel(tip[0] + 0.3, tip[1] + 0.1 - 0.38 * k, f"tip_{axis}_m", "left")
    corner = (base[0] + length / angle * np.tan(0.5 * angle), base[1])
    dashed = np.array([base, (corner[0] + 1.6, corner[1]), corner, middle[-1]])
    panel.axes.plot(*dashed.T, color=GREY, lw=0.8, ls=(0, (3, 2)))
    panel.turn(corner, 0.9, 0.0, 53.0, READ)
    panel.channel(corner[0] + 1.0, base[1] + 0.3, "bending_x_rad", "left")
    panel.channel(0.4, 1.25, "displacement_in_3_m", "left")
    panel.arrow((1.75, 1.58), (0.95, 1.58), READ)
    panel.key(5.45, 4.2, "end.length_m", "right", to=(5.5, 4.1, 6.05, 2.98))
    panel.key(7.1, 4.4, "end.marker_m", "right", to=(7.15, 4.35, 7.32, 4.18))
    panel.key(4.75, 1.25, "end.stiffness_Nm_per_rad", to=(4.9, 1.4, 5.3, 2.5))
    section, radius = (8.7, 1.2), 0.5
    panel.axes.add_patch(Circle(section, radius, fc=PALE, ec=EDGE, lw=1.0, zorder=3))
    for degrees, (_, _, _, colour) in zip((90.0, 210.0, 330.0), rows, strict=True):
        spot = on_circle(section, radius, np.array([degrees]))[0]
        panel.line([section, spot], GREY, 0.8)
        panel.axes.add_patch(Circle(tuple(spot), 0.1, color=colour, lw=0, zorder=6))
    panel.turn(section, 0.28, 90.0, 205.0, INK)
    panel.write(8.7, 1.93, "x, 0°", GREY)
    panel.key(8.0, 1.25, "end.radius_m", "right", to=(8.05, 1.25, 8.48, 1.08))
    panel.key(9.65, 0.45, "end.tendon_angles_deg", "right")


def blocked(panel: Panel) -> None:
    """Draw one tendon whose far end a load cell holds."""
    motor, radius = (1.45, 2.35), 0.75
    top = motor[1] + radius
    panel.pulley(motor, radius, -35.0)
    panel.line([[motor[0], top], [2.9, top]], FIRST)
    panel.sheath(arch(2.9, 5.7, top, 0.9), FIRST)
    panel.line([[5.7, top], [7.7, top]], FIRST)
    panel.axes.add_patch(Rectangle((7.7, top - 0.25), 0.8, 0.5, fc=PALE, ec=INK, lw=1.0, zorder=4))
    panel.line([[8.5, top], [9.0, top]], INK, 2.2)
    panel.wall(9.0, top, 0.75)
    panel.turn(motor, 1.02, 60.0, 125.0, READ)
    panel.channel(0.4, 4.3, "motor_angle_rad", "left")
    panel.channel(0.4, 3.9, "motor_torque_Nm", "left")
    panel.channel(2.35, top - 0.42, "tension_in_N", "left", at=(2.5, top))
    panel.channel(8.1, top + 0.6, "tension_out_N", at=(8.1, top))
    panel.key(1.45, 1.1, "drive.radius_m", to=(1.6, 1.26, 1.8, 2.06))
    for k, error in enumerate(("zero", "gain", "lag_s")):
        panel.key(8.9, 1.9 - 0.4 * k, f"sensors.tension_out_N.{error}", "right")
    panel.axes.plot([8.1, 8.1], [2.1, top - 0.25], color=GREY, lw=0.6)


PANELS = (
    (one_with_a_spring, "One tendon, a spring", 'drive.kind = "tendon"   end.kind = "spring"'),
    (one_with_a_joint, "One tendon, a joint", 'drive.kind = "tendon"   end.kind = "joint"'),
    (pair, "A pair on one pulley, a joint", 'drive.kind = "pair"   end.kind = "joint"'),
    (loop, "A cable loop, a joint", 'drive.kind = "loop"   end.kind = "joint"'),
    (segment, "Three tendons of a segment", 'drive.kind = "tendons"   end.kind = "segment"'),
    (blocked, "A blocked end", 'drive.kind = "tendon"   end.kind = "blocked"'),
)


def draw() -> tuple[Figure, dict[str, list[str]]]:
    """Draw a panel for each machine; return the figure, and the names that it shows."""
    wide, high, head = 4.5, 4.5 * HIGH / WIDE, 0.42
    rows = (len(PANELS) + 1) // 2
    figure = Figure(figsize=(2 * wide, rows * high + head), dpi=200, facecolor=PALE)
    whole = rows * high + head
    names: dict[str, list[str]] = {"keys": [], "channels": []}
    top = 1.0 - 0.5 * head / whole
    legend = ((0.02, INK, "keys of the rig file"), (0.2, READ, "channels of a run; arrows: positive"))
    for x, colour, text in legend:
        figure.text(x, top, text, size=8.0, color=colour, va="center", weight="bold")
    for k, (paint, title, kinds) in enumerate(PANELS):
        corner = (0.5 * (k % 2), 1.0 - (head + (k // 2 + 1) * high) / whole, 0.5, high / whole)
        panel = Panel(figure.add_axes(corner), title, kinds)
        paint(panel)
        names["keys"] += panel.keys
        names["channels"] += panel.channels
    return figure, {kind: sorted(set(each)) for kind, each in names.items()}


def assumed() -> str:
    """Return the table of what is assumed of a number that is "unknown"."""
    head = "| key | centre | 95 % between | unit |\n|---|---|---|---|\n"
    return head + "".join(_rows())


def _rows() -> Iterator[str]:
    for key, prior in UNKNOWNS.items():
        *tables, name = key.split(".")
        low, high = prior.value(-1.96), prior.value(1.96)
        table = "sensors.NAME" if tables == ["sensors"] else ".".join(tables)
        unit = unit_of_key(key)
        yield f"| `[{table}] {name}` | {prior.centre:g} | {low:.2g} and {high:.2g} | {unit} |\n"


def with_table(page: str) -> str:
    """Return the page with the table of the code."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n{assumed()}\n{END}{rest.partition(END)[2]}"


def wrong(names: dict[str, list[str]]) -> Iterator[str]:
    """Say which names of the picture the program does not read, and whether picture or page are old."""
    known = msgspec.to_builtins(Rig())
    for key in names["keys"]:
        if not _is_key(key, known):
            yield f"{key} is no key of the rig file"
    for channel in names["channels"]:
        if channel not in CHANNELS and channel not in MACHINE_CHANNELS:
            yield f"{channel} is no channel of a run"
    with Image.open(PICTURE) as picture:
        if json.loads(picture.info.get("names", "{}")) != names:
            yield f"{PICTURE.name} shows other names: run python docs/machines.py"
    page = PAGE.read_text(encoding="utf-8")
    if page != with_table(page):
        yield f"{PAGE.name} has another table of what is assumed: run python docs/machines.py"


def _is_key(key: str, known: dict[str, Any]) -> bool:
    table, *_, name = key.split(".")
    if table == "sensors":
        return name in Sensor.__struct_fields__
    return name in known.get(table, {})


def main() -> int:
    """Write the picture and the table, or check them."""
    figure, names = draw()
    if sys.argv[1:] == ["--check"]:
        said = list(wrong(names))
        sys.stderr.write("".join(f"{line}\n" for line in said))
        return int(bool(said))
    figure.savefig(PICTURE, metadata={"names": json.dumps(names), "Software": ""})
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
