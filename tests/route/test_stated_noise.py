"""A noise that is stated counts, unless many points contradict it."""

import numpy as np
import pytest

from tests.known_routes import Cell, draw
from tssgeom.api.calls import analyse
from tssgeom.frame import Frame
from tssgeom.rig import Rig, ShapeSensor
from tssgeom.route.fibre.sensed import clean_fibre, fit_fibre
from tssgeom.sensed_route import fit_frame

ROUTES = ("half circle", "setup A", "helix", "clothoid", "colon", "harmonics", "pieces", "slopes")


def stating(noise: float) -> Rig:
    return Rig(shape=ShapeSensor(noise_mm=1e3 * noise))


def contradicted(warnings: tuple[str, ...]) -> bool:
    return any("that are stated" in each for each in warnings)


@pytest.mark.parametrize("factor", [1, 4])
def test_the_bars_hold_and_only_a_noise_that_is_too_low_has_a_warning(factor):
    held, named = [], []
    for route in ROUTES:
        for n, noise in ((60, 1e-4), (150, 5e-4)):
            known = draw(Cell("stated noise", route, n, noise, stations="even"), 0)
            result = analyse(known.points, stating(noise / factor))
            held.append(
                abs(result.arcs.total_angle - known.truth.total_angle) < 1.96 * result.arcs.total_angle_se
            )
            named.append(contradicted(result.warnings))
    assert np.mean(held) > 0.8  # of 16 at 95 %: fewer have a chance of 1 %
    assert np.mean(named) == 0.0 if factor == 1 else np.mean(named) > 0.9


def test_accurate_points_at_a_kink_do_not_contradict_their_noise():
    s = np.linspace(0.0, 1.0, 60)
    kinked = 0.4 * np.column_stack((np.minimum(s, 0.5), np.maximum(s - 0.5, 0.0), 0.0 * s))
    points = kinked + 2e-5 * np.random.default_rng(0).standard_normal(kinked.shape)
    result = analyse(points, stating(2e-5))
    assert not contradicted(result.warnings)
    assert result.arcs.total_angle == pytest.approx(0.5 * np.pi, abs=0.01)


def test_few_points_are_fitted_by_what_is_stated():
    known = draw(Cell("stated noise", "half circle", 20, 5e-4, stations="even"), 0)
    assert not contradicted(analyse(known.points, stating(1e-4)).warnings)


@pytest.mark.parametrize("filters", [True, False])
def test_a_stream_goes_on_with_the_noise_of_the_points_until_it_is_the_stated_one(filters):
    rng, s = np.random.default_rng(1), np.linspace(0.0, np.pi, 100)
    exact = 0.4 / np.pi * np.column_stack((np.sin(s), 1.0 - np.cos(s), 0.0 * s))
    rig, last, noises, named = Rig(shape=ShapeSensor(noise_mm=0.1, time_filter=filters)), None, [], []
    for k in range(60):
        noise = 5e-4 if k < 30 else 5e-5
        points = exact + noise * rng.standard_normal(exact.shape)
        last = fit_frame(Frame(points, time=0.04 * k), rig, last)[1]
        noises.append(last.fit.noise * last.sensed_over_fitted)
        named.append(contradicted(last.fit.warnings))
        assert abs(last.fit.arcs.total_angle - np.pi) < 4.0 * last.fit.arcs.total_angle_se
    assert named[0]
    assert sum(named) == 1
    assert np.mean(noises[5:30]) == pytest.approx(5e-4, rel=0.1)
    assert filters or noises[-1] == pytest.approx(1e-4, rel=0.01)  # a filter in time forgets slowly


@pytest.mark.parametrize("factor", [1, 4])
@pytest.mark.parametrize("n", [40, 200])
def test_a_fibre_contradicts_a_noise_that_is_far_too_low(n, factor):
    rng, s = np.random.default_rng(n), np.linspace(0.0, 0.5, n)
    true = np.where((s > 0.1) & (s < 0.25), 8.0, 0.0)
    bend, held = np.column_stack((true, 0.0 * s)), []
    for _ in range(6):
        sensed = bend + 0.2 * rng.standard_normal(bend.shape)
        fit = fit_fibre(clean_fibre(sensed, s), 0.2 / factor).fit
        assert contradicted(fit.warnings) == (factor > 1)
        held.append(abs(fit.arcs.total_angle - 1.2) < 2.5 * fit.arcs.total_angle_se)
    assert sum(held) >= 5


def test_a_stream_of_a_fibre_goes_on_with_the_noise_of_the_curvatures():
    rng, s = np.random.default_rng(3), np.linspace(0.0, 0.5, 60)
    rig, last, named = Rig(shape=ShapeSensor(curvature_noise_per_m=0.05)), None, []
    for k in range(4):
        sensed = np.column_stack((6.0 * np.sin(9.0 * s), 0.0 * s)) + 0.3 * rng.standard_normal((60, 2))
        frame = Frame(np.full((60, 3), np.nan), time=0.1 * k, stations=s, curvatures=sensed)
        last = fit_frame(frame, rig, last)[1]
        named.append(contradicted(last.fit.warnings))
        assert last.noise_contradicted
        assert last.fibre_noise is not None
    assert named == [True, False, False, False]
