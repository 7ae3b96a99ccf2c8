"""Parts of figures: names of alerts, measured values and spikes, panels on axes of the user."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes

from tests.adapt.cases import follow
from tests.twins import drifting_friction
from tests.view.layout import faults
from tssgeom import Arcs, compensate
from tssgeom.adapt.offline import AlertRow, FollowedRun
from tssgeom.stream import FrameResult
from tssgeom.view.figures.adapt import draw_number, followed_figure
from tssgeom.view.figures.commands import command_figure
from tssgeom.view.figures.plots import PAGE, figure, measured
from tssgeom.view.figures.route import draw_route
from tssgeom.view.figures.runs import draw_over_drive, draw_over_time
from tssgeom.view.figures.shapes import draw_angle, draw_curvature, draw_resolution, draw_tension
from tssgeom.view.quantities import ANGLE, ELONGATION, TENSION_OUT
from tssgeom.view.report.entry import series_of
from tssgeom.view.samples import at_edge


@pytest.fixture(scope="module")
def followed() -> FollowedRun:
    return follow(drifting_friction(2, 0.02), every=10, tension_out=True)


@pytest.mark.parametrize("since", [(0.05, 0.06, 0.07), (0.2, 0.4, 0.98), (0.95, 0.96, 0.97)])
def test_names_of_alerts_stand_apart_wherever_the_alerts_are(
    followed: FollowedRun, since: tuple[float, ...]
) -> None:
    begin, span = followed.time[0], np.ptp(followed.time)
    names = ("friction_drift", "", "tension_out_offset")
    alerts = tuple(
        AlertRow(begin + at * span, begin + at * span, "tension_out_N", "hold", name, "", 0.9)
        for at, name in zip(since, names, strict=True)
    )
    assert faults(followed_figure(replace(followed, alerts=alerts), followed.ends[:, 1])) == []


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("end.stiffness_Nm_per_rad", "end stiffness\n[N·m/rad]"),
        ("drive.friction_Nm", "drive friction\n[mN·m]"),
        ("drive.play_rad", "drive play\n[rad]"),
        ("tendon.compliance_per_N", "compliance\n[1/N]"),
    ],
)
def test_a_followed_number_has_its_name_without_its_unit(followed: FollowedRun, key: str, words: str) -> None:
    named = replace(followed, stretches=tuple(replace(one, keys=(key,)) for one in followed.stretches))
    with figure((PAGE, 2.0)) as drawing:
        axes = draw_number(drawing.subplots(), named, key)
    assert axes.get_ylabel() == words


def test_measured_values_are_circles_without_a_line_and_few_of_many() -> None:
    with figure((PAGE, 2.0)) as drawing:
        axes = drawing.subplots()
        measured(axes, np.arange(1000.0), np.where(np.arange(1000) % 7 == 0, np.nan, 1.0))
    (marks,) = axes.lines
    assert marks.get_linestyle() == "None"
    assert marks.get_markerfacecolor() == "none"
    assert len(marks.get_xdata()) == 90
    assert np.isfinite(marks.get_ydata()).all()


def test_a_spike_stands_at_the_edge_and_no_other_value_moves() -> None:
    model = np.linspace(0.0, 10.0, 200)
    readings = model + 0.1
    assert (at_edge(readings, model) == readings).all()
    readings[50] = 1e4
    moved = at_edge(readings, model)
    assert 10.0 < moved[50] < 16.0
    assert (np.delete(moved, 50) == np.delete(readings, 50)).all()
    assert np.isnan(at_edge(np.full(3, np.nan), model)).all()


_ALONG = (draw_curvature, draw_angle)


def test_every_panel_is_plotted_on_the_axes_that_it_gets(moving: list[FrameResult]) -> None:
    run, result = series_of(moving), moving[3]
    shapes = (draw_route, draw_tension, draw_resolution)
    draws = [lambda axes, draw=draw: draw(axes, result) for draw in shapes]
    draws += [lambda axes, draw=draw: draw(axes, result.profile, result.arcs) for draw in _ALONG]
    draws += [lambda axes, q=q: draw_over_time(axes, run, q) for q in (TENSION_OUT, ELONGATION, ANGLE)]
    draws += [lambda axes, q=q: draw_over_drive(axes, run, q) for q in (TENSION_OUT, ELONGATION)]
    for draw in draws:
        with figure((PAGE, 3.0)) as drawing:
            axes = drawing.subplots()
            returned: Axes = draw(axes)
        assert returned is axes
        assert drawing.axes[0] is axes
        assert faults(drawing) == []


@pytest.mark.parametrize("by_tension", [False, True])
def test_the_figure_of_commands_has_the_drive_the_distal_end_and_its_difference(by_tension: bool) -> None:
    time = np.linspace(0.0, 4.0, 41)
    target = (5.0 if by_tension else 0.003) * (1.0 - np.cos(np.pi * time / 2))
    column = "tension_out_N" if by_tension else "displacement_out_m"
    run = compensate(Arcs.exact([0.5], [np.pi]), {"time_s": time, column: target})
    drawing = command_figure(time, target, run.rows, by_tension=by_tension)
    assert faults(drawing) == []
    drive = drawing.axes[0].lines[0].get_ydata()
    sent = [each.tension_in if by_tension else 1e3 * each.displacement_in for each in run]
    np.testing.assert_allclose(drive, sent)
