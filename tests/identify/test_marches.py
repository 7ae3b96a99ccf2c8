"""Marches that fits ask for twice: they are those of the core, and nothing can change them."""

import numpy as np
import pytest

from tssgeom.identify.marches import march_once
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import begin, carry_on, prepare

ROUTE = Arcs.exact(np.array([0.2, 0.3]), np.array([1.0, 2.0]))
RUN = {"time_s": np.arange(40.0), "displacement_in_m": 3e-3 * np.sin(0.3 * np.arange(40.0))}


def test_a_march_that_was_kept_is_that_of_the_core_for_each_drive():
    model = prepare(RUN, ROUTE, Rig())
    for factor in (1.0, 0.5, 1.0):
        run = {**RUN, "displacement_in_m": factor * RUN["displacement_in_m"]}
        (plain, end), (kept, same) = (
            carry_on(model, begin(model), run),
            carry_on(model, begin(model), run, march=march_once),
        )
        for name, column in plain.channels.items():
            np.testing.assert_array_equal(kept.channels[name], column)
        np.testing.assert_array_equal(same.memory.block, end.memory.block)


def test_a_march_that_was_kept_refuses_writes():
    model = prepare(RUN, ROUTE, Rig())
    kept, _ = carry_on(model, begin(model), RUN, march=march_once)
    with pytest.raises(ValueError, match="read-only"):
        kept.slip_out[0] = 5.0
