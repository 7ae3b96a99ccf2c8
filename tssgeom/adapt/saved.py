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
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.adapt.saved_parts import (
    MOST,
    alert_of,
    check_memory,
    check_numbers,
    drives_of,
    numbers_of,
    random_numbers,
    random_of,
    require_keys,
    require_sound,
    set_random,
)
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import AnyEffect
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of
from tssgeom.tendon.bars.model import setup_of
from tssgeom.tendon.saved import route_of

_MUTABLE = ("displacement_in_m", *CHANNELS)
_DRIVES = ("tension_in_N", "displacement_in_m")


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
    memory: Matrix
    """[n + 2, numbers]"""
    position: Vector
    """[n + 2] m"""
    distal_error: Vector
    """[2]"""
    muted: tuple[str, ...]
    by_force: bool
    time: float
    """[s]"""
    waiting: float
    """[s]"""
    coldest: float
    """Temperature of the first frame that had one [°C]; NaN without any."""
    drives: Mapping[str, Mapping[str, float | None]]
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
        now.members, now.memory = self.members.copy(), self.memory.copy()
        now.position, now.muted, now.time = self.position.copy(), set(self.muted), self.time
        now._distal_error, now._by_force, now.waiting = (
            self.distal_error[None].copy(),
            self.by_force,
            self.waiting,
        )
        now._lines = straight_lines(whole, numbers, self.about, self.cut, now.edge)
        now._bends = bends_of(setup_of(whole))
        for name, kept in self.drives.items():
            for key, value in kept.items():
                setattr(now._drives[name], key, value)
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
        memory=now.memory.copy(),
        position=now.position.copy(),
        distal_error=now._distal_error.ravel(),
        muted=tuple(sorted(now.muted)),
        by_force=bool(now._by_force),
        time=now.time,
        waiting=now.waiting,
        coldest=coldest,
        drives={name: dict(vars(drive)) for name, drive in now._drives.items()},
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
    arrays = {name: numbers_of(saved[name]) for name in ("about", "memory", "position", "distal_error")}
    require_sound(members.shape == fresh.members.shape, "members")
    sizes = {"about": (width,), "memory": fresh.memory.shape, "position": fresh.position.shape}
    for name, shape in (sizes | {"distal_error": (2,)}).items():
        require_sound(arrays[name].shape == shape, name)
    check_numbers(fresh, members, arrays["about"])
    check_memory(arrays["memory"], len(fresh.edge))
    muted = tuple(saved["muted"])
    require_sound(set(muted) <= set(_MUTABLE), "muted")
    require_sound(isinstance(saved["by_force"], bool), "by_force")
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
        memory=arrays["memory"],
        position=arrays["position"],
        distal_error=arrays["distal_error"],
        muted=muted,
        by_force=saved["by_force"],
        time=scalars["time"],
        waiting=scalars["waiting"],
        coldest=coldest,
        drives=drives_of(saved["drives"], _DRIVES),
        random=random_numbers(saved["random"]),
        **alert_of(saved, _MUTABLE),
    )
