"""Few points select neither kind nor number of pieces: the error bars hold all models that explain them."""

import math

import numpy as np
import pytest

from tssgeom.route import model_average
from tssgeom.route.arcs.chain import fit_fixed_pieces
from tssgeom.route.arcs.moves import fit_chain
from tssgeom.route.geometry import chain_data, first_chain, measure, spline_fit
from tssgeom.route.model_average import (
    ChainModel,
    added_by_models,
    chain_model,
    probabilities,
    with_straights,
)
from tssgeom.route.model_choice import mixture_variance
from tssgeom.route.observations import clean
from tssgeom.route.spline.fit import fit
from tssgeom.route.steps import at_once
from tssgeom.route.synthetic import Course, chain, positions
from tssgeom.route.tracking import follow

NOISE = 2e-3
# straight, bent, straight, bent the other way, straight
S_BEND = chain(np.array([0.09, 0.08, 0.1, 0.09, 0.1]), np.array([0.0, 18.0, 0.0, -16.0, 0.0]))


def sensed(course: Course, n: int, noise: float, seed: int) -> np.ndarray:
    """Noisy points at even stations [m]."""
    s = np.linspace(0.0, course.total_length, n)
    return positions(course, s) + noise * np.random.default_rng(seed).standard_normal((n, 3))


def model(difference: float, priced: float, parameters: int = 10, *, proven: bool = True) -> ChainModel:
    """A chain with this evidence."""
    return ChainModel(1.0, 0.01, 0.5, 1e-6, difference, priced, parameters, proven)


def test_a_price_that_contradicts_the_points_leaves_the_choice_open():
    assert probabilities([model(20.0, -20.0)]) == pytest.approx([0.5, 0.5])


def test_much_evidence_decides():
    assert probabilities([model(300.0, 250.0)])[0] < 1e-6
    assert probabilities([model(-300.0, -350.0)])[0] > 1.0 - 1e-6
    assert probabilities([model(-math.inf, -math.inf)]) == pytest.approx([1.0])
    assert probabilities([]) == pytest.approx([1.0])


def test_a_chain_of_too_many_parameters_for_its_points_has_even_odds_at_most():
    assert probabilities([model(300.0, 250.0, proven=False)]) == pytest.approx([0.5, 0.5])
    assert probabilities([model(-300.0, -350.0, proven=False)])[0] > 1.0 - 1e-6


def test_more_parameters_make_the_criterion_less_sure():
    few, many = (probabilities([model(15.0, 15.0, count)])[1] for count in (5, 30))
    assert 0.5 < many < few < 1.0 / (1.0 + math.exp(-7.5))


def test_chains_share_their_probability_by_the_criterion():
    of_smooth, first, second = probabilities([model(10.0, 5.0), model(8.0, -9.0)])
    assert of_smooth + first + second == pytest.approx(1.0)
    assert 0.5 < first + second < 1.0 / (1.0 + math.exp(-2.5))
    assert first / second == pytest.approx(math.e)


@pytest.fixture(scope="module")
def tried():
    """A smooth fit of an S-bend, and a chain of two arcs."""
    shape = clean(sensed(S_BEND, 30, 1e-3, 1))
    spline = fit(shape, 1e-3)
    smooth = spline_fit(spline)
    data = chain_data(shape, 1e-3, spline)
    return smooth, data, fit_chain(data, fit_fixed_pieces(data, first_chain(data, smooth)))


def test_straight_pieces_between_bends_cost_a_joint_each_and_fit_no_worse(tried):
    _, data, arcs = tried
    begin, end = arcs.joints[0], arcs.stations.max()
    form = np.vstack((arcs.form[:4], [begin, 6.0, 0.0], [0.5 * (begin + end), -6.0, 0.0]))
    two = fit_fixed_pieces(data, arcs._replace(form=form, curved=np.ones(2, dtype=np.bool_)))
    ((_, more),) = at_once(with_straights([(data, two)]))
    assert not more.curved.all()
    assert more.curved.sum() == 2
    assert more.cost < two.cost


def test_the_added_variance_is_that_of_the_mixture_about_the_selected_model(tried):
    smooth, data, arcs = tried
    angle, length, form = added_by_models(smooth, smooth, [(data, arcs)])
    every = [(data, arcs), *at_once(with_straights([(data, arcs)]))]
    models = [chain_model(points, chain, smooth.spline) for points, chain in every]
    mean = np.array([smooth.arcs.total_angle, *(one.angle for one in models)])
    own = np.array([smooth.arcs.total_angle_se**2, *(one.angle_variance for one in models)])
    whole = mixture_variance(probabilities(models), mean, own, smooth.arcs.total_angle)
    assert angle == pytest.approx(max(whole - smooth.arcs.total_angle_se**2, 0.0))
    assert length >= 0.0
    assert form == 0.0  # which only a chain that is selected has


def test_a_chain_without_evidence_leaves_the_others(tried, monkeypatch):
    smooth, data, arcs = tried
    singular = arcs._replace(cost=2.0 * arcs.cost)
    alone = added_by_models(smooth, smooth, [(data, arcs)])

    def of_chain(data, chain, spline):
        model = chain_model(data, chain, spline)
        return model._replace(difference=math.nan) if chain is singular else model

    monkeypatch.setattr(model_average, "chain_model", of_chain)
    assert added_by_models(smooth, smooth, [(data, singular), (data, arcs)]) == pytest.approx(alone)
    assert alone[0] > 0.0


@pytest.mark.parametrize("n", [20, 40])
def test_intervals_of_an_s_bend_hold_its_angle_where_noise_hides_its_straights(n):
    """A smooth route and one of fewer pieces explain the points as well, and turn more."""
    off, longer = list[float](), list[float]()
    for seed in range(48):
        arcs = measure(clean(sensed(S_BEND, n, NOISE, seed)), NOISE).arcs
        off.append((arcs.total_angle - S_BEND.total_angle) / arcs.total_angle_se)
        longer.append((arcs.total_length - S_BEND.total_length) / arcs.total_length_se)
    assert np.mean(np.abs(off) < 1.96) >= 0.8
    assert np.mean(np.abs(longer) < 1.96) >= 0.87


def in_a_plane(rng: np.random.Generator) -> Course:
    """Two or three bends of any sign between straights, or waves that die out."""
    u, count = (np.arange(200) + 0.5) / 200, int(rng.integers(2, 4))
    edge = np.cumsum(rng.dirichlet(np.full(2 * count + 1, 4.0)))
    kappa = np.zeros(2 * count + 1)
    kappa[1::2] = rng.uniform(0.4, 1.0, count) * rng.choice([-1.0, 1.0], count)
    bend = kappa[np.minimum(np.searchsorted(edge, u), 2 * count)]
    if rng.random() < 0.5:
        phase, size = rng.uniform(0.0, 2.0 * np.pi, (6, 1)), rng.standard_normal((6, 1))
        wave = np.arange(6)[:, None]
        bend = np.sum(size / (1.0 + wave) * np.cos(np.pi * wave * u + phase), axis=0)
    turn, length = rng.uniform(0.8, 7.0), rng.uniform(0.2, 0.6)
    bend *= turn / length / np.abs(bend).mean()
    return Course(np.full(200, length / 200), np.outer(bend, (0.6, 0.8)))


def test_intervals_of_many_noisy_points_in_a_plane_hold_the_angle():
    """Noise hides straights and weak bends between inflections: no one model shows them."""
    off = list[float]()
    for seed in range(60):
        course = in_a_plane(np.random.default_rng([seed, 47]))
        arcs = measure(clean(sensed(course, 200, 1e-3, seed))).arcs
        off.append((arcs.total_angle - course.total_angle) / arcs.total_angle_se)
    assert np.mean(np.abs(off) < 1.96) >= 0.9


@pytest.mark.parametrize("n", [8, 12, 20])
def test_intervals_of_few_points_of_unknown_noise_hold_the_length(n):
    off = list[float]()
    for seed in range(30):
        rng = np.random.default_rng([seed, n])
        course = Course(np.full(200, 0.45 / 200), np.outer(np.ones(200), rng.uniform(-6.0, 6.0, 2)))
        arcs = measure(clean(sensed(course, n, 1e-3, seed))).arcs
        off.append((arcs.total_length - course.total_length) / arcs.total_length_se)
    assert np.mean(np.abs(off) < 1.96) >= 0.87


def test_the_next_frame_keeps_what_not_knowing_the_model_adds():
    points = sensed(S_BEND, 20, NOISE, 3)
    first = follow(clean(points), NOISE, None)
    assert first.by_models == first.fit.by_models
    assert first.by_models.angle > 0.0
    second = follow(clean(points), NOISE, first)
    assert second.by_models == first.by_models
    assert second.fit.arcs.total_angle_se > 0.9 * math.sqrt(first.by_models.angle)
    assert first.fit.arcs.model_variance == 0.0  # frames before it need not share its model
    assert second.fit.arcs.model_variance == first.by_models.angle
