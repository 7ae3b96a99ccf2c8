"""Figures 4 to 8 of the paper, drawn from the model; its measured offset in grey."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.route.pieces import Arcs
from tssgeom.tendon import paper
from tssgeom.tendon.history import History, driven, joined
from tssgeom.view.figures.plots import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    PAGE,
    PURPLE,
    SKY,
    SOFT,
    figure,
    note,
    titles,
)

_T_IN, _T_OUT, _DELTA = "input tension T_in [N]", "output tension T_out [N]", "elongation δ [mm]"
_PHASES = (
    ("1 pulling", BLUE),
    ("2 pulling to releasing", ORANGE),
    ("3 releasing", GREEN),
    ("4 releasing to pulling", PURPLE),
)


def paper_figures() -> Mapping[str, Callable[[], Figure]]:
    """Return the functions that draw each figure, by name."""
    return {
        "figure_4": figure_4,
        "figure_5": figure_5,
        "figure_6": figure_6,
        "figure_7": figure_7,
        "figure_8": figure_8,
    }


def figure_4() -> Figure:
    """Tensions and displacements over time, for one pull and release at 0.5 mm/s."""
    run = paper.figure_4()
    with figure((PAGE, 2.7)) as drawing:
        tension, moved = drawing.subplots(1, 2)
        tension.plot(run.time, run.ends.tension_in, color=INK, label="T_in")
        tension.plot(run.time, run.ends.tension_out, color=BLUE, linestyle=(0, (5, 1.5)), label="T_out")
        _shade_dead_zone(tension, run)
        titles(tension, "(a) Tension, half circle, 0.5 mm/s", "time t [s]", "tension [N]")
        moved.plot(run.time, 1e3 * run.displacement_in, color=INK, label="proximal end")
        moved.plot(
            run.time, 1e3 * run.displacement_out, color=BLUE, linestyle=(0, (5, 1.5)), label="distal end"
        )
        moved.plot(run.time, 1e3 * run.ends.elongation, color=ORANGE, label="elongation δ")
        titles(moved, "(b) Displacement against a spring of 1 N/mm", "time t [s]", "displacement [mm]")
        for axes in (tension, moved):
            axes.legend(loc="upper left")
            axes.set_xlim(0, run.time[-1])
            axes.set_ylim(0, None)
    return drawing


def _shade_dead_zone(axes: Axes, run: paper.OverTime) -> None:
    peak = int(np.argmax(run.ends.tension_in))
    still = run.ends.tension_out >= run.ends.tension_out[peak] - 1e-9
    begin, end = float(run.time[peak]), float(run.time[np.flatnonzero(still)[-1]])
    axes.axvspan(begin, end, color=FAINT, linewidth=0)
    note(axes, "dead zone\n15 → 6.03 N", (end + 0.6, 12.2), color=INK)


def figure_5() -> Figure:
    """Draw the four phases of repeated cycles on the half circle."""
    with figure((PAGE, 2.9)) as drawing:
        transmission, elongation = drawing.subplots(1, 2)
        for name, colour, run in _phases():
            transmission.plot(run.tension_in, run.tension_out, color=colour, label=name)
            elongation.plot(run.tension_in, 1e3 * run.elongation, color=colour)
            linear = run.tension_in >= paper.LINEAR_FROM - 1e-9
            elongation.plot(
                run.tension_in[linear],
                1e3 * (run.elongation[linear] + paper.OFFSET),
                color=SOFT,
                linewidth=1.1,
                linestyle=(0, (4, 2)),
            )
        transmission.legend(loc="lower right", borderaxespad=0.2)
        note(transmission, "× 0.634", (10.4, 7.2), ha="right")
        note(transmission, "× 1.577", (2.9, 5.2), ha="right")
        titles(transmission, "(a) Transmission, half circle", _T_IN, _T_OUT)
        note(elongation, "model + 1.69 mm,\nas measured above 4 N", (8.7, 2.35))
        titles(elongation, "(b) Elongation, half circle", _T_IN, _DELTA)
        _from_zero(transmission, elongation)
    return drawing


def _phases() -> list[tuple[str, str, History]]:
    """Cut the second of two cycles between 2 N and 15 N at its turning points and dead zones."""
    low = 2.0
    down = low * math.exp(2 * paper.RIG.friction.coefficient * math.pi)
    knee = paper.PEAK * math.exp(-2 * paper.RIG.friction.coefficient * math.pi)
    legs = [(paper.PEAK, knee), (knee, low), (low, down), (down, paper.PEAK)]
    before = [paper.PEAK]
    whole = []
    for start, stop in legs:
        leg = np.linspace(start, stop, 60)
        run = driven([*before, *leg], paper.HALF_CIRCLE, paper.RIG)
        skip = len(before)
        whole.append(History(run.tension_in[skip:], run.tension_out[skip:], run.elongation[skip:]))
        before.append(stop)
    order = (3, 0, 1, 2)
    return [(*_PHASES[k], whole[leg]) for k, leg in enumerate(order)]


def figure_6() -> Figure:
    """Setups A and B: the same transmission, another elongation."""
    tension_in = paper.cycle()
    a, b = (driven(tension_in, route, paper.RIG) for route in (paper.SETUP_A, paper.SETUP_B))
    with figure((PAGE, 2.9)) as drawing:
        transmission, elongation = drawing.subplots(1, 2)
        transmission.plot(tension_in, a.tension_out, color=BLUE, linewidth=3.2, label="A: half circle first")
        transmission.plot(tension_in, b.tension_out, color=ORANGE, linewidth=1.2, label="B: loop first")
        elongation.plot(tension_in, 1e3 * a.elongation, color=BLUE)
        elongation.plot(tension_in, 1e3 * b.elongation, color=ORANGE)
        _bracket(elongation, 1e3 * b.elongation.max(), 1e3 * a.elongation.max())
        transmission.legend(loc="lower right")
        titles(transmission, "(a) Transmission, Φ = 3π in both", _T_IN, _T_OUT)
        titles(elongation, "(b) Elongation", _T_IN, _DELTA)
        _from_zero(transmission, elongation)
    return drawing


def figure_7() -> Figure:
    """Draw what a perturbation does on pulling, without and with the added curve."""
    bent = paper.perturbed(paper.perturbation())
    pairs = [
        ("without remedy", BLUE, paper.HALF_CIRCLE, bent),
        ("with remedy", ORANGE, joined(paper.REMEDY, paper.HALF_CIRCLE), joined(paper.REMEDY, bent)),
    ]
    with figure((PAGE, 2.9)) as drawing:
        transmission, elongation, change = drawing.subplots(1, 3)
        for name, colour, calm, disturbed in pairs:
            _draw_pair((transmission, elongation, change), name, colour, (calm, disturbed))
        note(change, "0.256", (15.2, 0.256), color=BLUE)
        note(change, "0.103", (15.2, 0.103), color=ORANGE)
        transmission.plot([], [], color=SOFT, linestyle=(0, (4, 2)), label="perturbed")
        transmission.legend(loc="upper left", handlelength=2.0, borderaxespad=0.0)
        titles(transmission, "(a) Transmission", _T_IN, _T_OUT)
        titles(elongation, "(b) Elongation", _T_IN, _DELTA)
        titles(change, "(c) Change of δ", _T_IN, "|Δδ| [mm]")
        _from_zero(transmission, elongation, change)
        change.set_xlim(0, 18.2)
    return drawing


def _draw_pair(axes: tuple[Axes, Axes, Axes], name: str, colour: str, routes: tuple[Arcs, Arcs]) -> None:
    pull = np.linspace(0.0, paper.PEAK, 151)
    calm, bent = (driven(pull, route, paper.RIG) for route in routes)
    for run, style, label in ((calm, "-", name), (bent, (0, (4, 2)), None)):
        axes[0].plot(pull, run.tension_out, color=colour, linestyle=style, label=label)
        axes[1].plot(pull, 1e3 * run.elongation, color=colour, linestyle=style)
    axes[2].plot(pull, 1e3 * (calm.elongation - bent.elongation), color=colour)


def figure_8() -> Figure:
    """Draw the scaling factor over the angle of the added curve, and its inverse on release."""
    angle = np.linspace(0.0, 4 * math.pi, 200)
    with figure((PAGE, 2.9)) as drawing:
        pulling, releasing = drawing.subplots(1, 2)
        for friction, colour, style in zip(
            paper.FRICTIONS,
            (SKY, BLUE, GREEN, PURPLE),
            ((0, (1, 1)), "-", (0, (5, 1.5)), (0, (7, 1.5, 1.5, 1.5))),
            strict=True,
        ):
            s = paper.scaling_factor(angle, friction)
            for axes, value in ((pulling, s), (releasing, 1 / s)):
                axes.plot(angle / math.pi, value, color=colour, linestyle=style, label=f"μ = {friction:g}")
        _mark_remedy(pulling, releasing)
        titles(pulling, "(a) Pulling scales by S = exp(−μβ)", "angle of the added curve β [π rad]", "S [1]")
        titles(releasing, "(b) Releasing amplifies by 1/S", "angle of the added curve β [π rad]", "1/S [1]")
        releasing.set_yscale("log")
        releasing.set_yticks([1, 2, 5, 10, 20, 40], ["1", "2", "5", "10", "20", "40"])
        releasing.minorticks_off()
        pulling.set_ylim(0, 1.02)
        pulling.legend(loc="upper right", ncols=2, columnspacing=1.2)
        for axes in (pulling, releasing):
            axes.set_xlim(0, 4)
    return drawing


def _mark_remedy(pulling: Axes, releasing: Axes) -> None:
    s = float(paper.scaling_factor(2 * math.pi, paper.RIG.friction.coefficient))
    for axes, value in ((pulling, s), (releasing, 1 / s)):
        axes.plot([2.0], [value], marker="o", markersize=6, color=ORANGE, zorder=5)
    _point_at(pulling, "figure 7: S = 0.402", (2.0, s), (1.75, 0.68))
    _point_at(releasing, "1/S = 2.487", (2.0, 1 / s), (2.5, 1.35))


def _point_at(axes: Axes, text: str, target: tuple[float, float], position: tuple[float, float]) -> None:
    arrow = {"arrowstyle": "-", "color": ORANGE, "linewidth": 0.8, "shrinkB": 4}
    axes.annotate(text, target, position, color=ORANGE, fontsize=7.5, arrowprops=arrow)


def _bracket(axes: Axes, low: float, high: float) -> None:
    x = paper.PEAK + 0.35
    axes.annotate(
        "",
        (x, low),
        (x, high),
        arrowprops={"arrowstyle": "|-|,widthA=0.25,widthB=0.25", "color": INK, "linewidth": 0.9},
    )
    note(axes, "0.34 mm", (x + 0.2, 0.5 * (low + high)), color=INK)
    axes.set_xlim(0, paper.PEAK + 2.9)


def _from_zero(*all_axes: Axes) -> None:
    for axes in all_axes:
        axes.set_xlim(0, max(15.4, axes.get_xlim()[1]) if axes.get_xlim()[1] > 17 else 15.4)
        axes.set_ylim(0, None)
        axes.set_xticks(range(0, 16, 3))
