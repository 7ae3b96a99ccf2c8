import numpy as np

from tssgeom.settings import Rig
from tssgeom.shape.arcs import Arcs
from tssgeom.stream import Frame, FrameResult, process
from tssgeom.view.drawn import drawn
from tssgeom.view.words import piece_labels, piece_table, summary


def test_pieces_are_labelled_by_number_angle_and_radius() -> None:
    angle = np.array([0.0, np.pi / 4, np.pi, 0.01])
    arcs = Arcs.exact(np.array([0.2, 0.0847 * np.pi / 4, 2.0 * np.pi, 0.5]), angle)
    assert piece_labels(arcs) == [
        "1 · straight",
        "2 · 45.0° · r 84.7 mm",
        "3 · 180° · r 2.00 m",
        "4 · 0.6° · r 50.00 m",
    ]


def test_summary_says_length_angle_tensions_elongation_and_warnings(still: list[FrameResult]) -> None:
    text = summary("still", still[0], timed=False)
    seen = still[0].transmission
    for part in (
        f"L = {1e3 * still[0].arcs.total_length:.1f} mm",
        f"Φ = {np.degrees(still[0].arcs.total_angle):.1f}° ± ",
        "T_in = 15.00 N",
        f"T_out = {seen.tension_out:.2f} ± {seen.tension_out_se:.2f} N",
        f"δ = {1e3 * seen.elongation:.3f} ± ",
        *still[0].warnings,
    ):
        assert part in text


def test_summary_tells_how_far_the_dead_zone_still_reaches(moving: list[FrameResult]) -> None:
    turned = next(result for result in moving if result.transmission.dead_zone)
    width = turned.transmission.dead_zone_width
    assert f"T_in has to fall by another {width:.2f} N" in summary("run", turned, timed=True)


def test_summary_of_a_straight_route_names_no_radius() -> None:
    line = np.outer(np.linspace(0, 0.5, 40), [1.0, 0.0, 0.0])
    (result,) = process([Frame(line)], Rig(), tension_in=0.0)
    assert isinstance(result, FrameResult)
    assert "no bend" in summary("line", result, timed=False)


def test_table_has_a_row_for_each_piece_and_ends_with_tension_out(still: list[FrameResult]) -> None:
    rows = piece_table(still[0].arcs, drawn(still[0])).splitlines()[2:]
    assert len(rows) == len(still[0].arcs.length)
    assert rows[-1].split("|")[-2].strip() == f"{still[0].transmission.tension_out:.2f}"
