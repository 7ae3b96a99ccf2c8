"""The compiled filter in time against the same in numpy, frame after frame."""

import numpy as np
import pytest

from tests.core.twins import time_filter as twin
from tssgeom import core
from tssgeom.route.time_filter import begun


@pytest.mark.parametrize(("coordinates", "alone"), [(2, False), (3, False), (2, True)])
@pytest.mark.parametrize("seed", range(12))
def test_each_frame_is_that_of_the_twin(seed, coordinates, alone):
    rng = np.random.default_rng(seed)
    n, pace = int(rng.integers(4, 60)), 10.0 ** rng.uniform(-6, -2)
    points, speed = rng.normal(size=(n, 3)), pace * np.cumsum(rng.normal(size=(n, 3)), axis=0)
    points[:, coordinates:] = speed[:, coordinates:] = 0.0
    direction = points / np.linalg.norm(points) if alone else np.zeros_like(points)
    state = begun(points[:, :coordinates], 1e-3, 0.0)
    assert state is not None
    carried = state.memory, state.probability, state.covariance, state.counts
    for frame in range(20):
        if frame % 7 == 6:
            speed = -speed
        points = points + speed
        sensed = points + 1e-3 * rng.normal(size=(n, 3))
        sensed[:, coordinates:] = 0.0
        if n > 8 and frame % 5 == 2:
            sensed[int(rng.integers(n))] = np.nan
        step = float(rng.uniform(0.5, 2.0))
        *made, estimate, _, variance, r, standing = core.filter_in_time(
            *carried, sensed, step, 1e-4, coordinates, direction
        )
        memory, *others = carried
        *expected, twin_estimate, twin_variance, twin_r, twin_standing = twin.filter_in_time(
            *(memory[..., :coordinates], *others, sensed[:, :coordinates], step, 1e-4),
            direction[:, :coordinates] if alone else None,
        )
        scale = np.abs(points).max()
        made[0], estimate = made[0][..., :coordinates], estimate[:, :coordinates]
        for ours, theirs in zip((*made, estimate), (*expected, twin_estimate), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-9 * scale)
        assert (variance, r, standing) == pytest.approx((twin_variance, twin_r, twin_standing), rel=1e-7)
        full = np.zeros((len(made[0]), n, 3))
        full[..., :coordinates] = made[0]
        carried = (full, *made[1:])
