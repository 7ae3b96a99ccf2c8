"""Laws that need more knots than a search has; docs/model.md (351)."""

import numpy as np
import pytest

from tests.campaigns.make import make_campaign
from tssgeom.identify.workflow import discover
from tssgeom.io.formats.campaigns import read_campaign


@pytest.mark.parametrize("seed", [0, 2])
def test_a_cell_that_swings_within_a_few_knots_drifts_in_time_and_nothing_else(tmp_path, seed):
    """Of 0 the held-out run spoke against seven knots; of 2 these left something that a gain took up."""
    make_campaign(tmp_path, seed, "wandering_load_cell", split="test")
    finding = discover(read_campaign(tmp_path))
    assert finding.verdict == "law"
    (part,) = finding.effects
    assert part.law is not None
    assert (part.names, part.law.over) == (("sensor_drift",), "time_s")
    noise, left = finding.misfit.noise, finding.misfit.after["held_out"]
    assert np.all([left[name] < 1.2 * noise[name] for name in left])
