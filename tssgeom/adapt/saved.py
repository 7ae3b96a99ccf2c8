"""The filter of one tendon and its alert as a plain object for JSON, and back to the last bit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from tssgeom.adapt.alert import Alert
from tssgeom.adapt.followed import FollowedNumber, followed_numbers, straight_lines
from tssgeom.adapt.readings import CHANNELS
from tssgeom.adapt.rig_filter import DRIVES, Lying, RigFilter
from tssgeom.adapt.saved_parts import (
    MOST,
    alert_of,
    check_memory,
    check_numbers,
    drift_of,
    drives_of,
    numbers_of,
    random_numbers,
    random_of,
    require_keys,
    require_sound,
    set_random,
)
from tssgeom.adapt.trailed_drive import TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import AnyEffect
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of
from tssgeom.tendon.bars.model import setup_of
from tssgeom.tendon.saved import route_of

_MUTABLE = ("displacement_in_m", *CHANNELS)


@dataclass(frozen=True, slots=True)
class SavedFilter:
    """All that a filter needs to go on."""

    keys: tuple[str, ...]
    """Numbers that the rig names."""
    measured: tuple[str, ...]
    """Tensions that the first frame measured."""
    more: tuple[FollowedNumber, ...]
    """What is followed beside the numbers that the rig names: mechanisms that explained alerts."""
    effects: tuple[AnyEffect, ...]
    """Effects that the rig lacks."""
    cut: Arcs
    """The route on which the tendon was cut."""
    sensed: Arcs
    """The route on which it lies, as sensed."""
    about: Vector
    """[d]"""
    members: Matrix
    """[n, d]"""
    now: Mapping[str, Any]
    """Where the members are by now."""
    kept: Mapping[str, Any]
    """Where they are behind the drive for sure."""
    committed: Vector
    """[n] What the sensor of the drive reads there."""
    muted: tuple[str, ...]
    time: float
    """[s]"""
    waiting: float
    """[s]"""
    coldest: float
    """Temperature of the first frame that had one [°C]; NaN without any."""
    drives: Mapping[str, Mapping[str, Any]]
    drift: Matrix
    """[d, 5] As `DriftRate`; NaN where no interval has begun."""
    random: tuple[int, int]
    """State and increment of the generator."""
    alert: Alert | None = None
    """What readings and model disagreed in."""
    disagreed: float = math.nan
    """When they did last [s]."""

    def restored(self, rig: Rig) -> RigFilter:
        """Return the filter on a rig that states the noise of all channels."""
        numbers = (*followed_numbers(rig, self.measured), *self.more)
        whole = msgspec.structs.replace(rig, effects=(*rig.effects, *self.effects))
        now = RigFilter(whole, numbers, self.cut)
        now.members, now.committed = self.members.copy(), self.committed.copy()
        now.now, now.kept = (_lying(one) for one in (self.now, self.kept))
        now.muted, now.time, now.waiting = set(self.muted), self.time, self.waiting
        now._lines = straight_lines(whole, numbers, self.about, self.cut, now.edge)
        now._bends = bends_of(setup_of(whole))
        now.drives = {name: TrailedDrive.of(kept) for name, kept in self.drives.items()}
        now.drift.rows = self.drift.copy()
        set_random(now, self.random)
        return now


def captured(
    now: RigFilter, rig: Rig, sensed: Arcs, measured: tuple[str, ...], coldest: float
) -> SavedFilter:
    """Return what a filter of a `rig` needs to go on; `now` may go on meanwhile."""
    own = tuple(one.key for one in followed_numbers(rig, measured))
    effects = tuple(one for one in now.rig.effects if one not in rig.effects)
    return SavedFilter(
        keys=own,
        measured=measured,
        more=now.numbers[len(own) :],
        effects=effects,
        cut=now.cut,
        sensed=sensed,
        about=now._lines.about,
        members=now.members.copy(),
        now=_plain_lying(now.now),
        kept=_plain_lying(now.kept),
        committed=now.committed.copy(),
        muted=tuple(sorted(now.muted)),
        time=now.time,
        waiting=now.waiting,
        coldest=coldest,
        drives={name: drive.plain() for name, drive in now.drives.items()},
        drift=now.drift.rows.copy(),
        random=random_of(now),
    )


def checked_filter(saved: Mapping[str, Any], rig: Rig) -> SavedFilter:
    """Return what `filter_object` wrote of one tendon."""
    measured = tuple(saved["measured"])
    require_sound(set(measured) <= set(CHANNELS), "measured")
    more = msgspec.convert(saved["more"], tuple[FollowedNumber, ...])
    effects = msgspec.convert(saved["effects"], tuple[AnyEffect, ...])
    own = tuple(one.key for one in followed_numbers(rig, measured))
    require_keys(saved, own)
    cut, sensed = route_of(saved["cut"]), route_of(saved["sensed"])
    width = len(own) + len(more)
    members = numbers_of(saved["members"])
    fresh = RigFilter(
        msgspec.structs.replace(rig, effects=(*rig.effects, *effects)),
        (*followed_numbers(rig, measured), *more),
        cut,
    )
    arrays = {name: numbers_of(saved[name]) for name in ("about", "committed")}
    require_sound(members.shape == fresh.members.shape, "members")
    for name, shape in {"about": (width,), "committed": fresh.committed.shape}.items():
        require_sound(arrays[name].shape == shape, name)
    check_numbers(fresh, members, arrays["about"])
    muted = tuple(saved["muted"])
    require_sound(set(muted) <= set(_MUTABLE), "muted")
    scalars = {name: float(saved[name]) for name in ("time", "waiting")}
    require_sound(all(abs(value) <= MOST for value in scalars.values()), "time or waiting")
    coldest = math.nan if saved["coldest"] is None else float(saved["coldest"])
    require_sound(not math.isinf(coldest), "coldest")
    return SavedFilter(
        keys=own,
        measured=measured,
        more=more,
        effects=effects,
        cut=cut,
        sensed=cut if saved["sensed"] == saved["cut"] else sensed,
        members=members,
        about=arrays["about"],
        now=_checked_lying(saved["now"], fresh),
        kept=_checked_lying(saved["kept"], fresh),
        committed=arrays["committed"],
        muted=muted,
        time=scalars["time"],
        waiting=scalars["waiting"],
        coldest=coldest,
        drives=drives_of(saved["drives"], DRIVES),
        drift=drift_of(saved["drift"], fresh),
        random=random_numbers(saved["random"]),
        **alert_of(saved, _MUTABLE),
    )


def _plain_lying(one: Lying) -> dict[str, Any]:
    return {
        "memory": one.memory.copy(),
        "position": one.position.copy(),
        "by_force": bool(one.by_force),
        "time": one.time,
    }


def _lying(saved: Mapping[str, Any]) -> Lying:
    return Lying(saved["memory"].copy(), saved["position"].copy(), saved["by_force"], saved["time"])


def _checked_lying(saved: Mapping[str, Any], fresh: RigFilter) -> dict[str, Any]:
    memory, position = numbers_of(saved["memory"]), numbers_of(saved["position"])
    require_sound(memory.shape == fresh.now.memory.shape, "memory")
    require_sound(position.shape == fresh.now.position.shape, "position")
    check_memory(memory, len(fresh.edge))
    time = float(saved["time"])
    require_sound(isinstance(saved["by_force"], bool) and abs(time) <= MOST, "by_force or time")
    return {"memory": memory, "position": position, "by_force": saved["by_force"], "time": time}
