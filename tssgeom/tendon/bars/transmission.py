"""What bars tell of a route: the transmission of the corners through their tensions, with their own ends."""

from __future__ import annotations

import numpy as np
from numba import njit

from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import MaterialState, through_bars
from tssgeom.tendon.transmission import Transmission, on_pieces

_SOLVED = 1e-8  # ln T of bars within which the front has come through: they are solved to 1e-10


def transmit(state: MaterialState, arcs: Arcs, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of bars on the route `arcs`; docs/model.md (49)."""
    tendon, way = rig.tendon, state.direction_index
    pieces = (arcs.length, arcs.angle, arcs.covariance)
    elastic = (tendon.compliance_per_N, tendon.pretension_N, rig.friction.coefficient)
    seen = _on_route(state.edge, state.tension, arcs.total_angle, pieces, elastic, way)
    tension_out, tension_out_se, _, elongation_se, width, front = seen
    inside = width > _SOLVED * max(state.tension_in, tension_out)  # bars are less exact than corners
    return Transmission(
        tension_in=state.tension_in,
        tension_out=state.tension_out,
        elongation=state.elongation,
        elongation_se=elongation_se,
        tension_out_se=tension_out_se,
        direction_index=way,
        dead_zone=inside,
        dead_zone_width=width if inside else 0.0,
        slip_front=front,
        displacement_in=state.displacement_in,
        displacement_out=state.displacement_out,
    )


@njit(cache=True, nogil=True)
def _on_route(
    edge: np.ndarray,
    tension: np.ndarray,
    turned: float,
    pieces: tuple[np.ndarray, np.ndarray, np.ndarray],
    elastic: tuple[float, float, float],
    way: int,
) -> tuple[float, float, float, float, float, float]:
    """Return what `transmission.on_pieces` does, of the corners through the bars."""
    angle, log_tension = through_bars(edge, tension, pieces[0], pieces[1], turned)
    return on_pieces(angle, log_tension, pieces, elastic, way)
