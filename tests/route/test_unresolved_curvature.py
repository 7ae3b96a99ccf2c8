"""Joints that blend and straight ends that no point shows: the error bars of a chain hold them."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from tssgeom.core import along_chain
from tssgeom.route import model_average
from tssgeom.route.arcs.chain import Chain, Data, fit_fixed_pieces, unfitted
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.unresolved_curvature import _derivatives, _Rows, unresolved_angle_variance

LENGTH = np.array([0.2, 0.25, 0.15])
KAPPA = np.array([4.0, -6.0, 5.0])  # bends in one plane, to either side


def planar(s: np.ndarray, kappa: np.ndarray) -> tuple[np.ndarray, float]:
    """Route in a plane with this curvature [1/m] at arc lengths `s` [m], and its Φ [rad], by quadrature."""
    angle = cumulative_trapezoid(kappa, s, initial=0.0)
    x, y = (cumulative_trapezoid(of(angle), s, initial=0.0) for of in (np.cos, np.sin))
    return np.column_stack((x, y, 0.0 * s)), float(np.trapezoid(np.abs(kappa), s))


def blended(width: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Three arcs whose curvature passes evenly from one to the next over a width [m]."""
    s = np.linspace(0.0, LENGTH.sum(), 6001)
    joints = np.cumsum(LENGTH)[:-1]
    ramps = [np.clip((s - joint) / width + 0.5, 0.0, 1.0) for joint in joints]
    kappa = KAPPA[0] + sum(np.diff(KAPPA)[i] * ramp for i, ramp in enumerate(ramps))
    return s, *planar(s, kappa)


def with_tip(length: float) -> tuple[np.ndarray, np.ndarray, float]:
    """An arc of 5/m over 0.4 m in front of a straight end [m]."""
    s = np.linspace(0.0, 0.4 + length, 6001)
    return s, *planar(s, np.where(s < 0.4, 5.0, 0.0))


def sensed(route, n: int, noise: float, seed: int) -> np.ndarray:
    s, points, _ = route
    at = np.linspace(0.0, s[-1], n)
    exact = np.column_stack([np.interp(at, s, column) for column in points.T])
    return exact + noise * np.random.default_rng(seed).standard_normal((n, 3))


def chain_of(points: np.ndarray, noise: float, length: np.ndarray, bend: np.ndarray) -> tuple[Data, Chain]:
    """Chain of arcs fitted to points of free stations."""
    stations = np.linspace(0.0, length.sum(), len(points))
    joints = np.concatenate(([0.0], np.cumsum(length)[:-1]))
    data = Data(points, np.ones(len(points)), True, noise**2, float(stations[1]))
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    bends = np.column_stack((bend, 0.0 * bend))
    return data, fit_fixed_pieces(data, unfitted(np.zeros(3), axes, joints, bends, stations))


@pytest.mark.parametrize("free", [True, False])
def test_derivatives_are_those_of_the_normal_equations(free):
    points = sensed(blended(0.001), 80, 1e-4, 0)
    data, chain = chain_of(points, 1e-4, LENGTH, KAPPA)
    data = data._replace(free=free)
    chain = fit_fixed_pieces(data, chain)
    position, frame = along_chain(chain.stations, chain.form)
    rows = _Rows(data, frame[:, 0])
    slopes = rows.of(*_derivatives(data, chain, position, rows.tangent))
    assert slopes @ slopes.T == pytest.approx(chain.matrix, rel=1e-3, abs=1e-3 * chain.matrix.max() ** 0.5)


def test_a_blend_that_points_show_explains_what_the_chain_turns_too_much():
    """Φ of a chain on an exact route, less that of the route, is the change that has the likelihood."""
    route = blended(0.04)
    data, chain = chain_of(sensed(route, 200, 1e-5, 0), 1e-5, LENGTH, KAPPA)
    excess = float(np.linalg.norm(chain.bend, axis=1) @ np.diff(chain.edges)) - route[2]
    assert excess > 0.15  # rad
    assert np.sqrt(unresolved_angle_variance(data, chain)) == pytest.approx(excess, rel=0.1)


def test_a_straight_end_that_points_show_explains_what_the_chain_turns_too_much():
    route = with_tip(0.05)
    data, chain = chain_of(sensed(route, 120, 2e-4, 1), 2e-4, np.array([0.45]), np.array([5.0]))
    turned = float(np.linalg.norm(chain.bend[0]) * (chain.stations.max() - chain.joints[0]))
    assert turned - route[2] > 0.1  # rad
    assert np.sqrt(unresolved_angle_variance(data, chain)) == pytest.approx(turned - route[2], rel=0.25)


def test_little_is_left_open_where_points_are_exact():
    points = sensed(blended(1e-6), 200, 1e-7, 0)
    data, chain = chain_of(points, 1e-7, LENGTH, KAPPA)
    assert unresolved_angle_variance(data, chain) < 0.003**2  # rad²


def test_a_straight_chain_has_nothing_to_change():
    points = sensed(
        (np.linspace(0.0, 0.5, 9), np.linspace(0.0, 1.0, 9)[:, None] * [0.5, 0.0, 0.0], 0.0), 30, 1e-4, 0
    )
    fit = measure(clean(points), 1e-4)
    assert fit.arcs.total_angle == 0.0
    assert fit.chain is not None
    stations = np.linspace(0.0, 0.5, 30)
    data = Data(points, np.ones(30), True, 1e-8, float(stations[1]))
    assert unresolved_angle_variance(data, fit.chain) == 0.0


@pytest.mark.parametrize(
    ("made", "n", "noise", "least"), [(blended, 100, 2e-4, 0.8), (with_tip, 60, 5e-4, 0.85)]
)
def test_intervals_hold_blended_joints_and_straight_ends_of_1_to_40_mm(made, n, noise, least):
    held = list[bool]()
    for seed in range(40):
        route = made(0.001 * (seed + 1))
        arcs = measure(clean(sensed(route, n, noise, seed))).arcs
        held.append(abs(arcs.total_angle - route[2]) < 1.96 * arcs.total_angle_se)
    assert np.mean(held) >= least


def test_a_smooth_fit_is_not_asked(monkeypatch):
    asked = list[Chain]()
    monkeypatch.setattr(
        model_average, "unresolved_angle_variance", lambda _, chain: asked.append(chain) or 0.0
    )
    s = np.linspace(0.0, 0.5, 2001)
    assert measure(clean(sensed((s, *planar(s, 8.0 * np.sin(12.0 * s))), 80, 2e-4, 0))).chain is None
    assert not asked
    assert measure(clean(sensed(blended(0.01), 80, 2e-4, 0))).chain is not None
    assert len(asked) == 1
