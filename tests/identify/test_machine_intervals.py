"""Intervals of a machine's numbers, and whether they count as identified."""

from types import SimpleNamespace

import numpy as np
import pytest

from tssgeom.core.constants import CHANCE
from tssgeom.identify.fit_quality import is_identified
from tssgeom.identify.machine_posterior import POSTERIOR, DriveErrors, Posterior, Profile, _Along
from tssgeom.least_squares import SOLVER
from tssgeom.statistics import NORMAL_95


def test_a_number_whose_interval_is_wider_than_half_of_what_was_assumed_is_not_identified():
    at = np.arange(-25, 3) / 10.0
    chi2 = np.where(at < -2.0, 7.2, np.where(at < -0.1, 40.0, 0.0))  # 4 % of it lies far away
    one, none = np.eye(1), np.zeros((1, 1))
    posterior = Posterior(
        np.zeros(1),
        0.01 * one,
        DriveErrors(none, 0.01 * one),
        NORMAL_95,
        (Profile(0, at[:, None], chi2),),
    )
    sd, low, high = posterior.of(np.ones(1))
    assert high - low > 0.5 * 2.0 * NORMAL_95
    assert not is_identified(sd)


class Banana:
    """Two readings whose likeliest u₁ is near b u₀²: χ² along u₀ is (1 + a²) u₀² + b² u₀⁴ c² / (1 + c²)."""

    def __init__(self, a, b, c):
        self.a, self.b, self.c = a, b, c

    def model(self, u):
        return {"reading": np.array([self.a * u[0], self.c * (u[1] - self.b * u[0] ** 2)])}

    def left(self, channels):
        return [channels["reading"]]

    def chi2(self, at):
        return (1.0 + self.a**2) * at**2 + self.b**2 * at**4 * self.c**2 / (1.0 + self.c**2)


@pytest.mark.parametrize("c", [2.0, 5.0, 50.0])
@pytest.mark.parametrize(("a", "b"), [(2.0, 2.0), (0.3, 1.0), (5.0, 20.0)])
def test_a_posterior_is_followed_along_its_likeliest_numbers_as_far_as_it_may_reach(a, b, c):
    bent, slope = Banana(a, b, c), np.diag([a, c])
    covariance = np.linalg.inv(slope.T @ slope + np.eye(2))
    start = SimpleNamespace(u=np.zeros(2), weight=[np.ones(2)])
    profile = _Along(bent, start, slope, covariance, 0).profile()
    at = profile.u[:, 0]
    assert np.all(np.diff(at) > 0.0)
    np.testing.assert_allclose(profile.chi2, bent.chi2(at), atol=2.0 * SOLVER.converged)
    assert min(profile.chi2[[0, -1]]) > CHANCE.rare**2
    assert np.abs(np.diff(profile.chi2)).max() <= POSTERIOR.leap
