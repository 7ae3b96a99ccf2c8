"""The state of a tendon of bars, with or without effects, and its exchange for a list of corners.

Source: docs/model.md (48), (49), (51).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from tssgeom.arrays import Vector, read_only
from tssgeom.effects import Channel
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import discretise, discretised, equal_edges
from tssgeom.tendon.bars.model import Model
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.capstan import RESOLUTION, SLACK, Corners, load_moved, tension

BARS = 60
"""Bars of a tendon without effects, where nothing else is asked for."""
UNTIMED = 1.0
"""A step without a time, and the first one of a stream, is taken to last so long [s]."""


@dataclass(frozen=True, slots=True)
class BarState:
    """A tendon of bars: their tension, their contacts with the sheath, and both of its ends.

    Bar 0 is what drives the proximal end, the last bar what the distal end pulls against; between them are
    the n bars of the tendon in the sheath. Contacts with the sheath lie between neighbours. A state without
    effects follows the sensed length of its route and holds `rest`; one with effects keeps the lengths that
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
    rest: Vector | None = None
    """[n+2] Stretch of each bar where no contact is displaced [m]; None with effects."""
    iterations: int = 0
    """Linear solves that the last step took; 0 with effects."""
    cut: Arcs | None = None
    """The route on which the tendon was cut into bars that keep their lengths; None without effects."""
    by_force: bool = True
    """Whether a tension drove the last step, or else a position."""
    span: float = UNTIMED
    """Time that the last step took [s]."""
    temperature: float = math.nan
    """The first temperature that was given [°C]; NaN before it."""
    lags: Mapping[Channel, tuple[float, float]] = field(default_factory=dict[Channel, tuple[float, float]])
    """Last true value and last reading of each sensor that lags."""
    front: int = 0
    """Contacts, from the proximal end on, that slid when the drive last moved; 0 without effects."""
    model: Model | None = None
    """The rig on the route of the last step; None without effects and in a state that was saved."""

    @property
    def has_effects(self) -> bool:
        """Whether its bars keep their lengths and remember what effects need."""
        return self.cut is not None

    @property
    def tension(self) -> Vector:
        """[n+2] Tension of each bar [N]."""
        return self.memory.tension

    @property
    def slip(self) -> Vector:
        """[n+1] What each contact did last: +1 slid on a pull, 0 stuck, −1 slid on a release."""
        return self.memory.slip

    @property
    def slack(self) -> Vector:
        """[n+2] Length that each bar without effects has to be pulled before it carries tension [m]."""
        none = np.zeros(len(self.tension))
        if self.rest is None:
            return none
        ends = np.concatenate(([self.displacement_in], self.memory.displacement, [0.0]))
        return np.where(self.tension > 0.0, none, np.maximum(np.diff(ends) - self.rest, 0.0))

    @property
    def tension_in(self) -> float:
        """Total tension at the proximal end [N]."""
        return float(self.memory.tension[0])

    @property
    def tension_out(self) -> float:
        """Total tension at the distal end [N]."""
        return float(self.memory.tension[-1])


def pretensioned_bars(rig: Rig, arcs: Arcs, bars: int = BARS, *, halvings: int = 0) -> BarState:
    """Return the tendon before its first pull, cut into equal bars: the rig's pretension all along.

    Each of `halvings` cuts the first and the last bar in two.
    """
    edge = equal_edges(bars, halvings, halvings)
    return _with_tension(edge, np.full(len(edge) + 1, rig.tendon.pretension_N), 1, arcs, rig)


def to_bars(state: Corners, arcs: Arcs, rig: Rig, bars: int = BARS, *, halvings: int = 0) -> BarState:
    """Exchange a corner list for bars without effects: the tension at the mean angle of every bar.

    Both advance alike on a fixed route under force drive, so it does not matter when they are exchanged. The
    load is taken for the rig's spring, which sets the displacements; docs/model.md (48). Each of `halvings`
    cuts the first bar in two.
    """
    edge = equal_edges(bars, halvings)
    phi = np.concatenate(([0.0], discretise(edge, arcs).mean_angle, [arcs.total_angle]))
    return _with_tension(edge, tension(state, phi), state.direction_index, arcs, rig)


def _with_tension(edge: Vector, held: Vector, direction_index: int, arcs: Arcs, rig: Rig) -> BarState:
    """Return bars with the tension `held` [n+2] [N] and no slack, displaced as their stretch has them."""
    contacts, pretension = len(edge), rig.tendon.pretension_N
    stiffness = rig.load.stiffness_N_per_m
    softness = np.zeros(contacts + 1)
    softness[1:-1] = rig.tendon.compliance_per_N * discretise(edge, arcs).length
    gained = softness[1:-1] * (held[1:-1] - pretension)
    elongation, moved = float(gained.sum()), load_moved(float(held[-1]), rig)
    softness[-1] = 1.0 / stiffness if stiffness > 0.0 else 0.0
    memory = Memory(
        tension=held,
        displacement=moved + np.concatenate((np.cumsum(gained[::-1])[::-1], [0.0])),
        speed=np.zeros(contacts),
        travel=np.zeros(contacts),
        creep=np.zeros(contacts + 1),
        slip=np.zeros(contacts, dtype=np.int8),
        drive=np.zeros(6),
    )
    for array in memory:
        array.setflags(write=False)
    rest = read_only(softness * pretension)
    return BarState(
        edge=read_only(edge),
        memory=memory,
        displacement_in=elongation + moved,
        displacement_out=moved,
        elongation=elongation,
        direction_index=direction_index,
        length=arcs.total_length,
        rest=rest,
    )


def to_corners(edge: Vector, held: Vector, direction_index: int, arcs: Arcs) -> Corners:
    """Exchange bars for a corner list on the route `arcs`: ln T linear in φ between the means of the bars.

    The bars are cut at the fractions `edge` [n+1] and have the tensions `held` [n+2] [N]. The list knows
    neither slack nor displacement, and friction that bounds the slope of ln T over φ; docs/model.md (49).
    """
    angle, log_tension = through_bars(edge, held, arcs.length, arcs.angle, arcs.total_angle)
    return Corners(read_only(angle), read_only(log_tension), direction_index, float(held[0]))


@njit(cache=True, nogil=True)
def _corners(phi, log_tension):
    """Return which points are needed: of points at one angle the last, of points on one line its ends."""
    keep = np.zeros(phi.size, dtype=np.bool_)
    keep[0] = True
    last = 0
    for i in range(1, phi.size - 1):
        if phi[i + 1] <= phi[i] or phi[i] <= phi[last]:
            continue
        here = (log_tension[i] - log_tension[last]) / (phi[i] - phi[last])
        bend = (log_tension[i + 1] - log_tension[i]) / (phi[i + 1] - phi[i]) - here
        if abs(bend) * (phi[i + 1] - phi[last]) > 1e3 * RESOLUTION:
            keep[i] = True
            last = i
    keep[-1] = phi[-1] > phi[last]
    return keep


@njit(cache=True, nogil=True)
def through_bars(edge, held, piece_length, piece_angle, turned):
    """Return φ and ln T of the corners through bars on a route that turns by `turned` [rad], [ln N]."""
    _, mean_angle, _, _ = discretised(edge, piece_length, piece_angle)
    end = turned * (1.0 + 0.1 * RESOLUTION)  # rounding shall not leave the distal end beyond the last corner
    return _profile(mean_angle, end, held)


@njit(cache=True, nogil=True)
def _profile(mean_angle, end, tension):
    """Return φ and ln T of the corners through the means of the bars and both ends, as few as are needed."""
    phi, log_tension = np.empty(tension.size), np.empty(tension.size)
    phi[0], phi[1:-1], phi[-1] = 0.0, mean_angle, end
    for i in range(tension.size):
        log_tension[i] = np.log(tension[i]) if tension[i] > 0.0 else SLACK
    keep = _corners(phi, log_tension)
    return phi[keep], log_tension[keep]
