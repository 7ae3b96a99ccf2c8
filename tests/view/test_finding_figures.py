"""Figures of a finding: they have its numbers, with units, and partial data have figures too."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.worked_finding import worked_finding
from tssgeom.identify.finding import Finding, LawCurve
from tssgeom.view.figures.finding import (
    judged,
    law_figure,
    missing_figure,
    ranking_figure,
    residual_figure,
    transmission_figure,
)
from tssgeom.view.figures.heat_map import along_figure, heat_figure
from tssgeom.view.figures.plots import BLUE
from tssgeom.view.figures.restyle import subscripts
from tssgeom.view.samples import evenly


def only(finding: Finding, *channels: str) -> Finding:
    """Return a finding whose runs measured these channels only."""
    kept = [
        replace(
            trace,
            **{
                name: {key: values for key, values in getattr(trace, name).items() if key in channels}
                for name in ("measured", "before", "after", "sigma")
            },
        )
        for trace in finding.traces
    ]
    return replace(finding, traces=tuple(kept))


def lines(drawing: Figure, axes: int = 0) -> dict[str, np.ndarray]:
    return {str(line.get_label()): line.get_xydata() for line in drawing.axes[axes].lines}


def test_loops_show_measured_before_and_after_of_the_held_out_run():
    finding = worked_finding()
    trace = judged(finding)
    assert trace.held_out
    drawing = transmission_figure(finding)
    output, elongation = (lines(drawing, k) for k in (0, 1))
    for when in ("measured", "before", "after"):
        reported = getattr(trace, when)
        kept = evenly(len(trace.time), 90) if when == "measured" else np.arange(len(trace.time))
        pairs = [reported["tension_in_N"][kept], reported["tension_out_N"][kept]]
        np.testing.assert_array_equal(output[when].T, pairs)
        np.testing.assert_allclose(elongation[when][:, 1], 1e3 * reported["elongation_m"][kept], rtol=1e-12)
    labels = [axes.get_ylabel() for axes in drawing.axes]
    assert labels == [subscripts(label) for label in ("T_out [N]", "δ [mm]")]


def test_where_the_input_tension_is_not_measured_the_models_stands_in():
    finding = only(worked_finding(), "elongation_m")
    (axes,) = transmission_figure(finding).axes
    measured = next(line for line in axes.lines if line.get_label() == "measured")
    drive = judged(finding).tension_in
    np.testing.assert_array_equal(measured.get_xdata(), drive[evenly(len(drive), 90)])


@pytest.mark.parametrize("channel", ["tension_in_N", "tension_out_N", "elongation_m"])
def test_one_channel_is_enough_for_every_figure(channel):
    finding = only(worked_finding(), channel)
    assert len(transmission_figure(finding).axes) == 1
    assert len(residual_figure(finding).axes) == 1


def test_residuals_are_measured_less_simulated_in_the_units_of_figures():
    finding = worked_finding()
    drawing = residual_figure(finding)
    wanted = [subscripts(label) for label in ("ΔT_in [N]", "ΔT_out [N]", "Δδ [mm]")]
    assert [axes.get_ylabel() for axes in drawing.axes] == wanted
    first = finding.traces[0]
    left = 1e3 * (first.measured["elongation_m"] - first.after["elongation_m"])
    np.testing.assert_allclose(lines(drawing, 2)["after"][:, 1], left, rtol=1e-12)


def test_runs_side_by_side_have_their_span_of_time_and_are_called_held_out_once():
    finding = worked_finding()
    held = replace(finding.traces[-1], run="worn, held-out cycles", held_out=True)
    (first, *_, last) = residual_figure(replace(finding, traces=(*finding.traces[:-1], held))).axes
    spans = [text.get_text() for text in last.get_xticklabels(minor=True)]
    assert spans == [f"0 to {np.ptp(trace.time):.3g} s" for trace in finding.traces]
    assert [text.get_text() for text in first.texts][-1] == held.run


def test_a_model_has_one_style_in_loops_and_residuals():
    both = [draw(worked_finding()).axes[0].lines for draw in (transmission_figure, residual_figure)]
    for when in ("before", "after"):
        first, second = (next(one for one in every if one.get_label() == when) for every in both)
        assert first.get_color() == second.get_color()
        assert first.get_linestyle() == second.get_linestyle()


def test_without_an_effect_only_one_model_is_drawn():
    assert set(lines(transmission_figure(worked_finding("none")))) == {"measured", "model"}


def test_the_heat_map_leaves_out_what_never_occurs_and_keeps_the_rest():
    finding = worked_finding()
    empty = np.hstack([finding.heat.power, np.full((len(finding.heat.rows), 1), np.nan)])
    columns = ("pull_to_release 1.5–5.2 N", *finding.heat.columns[1:], "hold 0.0–8.0 N")
    heat = replace(finding.heat, columns=columns, power=empty)
    axes, bar = heat_figure(replace(finding, heat=heat)).axes
    assert axes.get_xticklabels()[0].get_text() == "pull to release 1.5–5.2 N"
    assert bar.get_ylabel().endswith("[1]")
    assert len(axes.get_xticks()) == len(finding.heat.columns)
    assert axes.get_yticklabels()[0].get_text() == subscripts("T_in half_slow")
    assert len(axes.texts) == np.isfinite(finding.heat.power).sum()


def test_misfit_along_the_route_is_drawn_for_every_route_with_the_detected_bend():
    drawn = lines(along_figure(worked_finding()))
    assert {"half_circle", "setup_a", "chain", "detected bend"} <= set(drawn)
    assert drawn["detected bend"][0, 0] == pytest.approx(210.0)
    assert "detected bend" not in lines(along_figure(worked_finding("unknown")))


def test_the_ranking_marks_what_was_chosen_and_the_threshold():
    axes = ranking_figure(worked_finding()).axes[0]
    shades = [patch.get_facecolor() for patch in axes.patches]
    assert [patch.get_width() for patch in axes.patches] == [412.3, 31.0, 12.0]
    assert sum(np.allclose(shade, to_rgba(BLUE)) for shade in shades) == 1
    assert lines(ranking_figure(worked_finding()))["threshold"][0, 0] == 41.5


def test_bars_of_the_ranking_are_what_orders_it():
    finding = worked_finding()
    held = replace(finding.ranking[1], evidence=replace(finding.ranking[1].evidence, held_out_fall=100.0))
    against = replace(
        finding.ranking[2], evidence=replace(finding.ranking[2].evidence, held_out_fall=-np.inf)
    )
    axes = ranking_figure(replace(finding, ranking=(finding.ranking[0], held, against))).axes[0]
    assert [patch.get_width() for patch in axes.patches] == [412.3, 131.0, 0.0]
    assert axes.texts[-1].get_text() == "contradicted"
    assert "held-out runs included" in axes.get_xlabel()


def to_rgba(text: str) -> tuple[float, ...]:
    return (*(int(text[k : k + 2], 16) / 255 for k in (1, 3, 5)), 1.0)


def test_the_shape_of_what_is_missing_has_its_unit():
    axes = missing_figure(worked_finding("unknown")).axes[0]
    assert axes.get_xlabel() == "tension [N]"
    assert "62 %" in axes.get_title(loc="left")


@pytest.mark.parametrize(
    ("name", "label"),
    [("sensor_curve", "reading less truth [°]"), ("load_over_position", "torque against the joint [mN·m]")],
)
def test_what_a_law_over_the_joint_angle_adds_is_said_by_its_axis(name, label):
    x = np.linspace(-0.5, 0.5, 5)
    unit = "rad" if name == "sensor_curve" else "N·m"
    law = LawCurve("joint_angle_rad", x, 0.01 * x**2, 0.009 * x**2, 0.011 * x**2, unit)
    known = worked_finding()
    axes = law_figure(replace(known, effects=(replace(known.effects[0], names=(name,), law=law),))).axes[0]
    assert axes.get_ylabel() == label
