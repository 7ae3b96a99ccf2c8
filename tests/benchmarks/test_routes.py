"""The truth that the benchmarks measure against is checked by other means."""

import numpy as np
import pytest

from tests.known_routes import PIECEWISE, SMOOTH, Cell, catalogue, draw, quick, truth
from tssgeom.route import synthetic


@pytest.mark.parametrize("name", [*PIECEWISE, *SMOOTH])
def test_dense_exact_points_turn_by_the_true_angle(name):
    route = truth(name, np.random.default_rng(3))
    steps = np.diff(route.position(np.linspace(0.0, route.length, 20_001)), axis=0)
    sine = np.linalg.norm(np.cross(steps[1:], steps[:-1]), axis=1)
    turned = np.arctan2(sine, np.einsum("ij,ij->i", steps[1:], steps[:-1])).sum()
    assert turned == pytest.approx(
        route.total_angle, rel=2e-4, abs=1e-6
    )  # half a step at both ends is missed
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(route.length, rel=1e-6)


@pytest.mark.parametrize("name", PIECEWISE)
def test_positions_are_those_of_the_package(name):
    route = truth(name, np.random.default_rng(0))
    s = np.linspace(0.0, route.length, 50)
    assert route.course is not None
    np.testing.assert_allclose(route.position(s), synthetic.positions(route.course, s), atol=1e-12)


def test_harmonics_are_new_in_every_trial_and_the_same_at_every_call():
    cell = Cell("test", "harmonics", 20, 1e-4)
    assert draw(cell, 0).truth.total_angle != draw(cell, 1).truth.total_angle
    np.testing.assert_array_equal(draw(cell, 1).points, draw(cell, 1).points)


def test_every_cell_has_a_title_of_its_own():
    titles = [cell.title for cell in (*catalogue(), *quick())]
    assert len(set(titles)) == len(titles)


@pytest.mark.parametrize("cell", [c for c in catalogue() if c.route == "7 pieces"], ids=lambda c: c.title)
def test_stations_rise_from_the_beginning_to_the_end_of_the_route(cell):
    sensed = draw(cell, 5)
    assert sensed.station[0] == 0.0
    assert sensed.station[-1] == pytest.approx(sensed.truth.length)
    assert np.all(np.diff(sensed.station) >= 0.0)
    assert np.isnan(sensed.points[:, 0]).sum() == round(cell.gap * cell.n)
    assert np.sum(~sensed.good) == round((cell.gap + cell.outliers) * cell.n)


def test_noise_and_outliers_have_the_size_that_the_cell_says():
    sensed = draw(Cell("test", "colon", 2000, 1e-3, outliers=0.05), 0)
    off = sensed.points - sensed.truth.position(sensed.station)
    assert np.std(off[sensed.good]) == pytest.approx(
        1e-3, rel=0.05
    )  # 5700 numbers: 1 % is a standard deviation
    far = np.linalg.norm(off[~sensed.good], axis=1)
    assert np.all(np.abs(far - 0.02) < 0.006)  # the noise on top is below 6 standard deviations
