"""Figures for print: their widths, fonts and units, and that bands and strokes are those of the results."""

import io
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from tests.view.conftest import analysed, arc
from tests.view.layout import faults
from tests.worked_finding import worked_finding
from tssgeom.stream import Frame, FrameResult
from tssgeom.view.figures.paper import paper_figures
from tssgeom.view.figures.plots import COLUMN, INK, SMALLEST, VECTOR, figure, markup, save, style
from tssgeom.view.figures.restyle import subscripts
from tssgeom.view.figures.shapes import figures_of, route_figure, time_figure, transmission_figure
from tssgeom.view.figures.style import StyleName, choose, for_print
from tssgeom.view.report.entry import ReportEntry, moments, series_of, strokes
from tssgeom.view.report.finding import figures_of as figures_of_finding
from tssgeom.view.report.report import section
from tssgeom.view.samples import route_samples, tension_se

_POINTS_PER_MM = 72 / 25.4


@pytest.fixture(scope="module")
def figures(still: list[FrameResult], moving: list[FrameResult]) -> dict[str, Callable[[], Figure]]:
    """Every figure that a command draws, by name."""
    of_run = figures_of(moving[3], series_of(moving))
    finding = replace(worked_finding("unknown"), effects=())
    return {
        **{f"still {name}": draw for name, draw in figures_of(still[0], None).items()},
        **{f"run {name}": draw for name, draw in of_run.items()},
        **{f"found {name}": draw for name, draw in figures_of_finding(finding).items()},
        **{f"paper {name}": draw for name, draw in paper_figures().items()},
    }


def test_a_shape_has_four_figures_and_a_run_those_of_its_history_too(figures):
    assert [name.split()[1] for name in figures if name.startswith("still")] == [
        "route",
        "tension",
        "curvature",
        "resolution",
    ]
    assert {"run transmission", "run time", "found missing", "found ranking"} <= figures.keys()


def test_every_figure_fits_a_column_or_a_page_and_is_legible(figures):
    for name, draw in figures.items():
        drawing = draw()
        assert drawing.get_figwidth() * 25.4 == pytest.approx(85) or drawing.get_figwidth() * 25.4 == (
            pytest.approx(170)
        ), name
        texts = [text for text in drawing.findobj(Text) if text.get_visible() and text.get_text().strip()]
        assert min(text.get_fontsize() for text in texts) >= SMALLEST, name


def test_no_text_covers_another_or_leaves_its_figure_and_no_panel_is_empty(figures):
    for name, draw in figures.items():
        assert faults(draw()) == [], name


def test_the_check_of_a_layout_detects_each_fault():
    with figure((COLUMN, 1.0)) as drawing:
        axes = drawing.subplots()
        axes.annotate("one", (0.5, 0.5))
        axes.annotate("other", (0.5, 0.5))
        axes.text(3.0, 0.5, "beyond")
        drawing.set_layout_engine("none")
    words = " ".join(faults(drawing))
    assert "'one' and 'other' overlap" in words
    assert "'beyond' leaves the figure" in words
    assert "is empty" in words


@pytest.mark.parametrize("style", ["dark", "paper"])
def test_every_style_keeps_texts_apart_and_legible(figures, style: StyleName):
    choose(style)
    with for_print():
        by_name = {name: draw() for name, draw in figures.items() if not name.startswith("paper")}
    choose("light")
    for name, drawing in by_name.items():
        assert faults(drawing) == [], name
        assert min(text.get_fontsize() for text in drawing.findobj(Text)) >= SMALLEST, name
        width = drawing.get_figwidth() * 25.4
        if style == "paper":
            assert min(abs(width - 88.0), abs(width - 180.0)) < 1e-6, name
            assert not any(axes.get_title(loc=loc) for axes in drawing.axes for loc in ("left", "center"))
        else:
            assert max(drawing.get_facecolor()[:3]) < 0.15, name
            labels = [label for axes in drawing.axes for label in (axes.xaxis.label, axes.yaxis.label)]
            assert min(max(to_rgb(label.get_color())) for label in labels) > 0.5, name


def test_the_arrow_of_a_note_is_bright_on_a_dark_ground():
    choose("dark")
    with for_print(), figure((COLUMN, COLUMN)) as drawing:
        bracket = {"arrowstyle": "|-|", "color": INK}
        drawing.subplots().annotate("", (0.0, 0.0), (0.0, 1.0), arrowprops=bracket)
    choose("light")
    (arrow,) = (one.arrow_patch for one in drawing.findobj(Annotation))
    assert max(arrow.get_edgecolor()[:3]) > 0.5


def test_a_symbol_has_its_subscript_and_a_name_of_a_run_none():
    assert subscripts("T_in [N], ΔT_out") == r"$\mathregular{T_{in}}$ [N], $\mathregular{ΔT_{out}}$"
    assert subscripts("half_slow, tension_in_N") == "half_slow, tension_in_N"


def test_the_curve_angle_over_time_has_its_band_where_the_route_moves(moving: list[FrameResult]) -> None:
    run = series_of(moving)
    assert run.angle is not None
    panels = time_figure(run).axes
    assert [axes.get_ylabel() for axes in panels] == ["T [N]", "δ [mm]", "Φ [°]"]
    (band,) = panels[2].collections
    np.testing.assert_allclose(panels[2].lines[0].get_ydata(), np.degrees(run.angle))
    assert np.ptp(band.get_paths()[0].vertices[:, 1]) > np.ptp(np.degrees(run.angle))
    assert len(time_figure(replace(run, angle=None, angle_se=None)).axes) == 2


def test_times_of_a_calendar_count_from_the_first(moving: list[FrameResult]) -> None:
    run = series_of(moving)
    last = time_figure(replace(run, time=run.time + 1.7e9)).axes[-1]
    first = run.time[0] + 1.7e9
    assert last.get_xlabel() == f"time t [s] after {first:.3f} s"
    ticks = last.get_xticks() - first
    assert [last.xaxis.get_major_formatter()(tick + first) for tick in ticks] == [
        f"{round(tick, 6):g}" for tick in ticks
    ]
    assert (np.abs(ticks / np.diff(ticks)[0] - np.round(ticks / np.diff(ticks)[0])) < 1e-3).all()
    assert time_figure(run).axes[-1].get_xlabel() == "time t [s]"


def test_every_visible_axis_has_a_unit(figures):
    unitless = {"found residual", "found heat", "found ranking", "found missing"}  # runs, words and ratios
    for name in figures.keys() - unitless:
        for axes in figures[name]().axes:
            labels = [axes.get_xlabel(), axes.get_ylabel()] if axes.axison else []
            assert all(re.search(r"\[.+\]$", label) for label in labels if label), (name, labels)
            assert not labels or any(labels), name


def test_numbers_in_a_figure_of_a_page_keep_their_digits() -> None:
    with figure((COLUMN, 2.0)) as drawing:
        axes = drawing.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0])
        axes.set_yticks([0.0, 0.0125, 0.025], ["0.0000", "0.0125", "0.0250"])
        axes.set_title("0.00432 mm")
    page = markup(drawing)
    assert re.findall(r">(0\.0\d+)( mm)?<", page) == [
        ("0.0000", ""),
        ("0.0125", ""),
        ("0.0250", ""),
        ("0.00432", " mm"),
    ]
    assert re.search(r'd="[^"]*\.\d{3}', page) is None  # a hundredth of a point is enough for a line


@pytest.mark.parametrize("angle", [0.001, 0.5, 1.6, -1.6, 3.1, 5.0])
def test_the_names_of_both_ends_lie_inside_the_figure(angle: float) -> None:
    drawing = route_figure(analysed([Frame(arc(80, angle, 0.5 / abs(angle)))])[0])
    FigureCanvasAgg(drawing).draw()
    names = [text for text in drawing.findobj(Text) if text.get_text() in ("proximal", "distal")]
    assert len(names) == 2
    for name in names:
        box = name.get_window_extent()
        assert box.x0 >= 0.0
        assert box.x1 <= drawing.bbox.width
        assert box.y0 >= 0.0
        assert box.y1 <= drawing.bbox.height


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5, 4.0])
def test_on_a_closed_route_each_name_is_nearest_to_its_own_end(turn: float) -> None:
    circle = arc(80, 6.1, 0.5 / 6.1) @ np.array(
        [[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
    )
    drawing = route_figure(analysed([Frame(circle)])[0])
    FigureCanvasAgg(drawing).draw()
    names = {text.get_text(): text for text in drawing.findobj(Text)}
    axes = drawing.axes[0]
    ends = axes.transData.transform(axes.lines[0].get_xydata()[[0, -1]])
    for own, name in enumerate(("proximal", "distal")):
        box = names[name].get_window_extent()
        corners = np.array([[box.x0, box.y0], [box.x1, box.y1]])
        off = [np.linalg.norm(np.maximum(np.maximum(corners[0] - end, end - corners[1]), 0)) for end in ends]
        assert off[own] < off[1 - own]
    foot = min(names[letter].get_window_extent().y0 for letter in "xyz")
    assert foot >= axes.child_axes[0].bbox.y1


def test_a_recording_without_a_drive_has_no_empty_panel_over_it(moving: list[FrameResult]) -> None:
    held = analysed([Frame(each.frame.points, each.frame.time) for each in moving])
    assert "transmission" not in figures_of(held[3], series_of(held))
    entry = ReportEntry.of("held", held, timed=True)
    assert "over T_in" not in re.sub(r"<[^>]*>", "", section(entry, held[3]))
    assert "highest peaks" not in section(entry, held[3])


@pytest.mark.parametrize("name", ["still route", "run transmission", "found heat"])
def test_a_pdf_holds_its_fonts_at_its_true_width_and_an_svg_needs_none(figures, name, tmp_path):
    for ending in VECTOR:
        save(figures[name](), tmp_path / f"figure.{ending}")
    page = (tmp_path / "figure.pdf").read_bytes()
    width = 85 if name == "still route" else 170
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+)", page)
    assert box is not None
    assert float(box[1]) == pytest.approx(width * _POINTS_PER_MM, abs=0.01)
    assert b"/FontFile2" in page
    assert b"/Type3" not in page
    picture = (tmp_path / "figure.svg").read_text("utf-8")
    assert "<text" not in picture
    assert "<image" not in picture
    assert f'width="{width * _POINTS_PER_MM:.2f}'[:10] in picture


def test_the_band_of_the_tension_ends_at_the_reported_error(
    still: list[FrameResult], moving: list[FrameResult]
) -> None:
    for result in (still[0], moving[2], moving[3]):
        spread = tension_se(result, route_samples(result))
        assert spread[0] == pytest.approx(0.0, abs=1e-2 * result.transmission.tension_in)
        # the error of T_out is that of the pieces, the band that of the profile along the route
        error = result.transmission.tension_out_se
        assert spread[-1] == pytest.approx(error, rel=0.35)


def test_what_did_not_slide_yet_is_as_uncertain_as_what_held_it(moving: list[FrameResult]) -> None:
    released = moving[4]
    spread = tension_se(released, route_samples(released))
    assert np.isfinite(spread).all()
    assert (spread >= 0).all()


def test_strokes_cut_a_run_at_each_turn_of_its_drive():
    drive = np.array([0.0, 2.0, 5.0, 5.0, 3.0, 1.0, 1.0, 4.0])
    assert strokes(drive) == [(0, 3), (3, 6), (6, 7)]
    assert strokes(np.array([1.0])) == []
    assert strokes(np.ones(4)) == [(0, 3)]


def test_every_turn_of_a_long_run_is_drawn(moving: list[FrameResult]) -> None:
    run = series_of(moving)
    long = replace(
        run,
        **{
            name: np.repeat(getattr(run, name), 700)
            for name in ("time", "tension_in", "tension_out", "tension_out_se", "elongation", "elongation_se")
        },
    )
    drawn_ones = moments(long)
    assert len(drawn_ones) <= 520
    assert long.tension_in[drawn_ones].max() == run.tension_in.max()
    turns = {edge for edge, _ in strokes(long.tension_in)}
    assert turns <= set(drawn_ones.tolist())


def test_pulls_and_releases_have_a_name_each_and_measured_values_stand_beside(
    moving: list[FrameResult],
) -> None:
    run = replace(series_of(moving), tension_out_measured=np.linspace(1.0, 2.0, len(moving)))
    output, elongation = transmission_figure(run).axes
    labels = [str(line.get_label()) for line in output.lines]
    assert labels == ["pulling", "releasing", "measured"]
    assert "measured" not in [str(line.get_label()) for line in elongation.lines]
    pulled = output.lines[0].get_xydata()
    np.testing.assert_allclose(pulled[:, 0], [2.0, 6.0, 10.0, 12.0])


def test_the_report_has_a_chart_for_each_panel_in_print(moving: list[FrameResult]) -> None:
    entry = ReportEntry.of("run", moving, timed=True)
    assert entry.representative is not None
    page = section(entry, entry.representative)
    figures = [draw() for draw in figures_of(entry.representative, entry.series).values()]
    titles = [axes.get_title(loc="left") for drawing in figures for axes in drawing.axes]
    assert page.count("<svg") == len([title for title in titles if title])
    (angle,) = {match for title in titles for match in re.findall(r"Φ = .*", title)}
    assert angle in page


def test_axes_of_a_page_have_the_position_that_matplotlib_gives_them(figures):
    once, twice = (figures["run transmission"]() for _ in range(2))
    markup(once)
    with style():
        twice.savefig(io.StringIO(), format="svg")
    for mine, theirs in zip(once.axes, twice.axes, strict=True):
        np.testing.assert_allclose(mine.get_position().bounds, theirs.get_position().bounds, rtol=1e-9)
