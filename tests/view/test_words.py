import numpy as np

from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.stream import Frame, FrameResult
from tssgeom.view.samples import route_samples
from tssgeom.view.wording import angle_with_error, piece_labels, piece_table, summary, with_error


def test_a_standard_error_has_two_digits_and_its_value_the_same_decimals() -> None:
    assert with_error(2.55123, 0.0041, 2) == "2.5512 ± 0.0041"
    assert with_error(2.55123, 0.41, 2) == "2.55 ± 0.41"
    assert with_error(180.04, 12.3, 1) == "180 ± 12"
    assert with_error(0.25, 0.06, 2, "+") == "+0.250 ± 0.060"
    assert angle_with_error(np.pi, np.radians(0.27)) == "180.00° ± 0.27°"


def test_an_error_that_is_nothing_beside_the_value_has_a_bound() -> None:
    assert with_error(9.51, 3.2e-7, 2) == "9.51 ± < 0.001"
    assert with_error(9.51, 0.0, 2) == "9.51 ± 0"
    assert with_error(9.51, np.inf, 2) == "9.51 ± inf"


def test_pieces_are_labelled_by_number_angle_and_radius() -> None:
    angle = np.array([0.0, np.pi / 4, np.pi, 0.01, 0.001])
    arcs = Arcs.exact(np.array([0.2, 0.0847 * np.pi / 4, 2.0 * np.pi, 0.5, 0.2]), angle)
    assert piece_labels(arcs) == [
        "1 · straight",
        "2 · 45.0° · r 84.7 mm",
        "3 · 180° · r 2.00 m",
        "4 · 0.6° · r 50.00 m",
        "5 · nearly straight",
    ]


def test_summary_says_length_angle_tensions_elongation_and_warnings(still: list[FrameResult]) -> None:
    text = summary("still", still[0], timed=False)
    ends = still[0].transmission
    for part in (
        f"L = {1e3 * still[0].arcs.total_length:.1f} mm",
        f"Φ = {angle_with_error(still[0].arcs.total_angle, still[0].arcs.total_angle_se)}",
        "T_in = 15.00 N",
        f"T_out = {with_error(ends.tension_out, ends.tension_out_se, 2)} N",
        f"δ = {with_error(1e3 * ends.elongation, 1e3 * ends.elongation_se, 3)} mm",
        *still[0].warnings,
    ):
        assert part in text


def test_summary_states_how_far_the_dead_zone_still_reaches(moving: list[FrameResult]) -> None:
    turned = next(result for result in moving if result.transmission.dead_zone)
    width = turned.transmission.dead_zone_width
    assert f"T_in has to fall by another {width:.2f} N" in summary("run", turned, timed=True)


def test_summary_of_a_straight_route_names_no_radius() -> None:
    line = np.outer(np.linspace(0, 0.5, 40), [1.0, 0.0, 0.0])
    (result,) = process([Frame(line)], Rig(), tension_in=0.0)
    assert isinstance(result, FrameResult)
    assert "no bend" in summary("line", result, timed=False)


def test_table_has_a_row_for_each_piece_and_ends_with_tension_out(still: list[FrameResult]) -> None:
    rows = piece_table(still[0].arcs, route_samples(still[0])).splitlines()[2:]
    assert len(rows) == len(still[0].arcs.length)
    assert rows[-1].split("|")[-2].strip() == f"{still[0].transmission.tension_out:.2f}"
