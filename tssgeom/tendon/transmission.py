"""What a loaded tendon does on a route: tension at the far end, elongation, dead zone, with standard errors.

A piece is cut at the corners of the tension profile. Within each run ln T is linear in the accumulated curve
angle, hence also in arc length, and the integrals of the tension are elementary. A straight piece is a run
over which the angle, and so the tension, does not change. Sources: docs/model.md (5)-(14); paper Theorem 2,
eqs. (9)-(12).
"""

from typing import NamedTuple

from tssgeom import core
from tssgeom.arrays import Vector, read_only
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.bars.model import Model
from tssgeom.tendon.capstan import Corners, load_moved

_SOLVED = 1e-8  # ln T of bars within which the front has come through: they are solved to 1e-10


class Transmission(NamedTuple):
    """Tension and elongation of a tendon on a route, at one instant."""

    tension_in: float
    """Total tension at the proximal end [N]."""
    tension_out: float
    """Total tension at the distal end [N]."""
    elongation: float
    """Elongation of the tendon inside the sheath, above the pretensioned state [m]."""
    elongation_se: float
    """Standard error of the elongation, from that of the pieces and, in a stream, of the rig [m]."""
    tension_out_se: float
    """Standard error of the distal tension, from that of the pieces and, in a stream, of the rig [N]."""
    direction_index: int
    """ζ: +1 pulling, −1 releasing."""
    dead_zone: bool
    """True where the distal end does not yet respond to the last change of the proximal tension."""
    dead_zone_width: float
    """Further change of the proximal tension, in the present direction, until the distal end responds [N]."""
    slip_front: float
    """Curve angle up to which the tendon slid when the drive last moved, φ*; Φ where all of it did [rad]."""
    displacement_in: float
    """Movement of the drive since the pretensioned state, pulling positive [m]."""
    displacement_out: float
    """Movement of the load since the pretensioned state, towards the tendon positive [m]."""


def of_corners(state: Corners, arcs: Arcs, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of a tendon in `state` on the route `arcs`."""
    way = state.direction_index
    ends, _ = _at_ends(state, arcs, rig)
    tension_out, tension_out_se, elongation, elongation_se, width, front, _ = ends.tolist()
    moved_out = load_moved(tension_out, rig)
    return Transmission(
        tension_in=state.tension_in,
        tension_out=tension_out,
        elongation=elongation,
        elongation_se=elongation_se,
        tension_out_se=tension_out_se,
        direction_index=way,
        dead_zone=width > 0.0,
        dead_zone_width=width,
        slip_front=front,
        displacement_in=elongation + moved_out,
        displacement_out=moved_out,
    )


def of_bars(state: BarState, arcs: Arcs, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of bars on the route `arcs`; docs/model.md (49)."""
    tendon, way = rig.tendon, state.direction_index
    ends = core.transmit_bars(
        state.edge,
        state.memory.block,
        arcs.length,
        arcs.angle,
        arcs.covariance,
        tendon.compliance_per_N,
        tendon.pretension_N,
        rig.friction.coefficient,
        way,
    )
    # the tension of corners through the bars scales the dead zone alone; that of the result was solved for
    through_bars, tension_out_se, _, elongation_se, width, front, _ = ends.tolist()
    tension_in = state.tension_in
    inside = width > _SOLVED * max(tension_in, through_bars)  # bars are less exact than corners
    return Transmission(
        tension_in=tension_in,
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


def of_effects(state: BarState, model: Model, arcs: Arcs) -> Transmission:
    """Return tension, elongation and dead zone of a tendon with effects; docs/model.md (121)-(123)."""
    way = state.direction_index
    ends = core.transmit_with_effects(
        model.edge,
        model.plant.block,
        state.memory.block,
        arcs.length,
        arcs.angle,
        arcs.covariance,
        way,
        state.front,
    )
    elongation_se, tension_out_se, width, replied, front = ends.tolist()
    return Transmission(
        tension_in=state.tension_in,
        tension_out=state.tension_out,
        elongation=state.elongation,
        elongation_se=elongation_se,
        tension_out_se=tension_out_se,
        direction_index=way,
        dead_zone=not replied,
        dead_zone_width=width,
        slip_front=front,
        displacement_in=state.displacement_in,
        displacement_out=state.displacement_out,
    )


def answering(state: BarState, model: Model, tension_out: float, way: int) -> float:
    """Return the proximal tension from which on a slow pull (+1) or release (−1) moves the load [N].

    `tension_out` is the distal tension then [N]; docs/model.md (122).
    """
    return core.answering(len(state.edge), model.plant.block, state.memory.block, tension_out, way)


def elongation_slopes(state: Corners, arcs: Arcs, rig: Rig) -> tuple[Vector, float]:
    """Return how tension and elongation answer to each length and angle, the state held over φ.

    At a corner of the profile a derivative is one-sided: towards larger angle.

    Returns
    -------
    Vector
        [2k] Derivative of the elongation with respect to each length [1], then to each angle, later pieces
        moving on in φ [m/rad].
    float
        Derivative of ln T at the distal end with respect to any one of the angles [1/rad].
    """
    ends, gradient = _at_ends(state, arcs, rig)
    return read_only(gradient), float(ends[6])


def tension_and_elongation(state: Corners, arcs: Arcs, rig: Rig) -> tuple[float, float]:
    """Return the distal tension [N] and the elongation above the pretensioned state [m]."""
    ends, _ = _at_ends(state, arcs, rig)
    return float(ends[0]), float(ends[2])


def _at_ends(state: Corners, arcs: Arcs, rig: Rig) -> tuple[Vector, Vector]:
    """Return what `core.transmit_corners` does."""
    return core.transmit_corners(
        state.angle,
        state.log_tension,
        arcs.length,
        arcs.angle,
        arcs.covariance,
        rig.tendon.compliance_per_N,
        rig.tendon.pretension_N,
        rig.friction.coefficient,
        state.direction_index,
    )
