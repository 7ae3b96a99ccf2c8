"""Drawings of the explanation, made at each build into docs/explanation; they are not in git."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from sphinx.application import Sphinx

from tssgeom import Arcs, MovingRoute, Rig, analyse, simulate
from tssgeom.view.figures.restyle import set_subscripts

FOLDER = Path(__file__).parents[1] / "explanation"
sys.path.insert(0, str(Path(__file__).parents[1]))

from panel import FIRST, GREY, INK, READ, Panel, arch, spring  # noqa: E402 - below docs, as the line above


def transmission() -> Figure:
    """Draw drive, sheath and load with the names of what acts."""
    figure = Figure(figsize=(6.4, 2.9))
    panel = Panel(figure.add_axes((0.0, 0.0, 1.0, 1.0)), "", "")
    panel.axes.set(xlim=(0.0, 10.0), ylim=(0.3, 4.8))
    y = 1.5
    panel.line([[0.5, y], [2.4, y]], FIRST, 2.0)
    panel.sheath(arch(2.4, 6.6, y, 2.2), FIRST)
    panel.line([[6.6, y], [7.9, y]], FIRST, 2.0)
    panel.line(spring(7.9, 9.3, y), INK, 1.2)
    panel.wall(9.3, y)
    for x, name in ((1.45, "drive: T_in, x_in"), (7.25, "load: T_out, x_out")):
        panel.arrow((x + 0.5, y - 0.4), (x - 0.5, y - 0.4), READ)
        panel.axes.text(x, y - 0.75, name, color=READ, size=9, ha="center")
    panel.axes.text(4.5, 1.95, "sheath: bent by Φ in all", color=GREY, size=9, ha="center")
    panel.axes.text(4.5, 4.3, "friction in each bend: dT = −μ T dφ", color=INK, size=9, ha="center")
    return figure


def decay() -> Figure:
    """Draw the tension over arc length and over curve angle."""
    figure = Figure(figsize=(7.0, 2.6), layout="constrained")
    length, angle = np.array([0.15, 0.1, 0.2, 0.05]), np.array([0.0, np.pi, 0.0, np.pi / 2])
    s, phi = np.append(0, np.cumsum(length)), np.append(0, np.cumsum(angle))
    fine = np.linspace(0, s[-1], 400)
    at = np.interp(fine, s, phi)
    left, right = figure.subplots(1, 2, sharey=True)
    left.plot(1e3 * fine, 15 * np.exp(-0.145 * at), color=FIRST)
    for k in (1, 3):
        left.axvspan(1e3 * s[k], 1e3 * s[k + 1], color="0.9")
    left.set(xlabel="arc length s [mm]; grey: bends", ylabel="tension [N]", ylim=(0, 16))
    right.plot(at, 15 * np.exp(-0.145 * at), color=FIRST)
    right.set(xlabel="accumulated curve angle φ [rad]")
    return figure


def release() -> Figure:
    """Draw the tension over the angle while the drive releases, and the loop of both ends."""
    figure = Figure(figsize=(7.0, 2.8), layout="constrained")
    along, loop = figure.subplots(1, 2)
    route = MovingRoute(np.array([0.0]), [Arcs.exact(0.5, 2 * np.pi)])
    time = np.linspace(0.0, 3.0, 301)
    pull = np.interp(time, [0, 1, 2, 3], [0, 15, 0.5, 15])
    run = simulate(time, route, Rig(), tension_in=pull)
    out = [moment.transmission.tension_out for moment in run]
    loop.plot(pull, out, color=FIRST)
    loop.set(xlabel="T_in [N]", ylabel="T_out [N]", ylim=(-0.2, 7.2))
    loop.annotate("pull", (9, 2.6), color=INK)
    loop.annotate("dead zone", (6.5, 6.3), color=READ)
    loop.annotate("release", (2.4, 3.9), color=INK)
    phi = np.linspace(0.0, 2 * np.pi, 300)
    for now, colour in ((15.0, FIRST), (10.0, "C1"), (6.0, "C2")):
        tension = np.minimum(15 * np.exp(-0.145 * phi), now * np.exp(0.145 * phi))
        along.plot(phi, tension, color=colour, label=f"T_in = {now:g} N")
        if now < 15:
            front = np.log(15 / now) / (2 * 0.145)
            along.plot(front, now * np.exp(0.145 * front), "o", color=READ)
    along.annotate("slip front", (1.6, 13.2), color=READ)
    along.set(xlabel="curve angle φ [rad]", ylabel="tension [N]", ylim=(0, 16.5))
    along.legend(loc="lower right", fontsize=8)
    return figure


def noise() -> Figure:
    """Draw points with noise, the polygon through them, and the fit."""
    figure = Figure(figsize=(7.0, 2.8), layout="constrained")
    s = np.linspace(0.0, 0.25, 60)
    exact = np.column_stack((np.sin(2 * np.pi * s), 1 - np.cos(2 * np.pi * s), 0 * s)) / (2 * np.pi)
    points = exact + np.random.default_rng(5).normal(0.0, 1e-3, exact.shape)
    route, angle = figure.subplots(1, 2, width_ratios=(1, 1.2))
    result = analyse(points)
    route.plot(*(1e3 * points[:, :2].T), ".-", color="0.6", linewidth=0.7, label="sensed points")
    route.plot(*(1e3 * result.route.position[:, :2].T), color=FIRST, linewidth=2, label="fitted route")
    route.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    route.legend(fontsize=8)
    turns = np.diff(points, axis=0)
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    between = np.degrees(np.arccos(np.clip(np.sum(turns[1:] * turns[:-1], axis=1), -1, 1)))
    angle.plot(1e3 * s[1:-1], np.cumsum(between), color="0.6", label="sum of the turns of the points")
    profile = result.profile
    phi, band = np.degrees(profile.phi), np.degrees(1.96 * profile.phi_se)
    angle.plot(1e3 * profile.s, phi, color=FIRST, label="fitted route, with 95 % band")
    angle.fill_between(1e3 * profile.s, phi - band, phi + band, color=FIRST, alpha=0.3)
    angle.axhline(90, color=INK, linestyle=":", label="true angle of the whole route")
    angle.set(xlabel="arc length [mm]", ylabel="curve angle [°]", yscale="log", ylim=(0.8, None))
    angle.legend(fontsize=8, loc="lower right")
    return figure


DRAWINGS: dict[str, Callable[[], Figure]] = {
    "transmission": transmission,
    "decay": decay,
    "release": release,
    "noise": noise,
}


def draw(app: Sphinx) -> None:
    """Draw what is not there or older than this file."""
    for name, drawing in DRAWINGS.items():
        path = FOLDER / f"{name}.svg"
        if not path.exists() or path.stat().st_mtime < Path(__file__).stat().st_mtime:
            with rc_context({"figure.constrained_layout.use": False}):  # the gallery sets it
                figure = drawing()
                set_subscripts(figure)
                figure.savefig(path)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the drawings to Sphinx."""
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
