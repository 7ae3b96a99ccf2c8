"""The mean tendon of a filter, and its rig, as streams carry them; docs/model.md (200), (205)."""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np

from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.followed import with_numbers
from tssgeom.adapt.readings import FollowedRig
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.arrays import Vector, read_only
from tssgeom.core.constants_tendon_rows import MEMORY
from tssgeom.effects.kinds import Setup
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BarState, to_corners
from tssgeom.tendon.bars.model import Model, model_of, moved, setup_of
from tssgeom.tendon.bars.plant import Memory, load_friction
from tssgeom.tendon.bars.with_effects import cut, effective_setup
from tssgeom.tendon.capstan import Transmission
from tssgeom.tendon.moving import unmoved
from tssgeom.tendon.state import SHARPER, TendonState, corners


class CarrySettings(NamedTuple):
    """Numbers of how a stream takes over the estimates of a filter."""

    moved: float = 0.1
    """Change of a number, over its standard error, from which the rig is built anew [1]; chosen: small."""


CARRY = CarrySettings()


def memory_on(state: TendonState, arcs: Arcs, rig: Rig) -> tuple[Memory, float] | None:
    """Return what a tendon with a history remembers, cut on a route, and the position of its drive [m].

    None where it lies on no route yet.
    """
    if state.route is None:
        return None
    bars = cut(corners(state), arcs, setup_of(rig))
    moved_by = state.along.displacement_in if isinstance(state.along, BarState) else bars.displacement_in
    return bars.memory, moved_by


class OnSensedRoute:
    """A rig that is followed, and the route on which its tendons lie.

    Parameters
    ----------
    rig
        The rig as its file has it.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.sensed: Arcs | None = None
        """The route on which the tendons lie, as sensed."""
        self._at: Vector | None = None
        """Numbers from which the rig was built."""

    def lies_on(self, arcs: Arcs) -> Arcs:
        """Return the route on which the tendons lie: as before where it has not moved beyond its errors."""
        known = self.sensed
        if known is not None and known is not arcs and unmoved(known, arcs):
            arcs = arcs if arcs.total_angle_se < SHARPER * known.total_angle_se else known
        self.sensed = arcs
        return arcs

    def refresh(self, now: Ensemble, known: FollowedRig) -> None:
        """Build the rig anew where its numbers have changed."""
        at = self._at
        if at is None or not (np.abs(known.values - at) <= CARRY.moved * known.se).all():
            values = dict(zip(known.keys, known.values.tolist(), strict=True))
            self.rig, self._at = self._built(with_numbers(now.rig, values)), known.values

    def _built(self, rig: Rig) -> Rig:
        return rig

    def restart(self, sensed: Arcs | None, rig: Rig) -> None:
        """Begin with another filter and its rig, its tendons on a route as sensed."""
        self._at, self.sensed, self.rig = None, sensed, rig


class FollowedTendon(OnSensedRoute):
    """What a stream carries of a filter: it is built anew only where it has changed."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self._sensors = rig.sensors
        self._first: tuple[Rig, Arcs, Model] | None = None
        """The model on the route on which the tendon was cut, and of what it is."""
        self._model: tuple[Model, Arcs, Model] | None = None
        """The same on the route on which the tendon lies."""
        self._felt: tuple[Arcs, float, Arcs] | None = None
        self._drive = (math.nan, True)
        self._way, self._front = 1, 0

    def _built(self, rig: Rig) -> Rig:
        return msgspec.structs.replace(rig, sensors=self._sensors)

    def felt(self, sensed: Arcs) -> Arcs:
        """Return the route as the tendon feels it, its angles times the rig's gain."""
        gain = self.rig.route.angle_gain
        if gain == 1.0:
            return sensed
        if self._felt is None or self._felt[0] is not sensed or self._felt[1] != gain:
            self._felt = sensed, gain, sensed.scaled(angle=gain)
        return self._felt[2]

    def state(
        self, now: RigFilter, known: FollowedRig, drive: float, by_force: bool, span: float
    ) -> TendonState:
        """Return the mean tendon after a step whose drive went to [N] or [m]."""
        assert self.sensed is not None
        route, block = self.felt(self.sensed), now.now.memory.mean(axis=0)
        bars = len(now.edge) + 1
        slip = block[MEMORY.slip * bars : (MEMORY.slip + 1) * bars]
        np.rint(slip, out=slip)
        memory = Memory(read_only(block))
        before, force_before = self._drive
        stands = by_force == force_before and drive == before
        if not stands and not math.isnan(before) and by_force == force_before:
            self._way = 1 if drive > before else -1
        self._front = self._slid(slip[: bars - 1], stands)
        self._drive = drive, by_force
        setup, time = effective_setup(self.rig), now.time
        if setup is None:
            along = to_corners(now.edge, memory.tension, self._way, route)
            return TendonState(along, route, time)
        _, _, displacement_in, displacement_out = known.ends.tolist()
        along = BarState(
            edge=now.edge,
            memory=memory,
            displacement_in=displacement_in,
            displacement_out=displacement_out,
            elongation=displacement_in - displacement_out,
            direction_index=self._way,
            length=now.cut.total_length,
            cut=now.cut,
            by_force=by_force,
            span=span,
            front=self._front,
            model=self._model_on(now, setup, route),
            load_friction=load_friction(setup),
        )
        return TendonState(along, route, time)

    def _model_on(self, now: RigFilter, setup: Setup, route: Arcs) -> Model:
        first, last = self._first, self._model
        if first is None or first[0] is not self.rig or first[1] is not now.cut:
            first = self.rig, now.cut, model_of(setup, now.cut, "tension_in_N", now.edge)
            self._first = first
        model = first[2]
        if last is None or last[0] is not model or last[1] is not route:
            last = model, route, model if route is now.cut else moved(model, route)
            self._model = last
        return last[2]

    def _slid(self, slip: Vector, stands: bool) -> int:
        """Return how many contacts from the drive on slid one way; as before where the drive stands."""
        if slip[0] == 0.0:
            return self._front if stands else 0
        others = np.flatnonzero(slip != slip[0])
        return int(others[0]) if len(others) else len(slip)


def with_filter(result: Transmission, known: FollowedRig) -> Transmission:
    """Return what a tendon transmits with the ends of the filter; errors of route and filter add up."""
    tension_in, tension_out, x_in, x_out = known.ends.tolist()
    _, tension_out_se, x_in_se, x_out_se = known.ends_se.tolist()
    return result._replace(
        tension_in=tension_in,
        tension_out=tension_out,
        elongation=x_in - x_out,
        elongation_se=math.hypot(result.elongation_se, x_in_se, x_out_se),
        tension_out_se=math.hypot(result.tension_out_se, tension_out_se),
        displacement_in=x_in,
        displacement_out=x_out,
    )
