"""A pair on routes that were sensed with errors: where a bend lies is fitted; no effect stands for it."""

from functools import cache

import numpy as np
import pytest

from tests.identify.test_machine_routes import MOTOR, PAIR, TIME
from tssgeom.identify.machine_discovery import machine_work
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_route_errors import (
    independent_errors,
    with_own_route_errors,
    without_proportional,
)
from tssgeom.identify.machine_run import machine_run
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine

BENDS = np.array([0.0, 1.5, 0.0, 1.5, 0.0])
NOISE = {"joint_angle_rad": 1e-4, "tension_in_1_N": 0.02, "tension_in_2_N": 0.02}
SHIFT = 3e-3
"""How much farther along the bends are than sensed [m]."""


def lengths(first):
    return np.array([first, 0.12, 0.08, 0.06, 0.24 - first])


def sensed(first):
    """Two bends whose common position has a standard error of 2 mm, and whose angles have 0.5 %."""
    position = 2e-3 * np.array([1.0, 0.0, 0.0, 0.0, -1.0])
    errors = np.concatenate([position, np.zeros(5)]), np.concatenate([np.zeros(5), 5e-3 * BENDS])
    return Arcs(lengths(first), BENDS, sum(np.outer(each, each) for each in errors), "spline")


def run_on(first, name, rng, *, certain=False):
    """A run on two bends that are farther along than sensed, which the sensor may take for certain."""
    exact = Arcs.exact(lengths(first) + SHIFT * np.array([1.0, 0.0, 0.0, 0.0, -1.0]), BENDS)
    out = simulate_machine(machine_of(PAIR, [exact], 40), {"time_s": TIME, "motor_angle_rad": MOTOR})
    columns = {"time_s": TIME, "motor_angle_rad": MOTOR}
    columns |= {name: out[name] + rng.normal(0.0, noise, TIME.size) for name, noise in NOISE.items()}
    route = sensed(first)
    return machine_run(name, columns, [Arcs.exact(route.length, route.angle) if certain else route], PAIR)


@cache
def work_of(*firsts, held="run1", certain=False):
    rng = np.random.default_rng(4)
    runs = [run_on(first, f"run{k}", rng, certain=certain) for k, first in enumerate(firsts)]
    return machine_work(MachineCampaign("bench", PAIR, (), tuple(runs), (held,)))[0]


def over_noise(rms):
    return max(value / NOISE[name] for name, value in rms.items())


def test_bends_that_lie_farther_along_than_sensed_are_no_effect():
    work = work_of(0.1, 0.05)
    assert work.chosen.model.parts == ()
    assert work.zeros == ()
    assert over_noise(work.base.fitted) < 1.15
    assert over_noise(work.base.held) < 1.2  # on a route of its own
    assert work.base.rig.tendon.compliance_per_N == pytest.approx(4e-4, rel=5e-3)


def test_a_route_that_is_taken_for_certain_leaves_more_than_noise():
    work = work_of(0.1, 0.05, certain=True)
    assert over_noise(work.base.held) > 2.0
    assert not any(each.kind == "bends" for each in work.base.problem.parameters)


def test_bends_are_estimated_as_they_are():
    problem, u = work_of(0.1, 0.05).base.problem, work_of(0.1, 0.05).base.state.u
    moved = problem.moved_bends(u)[0]
    assert moved[0] == pytest.approx(SHIFT, abs=5e-4)
    assert moved[4] == pytest.approx(-SHIFT, abs=5e-4)


def test_a_held_out_run_on_a_fitted_route_has_its_bends():
    work = work_of(0.1, 0.1)
    assert work.kept[0].bends == {}
    (route,) = work.base.on_known_routes(work.kept[0]).routes
    assert route.length[0] == pytest.approx(0.1 + SHIFT, abs=5e-4)
    assert over_noise(work.base.held) < 1.2


def test_derivatives_by_bends_are_those_of_what_is_left():
    base = work_of(0.1, 0.05).base
    problem, state = base.problem, base.state
    slope = state.jacobian(problem, state.left)
    for j in (k for k, each in enumerate(problem.parameters) if each.kind == "bends"):
        u = state.u.copy()
        u[j] += 0.3
        after = np.concatenate(problem.left(problem.model(u)))
        np.testing.assert_allclose(after - np.concatenate(state.left), 0.3 * slope[:, j], atol=1e-12)


def test_errors_in_proportion_to_the_angles_are_those_of_the_whole_angle():
    arcs = sensed(0.1)
    shares = without_proportional(arcs)
    assert shares[0, 0] == pytest.approx(4e-6)
    np.testing.assert_allclose(shares[5:, 5:], 0.0, atol=1e-18)
    (error,) = independent_errors(arcs, shares).T
    np.testing.assert_allclose(np.abs(error[:5]), [2e-3, 0.0, 0.0, 0.0, 2e-3], atol=1e-12)
    assert independent_errors(arcs, arcs.covariance).shape[1] == 2
    exact = Arcs.exact(arcs.length, arcs.angle)
    assert independent_errors(exact, exact.covariance).size == 0


def test_errors_that_change_less_than_the_noise_are_not_fitted():
    run = run_on(0.1, "run", np.random.default_rng(1))
    assert len(with_own_route_errors(run, PAIR, {}).bends) == 2
    small = [each.with_errors(1e-3) for each in run.routes]
    quiet = machine_run("run", {**run.given, **run.measured}, small, PAIR)
    assert with_own_route_errors(quiet, PAIR, {}).bends == {}
