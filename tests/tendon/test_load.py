"""How far the load moves: from where the pretension left it."""

import msgspec
import pytest

from tssgeom.rig import Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.state import pretensioned, step, transmit

STRAIGHT = Arcs.exact([0.5], [0.0])
RIG = Rig(tendon=Tendon(pretension_N=5.0), load=Load(stiffness_N_per_m=1000.0))


@pytest.mark.parametrize(("tension", "moved"), [(5.0, 0.0), (15.0, 0.01), (2.0, -0.003)])
def test_a_spring_moves_by_the_tension_beyond_the_pretension(tension, moved):
    observed = transmit(step(pretensioned(RIG), STRAIGHT, RIG, tension_in=tension), RIG)
    assert observed.displacement_out == pytest.approx(moved, rel=1e-12, abs=1e-15)
    assert observed.displacement_in == pytest.approx(observed.elongation + moved, rel=1e-12, abs=1e-15)


def test_a_dead_weight_stays_where_it_is():
    rig = msgspec.structs.replace(RIG, load=Load(stiffness_N_per_m=0.0))
    observed = transmit(step(pretensioned(rig), STRAIGHT, rig, tension_in=15.0), rig)
    assert observed.displacement_out == 0.0
