"""The filter of a machine as a plain object for JSON, and back to the last bit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import msgspec

from tssgeom.adapt.alert import Alert
from tssgeom.adapt.followed import FollowedNumber, followed_numbers
from tssgeom.adapt.machine_filter import MachineFilter, Standing
from tssgeom.adapt.machine_readings import channels_read
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
from tssgeom.tendon.machine_history import DriveName, Turning
from tssgeom.tendon.saved import route_of


@dataclass(frozen=True, slots=True)
class SavedMachineFilter:
    """All that the filter of a machine needs to go on."""

    keys: tuple[str, ...]
    """Numbers that the rig names."""
    measured: tuple[str, ...]
    """Channels that the first frame measured, but for its drive."""
    more: tuple[FollowedNumber, ...]
    """What is followed beside the numbers that the rig names: mechanisms that explained alerts."""
    effects: tuple[AnyEffect, ...]
    """Effects that the rig lacks."""
    drive: DriveName
    cut: Arcs
    """The route on which the tendons were cut."""
    sensed: Arcs
    """The route on which they lie, as sensed."""
    about: Vector
    """[d]"""
    members: Matrix
    """[members, d]"""
    kept: Mapping[str, Matrix]
    """Where members stand behind the drive: memory, coordinates, plays and lags; NaN where there is none."""
    now: Mapping[str, Matrix]
    """Where they are by now."""
    kept_time: float
    """[s]"""
    committed: Matrix
    """[members, drives]"""
    recent: Matrix | None
    joint: Turning
    muted: tuple[str, ...]
    time: float
    """[s]"""
    waiting: float
    """[s]"""
    drives: Mapping[str, Mapping[str, Any]]
    drift: Matrix
    """[d, 5] As `DriftRate`; NaN where no interval has begun."""
    random: tuple[int, int]
    """State and increment of the generator."""
    alert: Alert | None = None
    """What readings and model disagreed in."""
    disagreed: float = math.nan
    """When they did last [s]."""
    coldest: float = math.nan

    def restored(self, rig: Rig) -> MachineFilter:
        """Return the filter on a rig that states the noise of all channels."""
        numbers = (*followed_numbers(rig, self.measured), *self.more)
        whole = msgspec.structs.replace(rig, effects=(*rig.effects, *self.effects))
        now = MachineFilter(whole, numbers, self.cut, self.drive)
        now.members, now.committed = self.members.copy(), self.committed.copy()
        now.kept, now.now = (_standing(now, one) for one in (self.kept, self.now))
        now.kept_time, now.recent, now.joint = self.kept_time, self.recent, self.joint
        now.muted, now.time, now.waiting = set(self.muted), self.time, self.waiting
        now.draw_lines(self.about)
        now.trackers = tuple(TrailedDrive.of(self.drives[name]) for name in now.drives)
        now.drift.rows = self.drift.copy()
        set_random(now, self.random)
        return now


def captured_machine(
    now: MachineFilter, rig: Rig, sensed: Arcs, measured: tuple[str, ...]
) -> SavedMachineFilter:
    """Return what the filter of a machine needs to go on; `now` may go on meanwhile."""
    own = tuple(one.key for one in followed_numbers(rig, measured))
    return SavedMachineFilter(
        keys=own,
        measured=measured,
        more=now.numbers[len(own) :],
        effects=tuple(one for one in now.rig.effects if one not in rig.effects),
        drive=now.drive,
        cut=now.cut,
        sensed=sensed,
        about=now.about(),
        members=now.members.copy(),
        kept=_plain_standing(now.kept),
        now=_plain_standing(now.now),
        kept_time=now.kept_time,
        committed=now.committed.copy(),
        recent=now.recent,
        joint=now.joint,
        muted=tuple(sorted(now.muted)),
        time=now.time,
        waiting=now.waiting,
        drives={name: one.plain() for name, one in zip(now.drives, now.trackers, strict=True)},
        drift=now.drift.rows.copy(),
        random=random_of(now),
    )


def checked_machine(saved: Mapping[str, Any], rig: Rig) -> SavedMachineFilter:
    """Return what `filter_object` wrote of a machine."""
    measured, channels = tuple(saved["measured"]), channels_read(rig)
    require_sound(set(measured) <= set(channels), "measured")
    more = msgspec.convert(saved["more"], tuple[FollowedNumber, ...])
    effects = msgspec.convert(saved["effects"], tuple[AnyEffect, ...])
    own = followed_numbers(rig, measured)
    require_keys(saved, tuple(one.key for one in own))
    require_sound(saved["drive"] in get_args(DriveName), "drive")
    cut = route_of(saved["cut"])
    whole = msgspec.structs.replace(rig, effects=(*rig.effects, *effects))
    fresh = MachineFilter(whole, (*own, *more), cut, saved["drive"])
    arrays = {name: numbers_of(saved[name]) for name in ("about", "members", "committed")}
    for name, like in (("about", fresh.about()), ("members", fresh.members), ("committed", fresh.committed)):
        require_sound(arrays[name].shape == like.shape, name)
    check_numbers(fresh, arrays["members"], arrays["about"])
    standings = {name: _checked_standing(saved[name], fresh) for name in ("kept", "now")}
    muted = tuple(saved["muted"])
    require_sound(set(muted) <= set(channels), "muted")
    scalars = {name: float(saved[name]) for name in ("time", "waiting", "kept_time")}
    require_sound(all(abs(value) <= MOST for value in scalars.values()), "time or waiting")
    drives = drives_of(saved["drives"], fresh.drives)
    return SavedMachineFilter(
        keys=tuple(one.key for one in own),
        measured=measured,
        more=more,
        effects=effects,
        drive=saved["drive"],
        cut=cut,
        sensed=cut if saved["sensed"] == saved["cut"] else route_of(saved["sensed"]),
        recent=None if saved["recent"] is None else numbers_of(saved["recent"]),
        joint=_turning(saved["joint"]),
        muted=muted,
        drives=drives,
        drift=drift_of(saved["drift"], fresh),
        random=random_numbers(saved["random"]),
        **arrays,
        **standings,
        **scalars,
        **alert_of(saved, channels),
    )


def _plain_standing(one: Standing) -> dict[str, Matrix]:
    return {
        "memory": one.memory.copy(),
        "coordinate": one.coordinate.copy(),
        "block": one.sensed.block.copy(),
    }


def _standing(fresh: MachineFilter, saved: Mapping[str, Matrix]) -> Standing:
    sensed = fresh.now.sensed.with_block(saved["block"].copy())
    return Standing(saved["memory"].copy(), saved["coordinate"].copy(), sensed)


def _checked_standing(saved: Mapping[str, Any], fresh: MachineFilter) -> dict[str, Matrix]:
    arrays = {name: numbers_of(saved[name], may_lack=name == "block") for name in saved}
    like = _plain_standing(fresh.now)
    require_sound(
        {n: one.shape for n, one in arrays.items()} == {n: one.shape for n, one in like.items()}, "now"
    )
    check_memory(arrays["memory"].reshape(len(fresh.members) * fresh.count, -1), len(fresh.machine.edge))
    return arrays


def _turning(saved: Any) -> Turning:
    numbers = [math.nan if one is None else float(one) for one in saved]
    require_sound(not any(math.isinf(one) for one in numbers), "turning")
    return Turning(*numbers)
