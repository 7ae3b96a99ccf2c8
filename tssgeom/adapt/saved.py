"""A filter and its alert as a plain object for JSON, and back to the last bit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, get_args

import msgspec
import numpy as np

from tssgeom.adapt.alert import Alert
from tssgeom.adapt.drive_path import DrivePath
from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.followed import FollowedNumber, followed_numbers
from tssgeom.adapt.machine_filter import MachineFilter
from tssgeom.adapt.machine_readings import channels_read
from tssgeom.adapt.members import Standing
from tssgeom.adapt.readings import CHANNELS
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.adapt.saved_parts import (
    MOST,
    VERSION,
    alert_of,
    check_memory,
    check_numbers,
    drift_of,
    drives_of,
    more_of,
    numbers_of,
    plain,
    random_numbers,
    random_of,
    require_keys,
    set_random,
)
from tssgeom.adapt.trailed_drive import TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import AnyEffect
from tssgeom.errors import SettingsError, fault_of
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine_history import DriveName, Turning
from tssgeom.tendon.saved import require, route_of

_STANDING_OF_MACHINE = ("memory", "coordinate", "block")
_OF_MACHINE = {"drive", "recent", "joint", "path"}


@dataclass(frozen=True, slots=True)
class SavedFilter:
    """All that a filter needs to go on."""

    keys: tuple[str, ...]
    """Numbers that the rig names."""
    measured: tuple[str, ...]
    """Channels that the first frame measured; of a machine but for its drive."""
    more: tuple[FollowedNumber, ...]
    """What is followed beside the numbers that the rig names: mechanisms that explained alerts."""
    effects: tuple[AnyEffect, ...]
    """Effects that the rig lacks."""
    cut: Arcs
    """The route on which the tendons were cut."""
    sensed: Arcs
    """The route on which they lie, as sensed."""
    about: Vector
    """[d]"""
    members: Matrix
    """[n, d]"""
    now: Standing
    """Where the members are by now."""
    kept: Standing
    """Where they are behind the drives for sure."""
    committed: Matrix
    """[n, drives] What the sensors of the drives read there."""
    muted: tuple[str, ...]
    time: float
    """[s]"""
    waiting: float
    """[s]"""
    coldest: float
    """Temperature of the first frame that had one [°C]; NaN without any."""
    drives: Mapping[str, Mapping[str, Any]]
    drift: Matrix
    """[d, …] As `DriftRate`; NaN where no interval has begun."""
    random: tuple[int, int]
    """State and increment of the generator."""
    alert: Alert | None = None
    """What readings and model disagreed in."""
    disagreed: float = math.nan
    """When they did last [s]."""
    drive: DriveName | None = None
    """What drives a machine; None of one tendon."""
    recent: Matrix | None = None
    joint: Turning | None = None
    path: DrivePath | None = None
    """As a `MachineFilter` has them."""

    def restored(self, rig: Rig) -> Ensemble:
        """Return the filter on a rig that states the noise of all channels."""
        numbers = (*followed_numbers(rig, self.measured), *self.more)
        now = _fresh(rig, self.effects, numbers, self.cut, self.drive)
        now.members, now.committed = self.members.copy(), self.committed.copy()
        now.now, now.kept = self.now.copied(), self.kept.copied()
        now.muted, now.time, now.waiting = set(self.muted), self.time, self.waiting
        now.draw_lines(self.about)
        now.trackers = {name: TrailedDrive.of(one) for name, one in self.drives.items()}
        now.drift.set_rows(self.drift)
        if isinstance(now, MachineFilter):
            assert self.joint is not None
            now.recent, now.joint, now.path = self.recent, self.joint, _copied(self.path)
        set_random(now, self.random)
        return now


def _fresh(
    rig: Rig,
    effects: Sequence[AnyEffect],
    numbers: Sequence[FollowedNumber],
    cut: Arcs,
    drive: DriveName | None,
) -> Ensemble:
    whole = msgspec.structs.replace(rig, effects=(*rig.effects, *effects))
    return RigFilter(whole, numbers, cut) if drive is None else MachineFilter(whole, numbers, cut, drive)


def captured(now: Ensemble, rig: Rig, sensed: Arcs, measured: tuple[str, ...], coldest: float) -> SavedFilter:
    """Return what a filter of a `rig` needs to go on; `now` may go on meanwhile."""
    own = tuple(one.key for one in followed_numbers(rig, measured))
    of_machine = {name: getattr(now, name) for name in _OF_MACHINE if isinstance(now, MachineFilter)}
    if of_machine:
        of_machine["path"] = _copied(now.path)
    return SavedFilter(
        keys=own,
        measured=measured,
        more=now.numbers[len(own) :],
        effects=tuple(one for one in now.rig.effects if one not in rig.effects),
        cut=now.cut,
        sensed=sensed,
        about=now.about,
        members=now.members.copy(),
        now=now.now.copied(),
        kept=now.kept.copied(),
        committed=now.committed.copy(),
        muted=tuple(sorted(now.muted)),
        time=now.time,
        waiting=now.waiting,
        coldest=coldest,
        drives={name: one.plain() for name, one in now.trackers.items()},
        drift=now.drift.rows,
        random=random_of(now),
        **of_machine,
    )


def filter_object(saved: SavedFilter) -> dict[str, Any]:
    """Return a filter as an object for JSON, from which `filter_of` makes the same to the last bit."""
    values = {field.name: getattr(saved, field.name) for field in fields(saved)}
    if saved.drive is None:
        values = {name: one for name, one in values.items() if name not in _OF_MACHINE}
        values["committed"] = saved.committed[:, 0]
    else:
        values["kept_time"] = saved.kept.time
        values["path"] = None if saved.path is None else _path_object(saved.path)
    names = _standing_names(saved.drive, saved.now)
    for standing in ("now", "kept"):
        values[standing] = {name: getattr(values[standing], name) for name in names}
    written = {name: plain(value) for name, value in values.items()}
    return written | {"version": VERSION, "random": [f"{number:x}" for number in saved.random]}


def _copied(path: DrivePath | None) -> DrivePath | None:
    return None if path is None else path.copied()


def _path_object(path: DrivePath) -> dict[str, Any]:
    start = {name: getattr(path.start, name) for name in _STANDING_OF_MACHINE}
    return {**path.plain(), "start": start, "time": path.start.time}


def _standing_names(drive: DriveName | None, at: Standing) -> tuple[str, ...]:
    """Return which fields of where members stand are saved; of one tendon what sensors keep, if they do."""
    if drive is not None:
        return _STANDING_OF_MACHINE
    return ("memory", "position", "by_force", "time", *(["block"] if at.block.shape[1] else []))


def filter_of(saved: Any, rig: Rig) -> SavedFilter:
    """Return what `filter_object` wrote.

    Raises
    ------
    SettingsError
        Where it is of another version, is none of a filter, or follows other numbers than the rig names.
    """
    try:
        version = saved.get("version")
        if version != VERSION:
            raise SettingsError(
                f"the saved filter has version {version!r}, this program reads {VERSION}: it is not used"
            )
        return _checked(saved, rig)
    except SettingsError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, msgspec.MsgspecError) as error:
        raise SettingsError(f"the saved filter is broken ({fault_of(error)}): it is not used") from error


def _checked(saved: Mapping[str, Any], rig: Rig) -> SavedFilter:
    channels = channels_read(rig) if rig.is_machine else CHANNELS
    mutable = channels if rig.is_machine else ("displacement_in_m", *CHANNELS)
    measured, muted = tuple(saved["measured"]), tuple(saved["muted"])
    require(set(measured) <= set(channels), "measured")
    require(set(muted) <= set(mutable), "muted")
    more = more_of(saved["more"])
    effects = msgspec.convert(saved["effects"], tuple[AnyEffect, ...])
    own = followed_numbers(rig, measured)
    require_keys(saved, tuple(one.key for one in own))
    drive = saved["drive"] if rig.is_machine else None
    require(not rig.is_machine or drive in get_args(DriveName), "drive")
    cut = route_of(saved["cut"])
    fresh = _fresh(rig, effects, (*own, *more), cut, drive)
    arrays = {name: numbers_of(saved[name]) for name in ("about", "members", "committed")}
    arrays["committed"] = arrays["committed"].reshape(len(fresh.members), -1)
    for name, one in arrays.items():
        require(one.shape == getattr(fresh, name).shape, name)
    check_numbers(fresh, arrays["members"], arrays["about"])
    time, waiting = float(saved["time"]), float(saved["waiting"])
    kept_time = float(saved["kept_time"]) if rig.is_machine else time
    require(all(abs(one) <= MOST for one in (time, waiting, kept_time)), "time or waiting")
    coldest = math.nan if saved.get("coldest") is None else float(saved["coldest"])
    require(not math.isinf(coldest), "coldest")
    if rig.is_machine:
        recent = None if saved["recent"] is None else numbers_of(saved["recent"])
        path = None if saved.get("path") is None else _path_of(saved["path"], fresh, drive)
        of_machine = {"drive": drive, "recent": recent, "joint": _turning(saved["joint"]), "path": path}
    else:
        of_machine = {}
    return SavedFilter(
        keys=tuple(one.key for one in own),
        measured=measured,
        more=more,
        effects=effects,
        cut=cut,
        sensed=cut if saved["sensed"] == saved["cut"] else route_of(saved["sensed"]),
        now=_standing(saved["now"], fresh, drive, time),
        kept=_standing(saved["kept"], fresh, drive, kept_time),
        muted=muted,
        time=time,
        waiting=waiting,
        coldest=coldest,
        drives=drives_of(saved["drives"], tuple(fresh.trackers)),
        drift=drift_of(saved["drift"], fresh),
        random=random_numbers(saved["random"]),
        **arrays,
        **of_machine,
        **alert_of(saved, mutable),
    )


def _standing(saved: Mapping[str, Any], fresh: Ensemble, drive: DriveName | None, time: float) -> Standing:
    """Return where members stand, at a time [s] where that is not saved with it."""
    values = dict[str, Any]()
    for name in _standing_names(drive, fresh.now):
        like = getattr(fresh.now, name)
        if isinstance(like, np.ndarray):
            values[name] = numbers_of(saved[name], may_lack=name == "block")
            require(values[name].shape == like.shape, name)
        else:
            values[name] = float(saved[name]) if name == "time" else saved[name]
    require(isinstance(values.get("by_force", False), bool), "by_force")
    one = replace(fresh.now, **{"time": time, **values})
    require(abs(one.time) <= MOST, "time")
    check_memory(one.memory.reshape(len(fresh.members) * fresh.count, -1), len(fresh.edge))
    return one


def _path_of(saved: Mapping[str, Any], fresh: Ensemble, drive: DriveName | None) -> DrivePath:
    time = float(saved["time"])
    kept = {name: numbers_of(saved[name]) for name in ("committed", "values", "steps", "turns")}
    count, drives = fresh.committed.shape
    require(kept["committed"].shape == (count, drives), "path")
    for name, columns in (("values", drives), ("turns", 2 + count)):
        require(kept[name].ndim == 2 and kept[name].shape[1] == columns, "path")
    readings = range(len(kept["values"]))
    require(kept["steps"].ndim == 1, "path")
    require(all(one in readings for one in (*kept["steps"], *kept["turns"][:, 1])), "path")
    require(all(one in range(drives) for one in kept["turns"][:, 0]), "path")
    return DrivePath.of(_standing(saved["start"], fresh, drive, time), kept)


def _turning(saved: Any) -> Turning:
    numbers = [math.nan if one is None else float(one) for one in saved]
    require(not any(math.isinf(one) for one in numbers), "turning")
    return Turning(*numbers)
