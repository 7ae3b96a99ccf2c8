"""Every estimator of the accuracy benchmark is one: on good points it finds the angle."""

import numpy as np
import pytest

from benchmarks.estimators import OURS, PEERS, Sighting, taubin_smoothing, vmtk_smoothing
from benchmarks.scores import METHODS, Outcome, Score, bound, run, summary
from tests.known_routes import Cell, draw, truth

HALF = truth("half circle", np.random.default_rng(0))


def _sighting(n, noise=1e-9, *, known=True):
    s = np.linspace(0.0, HALF.length, n)
    points = HALF.position(s) + noise * np.random.default_rng(0).standard_normal((n, 3))
    return Sighting(points, s if known else None, noise, noise)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("name", [*OURS, *(name for name in PEERS if name not in ("VMTK", "Taubin"))])
def test_exact_points_give_the_angle(name, known):
    estimate = METHODS[name](_sighting(100, known=known))
    # natural ends and half a step cost cubics 2 %
    assert estimate.total_angle == pytest.approx(np.pi, rel=0.03)
    assert estimate.s[-1] == pytest.approx(HALF.length, rel=1e-3)


@pytest.mark.parametrize("smoothing", [vmtk_smoothing, taubin_smoothing])
def test_smoothing_takes_most_of_the_noise_out_of_turning_angles(smoothing):
    sighting = _sighting(100, noise=2e-4)
    assert abs(smoothing(sighting).total_angle - np.pi) < 0.1 * (
        PEERS["turning"](sighting).total_angle - np.pi
    )


def test_peers_do_without_missing_points():
    sighting = _sighting(100)
    sighting.points[40:50] = np.nan
    for name, peer in PEERS.items():
        assert np.isfinite(peer(sighting).total_angle), name


def test_trials_do_not_depend_on_how_they_are_split():
    cell = Cell("test", "half circle", 15, 5e-4)
    whole, parts = run(cell, range(2)), [run(cell, [trial]) for trial in range(2)]
    for name in METHODS:
        together = tuple(score for part in parts for score in part[name].scores)
        np.testing.assert_array_equal(whole[name].scores, together)


def test_scores_are_relative_to_the_true_angle_and_counts_are_of_pieces():
    cell = Cell("test", "setup A", 60, 1e-9)
    outcome = run(cell, [0])["spline"]
    one = summary([outcome], pieces=2)
    assert one.rms < 0.01
    assert one.failed == 0
    assert one.right_count in (0.0, 1.0)


def _score(angle, se, pieces=0.0):
    return Score(angle, se, abs(angle), 0.0, np.nan, pieces, thin=1.0)


def test_coverage_is_the_share_of_intervals_that_hold_the_truth():
    scores = tuple(_score(angle, 1.0) for angle in (-2.5, -1.9, 0.0, 1.9))
    assert summary([Outcome(scores, ())], pieces=0).coverage == 0.75


def test_failures_are_counted_and_quoted():
    one = summary([Outcome((_score(0.1, np.nan),), ()), Outcome((), ("FitError: no curve",))], pieces=0)
    assert (one.trials, one.failed, one.failure) == (2, 1, "FitError: no curve")
    assert np.isnan(one.coverage)


def test_the_bound_of_a_cell_leaves_outliers_and_missing_points_out():
    good = bound(Cell("test", "half circle", 200, 5e-4), 1).angle
    spoilt = bound(Cell("test", "half circle", 200, 5e-4, outliers=0.05, gap=0.2), 5).angle
    assert good < spoilt < 1.3 * good


def test_smooth_routes_have_no_bound():
    assert np.isnan(bound(Cell("test", "clothoid", 30, 5e-4), 1).angle)


def test_a_draw_leaves_the_exact_points_inside_the_noise():
    sensed = draw(Cell("test", "6 pieces", 40, 1e-5, "jitter"), 0)
    off = sensed.points - sensed.truth.position(sensed.station)
    assert np.max(np.abs(off)) < 6e-5  # 120 numbers below 6 sigma
