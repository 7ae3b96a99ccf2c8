"""The tendon after its whole history, whatever its route does: the one state that streams carry along.

As long as the route stays and the tendon is driven by force, the corner list is exact and costs nothing. From
the first change of the route under load, or the first position drive, the tendon goes on as a chain of bars.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.errors import SettingsError
from tssgeom.settings import Load, Rig, Tendon
from tssgeom.shape.arcs import Arcs
from tssgeom.tendon import incremental, profile, transmission
from tssgeom.tendon.incremental import Line
from tssgeom.tendon.material import MaterialState, lay, to_bars, to_corners
from tssgeom.tendon.moving import unmoved
from tssgeom.tendon.profile import Corners
from tssgeom.tendon.transmission import Transmission

VERSION = 1
"""Version of the objects that `state_object` writes."""
HALVINGS = 4
"""The first bar is halved so often: just after a reversal T_in is known to half of that bar."""
_Part = TypeVar("_Part", Corners, MaterialState, Arcs)

_SHARPER = 0.5  # of the old standard error of Φ: so much better known, a route is laid anew
_SOLVED = 1e-8  # ln T of bars within which the front has come through: they are solved to 1e-10


@dataclass(frozen=True, slots=True)
class TendonState:
    """Tension along the tendon, and the route it lies on."""

    along: Corners | MaterialState
    """Corners over the curve angle, or bars of the tendon."""
    route: Arcs | None
    """The route on which the tendon was last laid; None before the first step."""

    @property
    def tension_in(self) -> float:
        """Total tension at the proximal end [N]."""
        return self.along.tension_in

    @property
    def tension_out(self) -> float:
        """Total tension at the distal end of the route [N]."""
        along = self.along
        if isinstance(along, MaterialState):
            return along.tension_out
        return float(profile.tension(along, np.array([_route(self).total_angle]))[0])


def pretensioned(rig: Rig) -> TendonState:
    """Return the tendon before its first pull, on no route yet: the rig's pretension all along."""
    return TendonState(profile.pretensioned(rig), None)


def step(
    state: TendonState,
    arcs: Arcs,
    rig: Rig,
    *,
    tension_in: float | None = None,
    displacement_in: float | None = None,
    stretches_with_route: bool = False,
) -> TendonState:
    """Move the drive and the route at once.

    A route that differs from the one the tendon lies on by no more than the errors of both has not moved:
    noise would shake the tendon along its sheath. Slow drift shows, as the old route stays the measure.

    Parameters
    ----------
    state
        Tension along the tendon before the step.
    arcs
        The route after the step, as sensed.
    rig
        Tendon, friction and load.
    tension_in, displacement_in
        New total tension [N] or new position [m] of the drive; one of them.
    stretches_with_route
        Whether a longer route stretches the tendon; otherwise only more of it lies in view, as on insertion.

    Raises
    ------
    SettingsError
        Where not exactly one drive is given, or where it is negative or not finite.
    FitError
        Where no equilibrium was found.
    """
    before = _before(state, arcs)
    route = before if arcs is before or unmoved(before, arcs) else arcs
    along = state.along
    if isinstance(along, Corners):
        if route is before and displacement_in is None and tension_in is not None:
            return TendonState(profile.step(along, tension_in, rig.friction.coefficient), route)
        along = to_bars(along, before, rig, halvings=HALVINGS)
    bed = lay(along.edge, route)
    tendon = _line(rig.tendon, rig.load, len(bed.length), stretches_with_route)
    cone = incremental.coulomb(bed, rig.friction.coefficient)
    moved = incremental.advance(
        along, bed, cone, tendon, tension_in=tension_in, displacement_in=displacement_in
    )
    return TendonState(moved, route)


def corners(state: TendonState) -> Corners:
    """Return the tension along the tendon as corners over the curve angle of its route; for drawing."""
    if isinstance(state.along, Corners):
        return state.along
    return to_corners(state.along, _route(state))


def tension(state: TendonState, phi: Vector) -> Vector:
    """Return the tension [N] at the accumulated curve angles `phi` [rad]."""
    return profile.tension(corners(state), phi)


def transmit(state: TendonState, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of a tendon on the route it lies on.

    Raises
    ------
    SettingsError
        Where it lies on no route yet.
    """
    route = _route(state)
    found = transmission.transmit(corners(state), route, rig)
    if isinstance(state.along, Corners):
        return found
    return replace(
        found,
        tension_in=state.along.tension_in,
        tension_out=state.along.tension_out,
        elongation=state.along.elongation,
        displacement_in=state.along.displacement_in,
        displacement_out=state.along.displacement_out,
        **_dead_zone(found),
    )


def state_object(state: TendonState) -> dict[str, Any]:
    """Return a state as an object for JSON, from which `state_of` makes the same state to the last bit."""
    kind = "corners" if isinstance(state.along, Corners) else "bars"
    route = None if state.route is None else _plain(state.route)
    return {"version": VERSION, "kind": kind, "along": _plain(state.along), "route": route}


def state_of(saved: Mapping[str, Any]) -> TendonState:
    """Return the state that `state_object` wrote.

    Raises
    ------
    SettingsError
        Where the object is of another version, or is none of a state.
    """
    if saved.get("version") != VERSION:
        raise SettingsError(
            f"the saved state has version {saved.get('version')!r}, this program reads {VERSION}: start anew"
        )
    try:
        kind = {"corners": Corners, "bars": MaterialState}[saved["kind"]]
        route = None if saved["route"] is None else _revived(Arcs, saved["route"])
        return TendonState(_revived(kind, saved["along"]), route)
    except (KeyError, TypeError, ValueError) as error:
        raise SettingsError(f"the saved state is broken ({error!r}): remove it and start anew") from error


def _plain(part: Corners | MaterialState | Arcs) -> dict[str, Any]:
    values = {field.name: getattr(part, field.name) for field in fields(part)}
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()
    }


def _revived(kind: type[_Part], saved: Mapping[str, Any]) -> _Part:
    """Build a part from its plain values; arrays were written as lists."""
    values = {
        name: _array(name, value) if isinstance(value, list) else value for name, value in saved.items()
    }
    return kind(**values)


def _array(name: str, numbers: list[Any]) -> Any:
    if name != "slip":
        return read_only(np.array(numbers, dtype=np.float64))
    slip = np.array(numbers, dtype=np.int8)
    slip.setflags(write=False)
    return slip


def _before(state: TendonState, arcs: Arcs) -> Arcs:
    """Return the route on which the tendon lies before a step that is to end on `arcs`."""
    known, along = state.route, state.along
    if known is None or arcs is known or isinstance(along, MaterialState):
        return arcs if known is None else known
    if len(along.angle) == 1:
        return arcs  # a tension that is the same all along lies as well on any route
    sharper = arcs.total_angle_se < _SHARPER * known.total_angle_se and unmoved(known, arcs)
    return arcs if sharper else known


def _route(state: TendonState) -> Arcs:
    if state.route is None:
        raise SettingsError("the tendon lies on no route yet: step it first")
    return state.route


def _dead_zone(found: Transmission) -> dict[str, bool | float]:
    """Return the dead zone with the accuracy of bars instead of that of corners."""
    inside = found.dead_zone_width > _SOLVED * max(found.tension_in, found.tension_out)
    return {"dead_zone": inside, "dead_zone_width": found.dead_zone_width if inside else 0.0}


@lru_cache(maxsize=64)
def _line(tendon: Tendon, load: Load, bars: int, stretches_with_route: bool) -> Line:
    line = incremental.line(Rig(tendon=tendon, load=load), bars)
    return replace(line, stretches_with_route=stretches_with_route)
