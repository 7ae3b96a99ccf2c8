"""The entry of fibre.h against its slow twin on random gratings."""

import math

import numpy as np
import pytest

from tests.core.twins.fibre import average_partitions as twin
from tssgeom import core
from tssgeom.route.fibre.models import Sensed, average_partitions


def _sensed(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 25))
    s = np.sort(rng.uniform(0.0, 0.5, n))
    bend = 10.0 * np.repeat(rng.normal(size=(4, 2)) * (rng.random((4, 1)) > 0.4), 7, axis=0)[:n]
    merged = rng.integers(1, 4, n).astype(float)
    return Sensed(s, bend + 0.5 * rng.normal(size=(n, 2)), merged, 0.5, 0.5), rng


def test_averages_over_all_partitions():
    for seed in range(200):
        sensed, rng = _sensed(seed)
        noise, rate = 10.0 ** rng.uniform(-1.0, 0.5), 10.0 ** rng.uniform(-1.0, 2.0)
        expected = twin(sensed.s, sensed.bend, sensed.merged / noise**2, sensed.cell, rate, sensed.typical**2)
        result = average_partitions(sensed, noise, rate)
        np.testing.assert_allclose(result[:2], expected[:2], rtol=1e-10, atol=1e-10)
        # a variance is the difference of squares
        np.testing.assert_allclose(result[2], expected[2], rtol=1e-8, atol=1e-12)
        np.testing.assert_array_equal(result.joints, expected[3])
        np.testing.assert_array_equal(result.curved, expected[4])


@pytest.mark.parametrize("name", ["s", "bend", "merged"])
def test_numbers_that_are_none_end_without_a_result(name):
    sensed, _ = _sensed(1)
    broken = sensed._replace(**{name: np.full_like(getattr(sensed, name), math.nan)})
    result = average_partitions(broken, 0.5, 4.0)
    assert math.isnan(result.log_evidence)
    assert result.joints[-1] == len(sensed.s)


def test_gratings_and_cells_of_other_numbers_are_refused():
    sensed, _ = _sensed(2)
    with pytest.raises(ValueError, match="cell has shape"):
        core.average_partitions(sensed.s, sensed.bend, sensed.merged, sensed.cell[:-1], 4.0, 1.0)
