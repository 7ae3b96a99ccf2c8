"""The state of a tendon of bars, with or without effects, and its exchange for a list of corners.

Source: docs/model.md (48), (49), (51).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.arrays import Vector, read_only
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon import BAR
from tssgeom.effects import Channel
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import discretise, equal_edges
from tssgeom.tendon.bars.model import Model
from tssgeom.tendon.bars.plant import Memory, memory_of
from tssgeom.tendon.capstan import Corners, load_moved, tension

BARS = 60
"""Bars of a tendon without effects, where nothing else is asked for."""
AT_LIMIT = 0.99
"""Share of the friction bound from which a contact slides [1]. Chosen: bars are solved to 1e-10."""
_NO_LAGS: Mapping[Channel, tuple[float, ...]] = {}


class BarState(NamedTuple):
    """A tendon of bars: their tension, their contacts with the sheath, and both of its ends.

    Bar 0 is what drives the proximal end, the last bar what the distal end pulls against; between them are
    the n bars of the tendon in the sheath. Contacts with the sheath lie between neighbours. A state without
    effects follows the sensed length of its route and has a `rest`; one with effects keeps the lengths that
    its bars have on the route `cut`.
    """

    edge: Vector
    """[n+1] Where the bars are cut, as fractions of the tendon in the sheath, from 0 to 1 [1]."""
    memory: Memory
    """Tension of each bar, displacement and slip of each contact, and what effects remember."""
    displacement_in: float
    """Movement of the drive since the pretensioned state, pulling positive [m]."""
    displacement_out: float
    """Movement of the load since the pretensioned state, towards the tendon positive [m]."""
    elongation: float
    """Elongation of the tendon inside the sheath, above the pretensioned state [m]."""
    direction_index: int
    """ζ: +1 where the proximal end was last pulled, or never moved; −1 where it was last released."""
    length: float
    """Length of the route at the last step [m]."""
    iterations: int = 0
    """Linear solves that the last step took; 0 with effects."""
    cut: Arcs | None = None
    """The route on which the tendon was cut into bars that keep their lengths; None without effects."""
    by_force: bool = True
    """Whether a tension drove the last step, or else a position."""
    span: float = BAR.untimed
    """Time that the last step took [s]."""
    temperature: float = math.nan
    """The first temperature that was given [°C]; NaN before it."""
    lags: Mapping[Channel, tuple[float, ...]] = _NO_LAGS
    """Last true value and reading of each sensor that lags, and what a late recorder has still to read."""
    front: int = 0
    """Contacts, from the proximal end on, that slid when the drive last moved; 0 without effects."""
    model: Model | None = None
    """The rig on the route of the last step; None without effects and in a state that was saved."""
    load_friction: float = 0.0
    """Friction of the load [N]."""

    @property
    def has_effects(self) -> bool:
        """Whether its bars keep their lengths and remember what effects need."""
        return self.cut is not None

    @property
    def tension(self) -> Vector:
        """[n+2] Tension of each bar [N]."""
        return self.memory.tension

    @property
    def slip(self) -> NDArray[np.int8]:
        """[n+1] What each contact did last: +1 slid on a pull, 0 stuck, −1 slid on a release."""
        return self.memory.slip

    @property
    def rest(self) -> Vector | None:
        """[n+2] Stretch of each bar where no contact is displaced [m]; None with effects."""
        return None if self.has_effects else self.memory.rest

    @property
    def slack(self) -> Vector:
        """[n+2] Length that each bar without effects has to be pulled before it carries tension [m]."""
        none, rest = np.zeros(len(self.tension)), self.rest
        if rest is None:
            return none
        ends = np.concatenate(([self.displacement_in], self.memory.displacement, [0.0]))
        return np.where(self.tension > 0.0, none, np.maximum(np.diff(ends) - rest, 0.0))

    @property
    def tension_in(self) -> float:
        """Total tension at the proximal end [N]."""
        return self.memory.block.item(0)

    @property
    def tension_out(self) -> float:
        """Total tension at the distal end, before the friction of the load [N]; docs/model.md (333)."""
        return self.memory.before_load if self.load_friction > 0.0 else self.load_tension

    @property
    def along(self) -> Vector:
        """[n+2] As `tension`, but at the distal end before the friction of the load [N]."""
        return self.tension if self.load_friction == 0.0 else np.append(self.tension[:-1], self.tension_out)

    @property
    def load_tension(self) -> float:
        """Tension that is left behind the friction of the load [N]."""
        return self.memory.block.item(len(self.edge))


def to_bars(state: Corners, arcs: Arcs, rig: Rig, bars: int = BARS, *, halvings: int = 0) -> BarState:
    """Exchange a corner list for bars without effects: the tension at the mean angle of every bar.

    Both advance alike on a fixed route under force drive, so it does not matter when they are exchanged. The
    load is taken for the rig's spring, which sets the displacements; docs/model.md (48). Each of `halvings`
    cuts the first bar in two.
    """
    edge = equal_edges(bars, halvings)
    phi = np.concatenate(([0.0], discretise(edge, arcs).mean_angle, [arcs.total_angle]))
    return bars_with_tension(edge, tension(state, phi), state.direction_index, arcs, rig)


def on_better_route(state: BarState, before: Arcs, now: Arcs, rig: Rig) -> BarState:
    """Move bars without effects to another estimate of the same route; docs/model.md (160)."""
    slope = end_slope(state, before)
    if abs(slope) < AT_LIMIT * rig.friction.coefficient or state.tension.min() <= 0.0:
        return state  # the distal end keeps its tension whatever the angle, and slack has no logarithm
    angles = [
        np.concatenate(([0.0], discretise(state.edge, arcs).mean_angle, [arcs.total_angle]))
        for arcs in (before, now)
    ]
    beyond = np.maximum(angles[1] - before.total_angle, 0.0)
    held = np.exp(np.interp(angles[1], angles[0], np.log(state.tension)) + slope * beyond)
    bars = bars_with_tension(state.edge, held, state.direction_index, now, rig)
    return bars._replace(by_force=state.by_force)


def end_slope(state: BarState, arcs: Arcs) -> float:
    """Return how ln T changes with the curve angle in the last bend [1/rad]; 0 where the end is slack."""
    angle = arcs.total_angle - discretise(state.edge, arcs).mean_angle
    bent = np.flatnonzero(angle > ROUNDING.relative)
    if len(bent) == 0:
        return 0.0
    last, end = float(state.tension[1 + bent[-1]]), float(state.tension[-1])
    return math.log(end / last) / float(angle[bent[-1]]) if min(last, end) > 0.0 else 0.0


def bars_with_tension(edge: Vector, held: Vector, direction_index: int, arcs: Arcs, rig: Rig) -> BarState:
    """Return bars with the tension `held` [n+2] [N] and no slack, displaced as their stretch has them."""
    contacts, pretension = len(edge), rig.tendon.pretension_N
    stiffness = rig.load.stiffness_N_per_m
    softness = np.zeros(contacts + 1)
    softness[1:-1] = rig.tendon.compliance_per_N * discretise(edge, arcs).length
    gained = softness[1:-1] * (held[1:-1] - pretension)
    elongation, moved = float(gained.sum()), load_moved(float(held[-1]), rig)
    softness[-1] = 1.0 / stiffness if stiffness > 0.0 else 0.0
    displacement = moved + np.concatenate((np.cumsum(gained[::-1])[::-1], [0.0]))
    memory = memory_of(held, displacement=displacement, rest=softness * pretension)
    memory.block.setflags(write=False)
    return BarState(
        edge=read_only(edge),
        memory=memory,
        displacement_in=elongation + moved,
        displacement_out=moved,
        elongation=elongation,
        direction_index=direction_index,
        length=arcs.total_length,
    )


def to_corners(edge: Vector, held: Vector, direction_index: int, arcs: Arcs) -> Corners:
    """Exchange bars for a corner list on the route `arcs`: ln T linear in φ between the means of the bars.

    The bars are cut at the fractions `edge` [n+1] and have the tensions `held` [n+2] [N]. The list knows
    neither slack nor displacement, and friction that bounds the slope of ln T over φ; docs/model.md (49).
    """
    count, corners = core.corners_of_bars(edge, held, arcs.length, arcs.angle)
    corners.setflags(write=False)
    return Corners(corners[0, :count], corners[1, :count], direction_index, float(held[0]))
