import math

import msgspec
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


def test_summary_of_a_machine_names_its_tendon_and_what_else_is_read() -> None:
    text = """
    tendon.pretension_N = 6.0
    drive = { kind = "pair", radius_m = 0.01 }
    end = { kind = "joint", radius_m = 0.008, stiffness_Nm_per_rad = 0.2 }
    """
    turn = np.linspace(0.0, 3.0, 40)
    points = 0.1 * np.column_stack((np.sin(turn), 1.0 - np.cos(turn), 0.0 * turn))
    frame = Frame(points, 1.0, of_machine={"motor_angle_rad": 0.2})
    (result,) = process([frame], msgspec.toml.decode(text, type=Rig), tension_in=6.0)
    assert isinstance(result, FrameResult)
    assert result.machine is not None
    words = summary("pair", result, timed=True)
    assert "This is tendon 1 of the machine" in words
    assert f"θ_m = {math.degrees(0.2):.1f} °" in words
    assert f"T_in,2 = {result.machine.channels['tension_in_2_N']:.1f} N" in words
    assert "T_in,1" not in words


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
