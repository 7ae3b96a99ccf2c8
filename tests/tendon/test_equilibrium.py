"""The solver of an equilibrium against a slow twin."""

import numpy as np
import pytest

from tssgeom import core


def balanced(trial, stiffness, low, high, force):
    """The slow twin: move one contact after the other into its cone, by bisection, until nothing moves."""
    w = np.zeros(len(low))

    def tension(j):
        near, far = w[j - 1] if j > 0 else 0.0, w[j] if j < len(w) else 0.0
        return trial[j] + stiffness[j] * (near - far)

    for _ in range(3000):
        before = w.copy()
        for i in range(len(w)):
            side, breach = 0.0, lambda i=i: tension(i + 1) - low[i] * tension(i) + force[i]
            w[i] = 0.0
            if breach() < 0:
                side = 1.0
            else:
                breach = lambda i=i: tension(i + 1) - high[i] * tension(i) - force[i]  # noqa: E731
                side = -1.0 if breach() > 0 else 0.0
            if side:
                at_rest = breach()
                w[i] = side * 1e-3
                w[i] = -at_rest / ((breach() - at_rest) / w[i])  # linear as long as nothing is slack
        if np.max(np.abs(w - before)) < 1e-17:
            break
    return np.array([tension(j) for j in range(len(trial))])


def random_chain(rng, bars):
    angle = rng.uniform(0.0, 0.3, bars + 1)
    stiffness = np.concatenate(([0.0], rng.uniform(1e4, 3e4, bars), [1000.0]))
    trial = rng.uniform(4.0, 12.0, bars + 2)
    force = rng.uniform(0.0, 0.2, bars + 1)
    none = np.zeros(bars + 1)
    return trial, stiffness, np.array([np.exp(-angle), np.exp(1.3 * angle), force, none, none + np.inf, none])


@pytest.mark.parametrize("patience", [(6, 10), (0, 10), (0, 0)])
@pytest.mark.parametrize("seed", range(8))
def test_newton_and_nested_iteration_find_the_equilibrium_of_the_slow_twin(seed, patience):
    rng = np.random.default_rng(seed)
    trial, stiffness, cone = random_chain(rng, 6)
    before = rng.integers(-1, 2, 7).astype(float)
    free, stays = (False, False, 0.0), False
    _, tension, _, residual = core.equilibrium(trial, stiffness, cone, *free, stays, before, *patience)
    assert residual <= 1e-9 * 12.0  # ten times what is accepted, of the greatest tension
    expected = balanced(trial, stiffness, *cone[:3])
    np.testing.assert_allclose(
        tension, expected, atol=1e-8
    )  # the twin stops at 1e-17 m and creeps by 1e-2 a sweep


@pytest.mark.parametrize("seed", range(12))
def test_bars_of_which_some_are_slack_obey_cone_and_signs(seed):
    """Constant friction holds tension between slack bars; the hardest case for the solver."""
    rng = np.random.default_rng(seed)
    trial, stiffness, cone = random_chain(rng, 40)
    trial = np.sin(np.arange(42) * rng.uniform(0.1, 0.3)) * 6.0 + rng.normal(0.0, 4.0, 42)
    cone[2] *= 30.0
    free = (True, True, 0.0)
    _, tension, (w, _), residual = core.equilibrium(trial, stiffness, cone, *free, False, np.zeros(41), 6, 10)
    assert residual <= 1e-9 * np.max(tension)
    moved = np.concatenate(([0.0], w, [0.0]))
    np.testing.assert_allclose(tension[1:-1], np.maximum(trial + stiffness * -np.diff(moved), 0.0)[1:-1])
    low, high, force = cone[:3]
    over, under = tension[1:] - high * tension[:-1] - force, low * tension[:-1] - force - tension[1:]
    assert max(over[1:-1].max(), under[1:-1].max()) < 1e-7
    assert (np.abs(under)[1:-1][w[1:-1] > 1e-12] < 1e-7).all()
    assert (np.abs(over)[1:-1][w[1:-1] < -1e-12] < 1e-7).all()
    assert (tension == 0.0).sum() > 3
