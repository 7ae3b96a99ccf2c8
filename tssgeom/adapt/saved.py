"""The filter of a rig and its alert as a plain object for JSON, and back to the last bit."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import msgspec
import numpy as np

from tssgeom.adapt.alert import Alert
from tssgeom.adapt.drive import DriveTracker
from tssgeom.adapt.followed import FollowedNumber, followed_numbers, straight_lines
from tssgeom.adapt.readings import CHANNELS
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants_tendon_rows import HELD, MEMORY
from tssgeom.effects import AnyEffect
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of
from tssgeom.tendon.bars.model import setup_of
from tssgeom.tendon.capstan import MOST_TENSION
from tssgeom.tendon.saved import route_object, route_of

VERSION = 1
"""Version of the objects that `filter_object` writes."""
_MOST = 1e12  # of any number; chosen: as of a tendon's
_BITS = 128  # of each number of the random generator; its own
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
        now._distal_error, now._by_force, now._waiting = self.distal_error.copy(), self.by_force, self.waiting
        now._lines = straight_lines(whole, numbers, self.about, self.cut, now.edge)
        now._bends = bends_of(setup_of(whole))
        for name, kept in self.drives.items():
            for key, value in kept.items():
                setattr(now._drives[name], key, value)
        state = {"state": self.random[0], "inc": self.random[1]}
        now._random.bit_generator.state = {
            "bit_generator": "PCG64",
            "state": state,
            "has_uint32": 0,
            "uinteger": 0,
        }
        return now


def captured(
    now: RigFilter, rig: Rig, sensed: Arcs, measured: tuple[str, ...], coldest: float
) -> SavedFilter:
    """Return what a filter of a `rig` needs to go on; `now` may go on meanwhile."""
    own = tuple(one.key for one in followed_numbers(rig, measured))
    effects = tuple(one for one in now.rig.effects if one not in rig.effects)
    random: Any = now._random.bit_generator.state["state"]
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
        distal_error=now._distal_error.copy(),
        muted=tuple(sorted(now.muted)),
        by_force=bool(now._by_force),
        time=now.time,
        waiting=now._waiting,
        coldest=coldest,
        drives={name: dict(vars(drive)) for name, drive in now._drives.items()},
        random=(random["state"], random["inc"]),
    )


def filter_object(saved: SavedFilter) -> dict[str, Any]:
    """Return a filter as an object for JSON, from which `filter_of` makes the same to the last bit."""
    plain = {field.name: _plain(getattr(saved, field.name)) for field in fields(saved)}
    return plain | {"version": VERSION, "random": [f"{number:x}" for number in saved.random]}


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
        raise SettingsError(f"the saved filter is broken ({error!r}): it is not used") from error


def _checked(saved: Mapping[str, Any], rig: Rig) -> SavedFilter:
    measured = tuple(saved["measured"])
    _require(set(measured) <= set(CHANNELS), "measured")
    more = msgspec.convert(saved["more"], tuple[FollowedNumber, ...])
    effects = msgspec.convert(saved["effects"], tuple[AnyEffect, ...])
    own = tuple(one.key for one in followed_numbers(rig, measured))
    if tuple(saved["keys"]) != own:
        raise SettingsError(
            f"the saved filter follows {', '.join(saved['keys'])}, the rig {', '.join(own)}: it is not used"
        )
    cut, sensed = route_of(saved["cut"]), route_of(saved["sensed"])
    width = len(own) + len(more)
    members = _numbers(saved["members"])
    fresh = RigFilter(
        msgspec.structs.replace(rig, effects=(*rig.effects, *effects)),
        (*followed_numbers(rig, measured), *more),
        cut,
    )
    arrays = {name: _numbers(saved[name]) for name in ("about", "memory", "position", "distal_error")}
    _require(members.shape == fresh.members.shape, "members")
    sizes = {"about": (width,), "memory": fresh.memory.shape, "position": fresh.position.shape}
    for name, shape in (sizes | {"distal_error": (2,)}).items():
        _require(arrays[name].shape == shape, name)
    _check_numbers(fresh, members, arrays["about"])
    _check_memory(arrays["memory"], len(fresh.edge))
    muted = tuple(saved["muted"])
    _require(set(muted) <= set(_MUTABLE), "muted")
    _require(isinstance(saved["by_force"], bool), "by_force")
    scalars = {name: float(saved[name]) for name in ("time", "waiting")}
    _require(all(abs(value) <= _MOST for value in scalars.values()), "time or waiting")
    coldest = math.nan if saved["coldest"] is None else float(saved["coldest"])
    _require(not math.isinf(coldest), "coldest")
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
        drives=_drives(saved["drives"]),
        random=_random(saved["random"]),
        **_alert(saved),
    )


def _alert(saved: Mapping[str, Any]) -> dict[str, Any]:
    """Return the alert, which files of older programs do not have."""
    alert = msgspec.convert(saved.get("alert"), Alert | None)
    disagreed = msgspec.convert(saved.get("disagreed"), float | None)
    _require(alert is None or (alert.channel in _MUTABLE and disagreed is not None), "alert")
    _require(disagreed is None or abs(disagreed) <= _MOST, "disagreed")
    return {"alert": alert, "disagreed": math.nan if disagreed is None else disagreed}


def _check_numbers(fresh: RigFilter, members: Matrix, about: Vector) -> None:
    lower, upper = (np.array([getattr(one, side) for one in fresh.numbers]) for side in ("lower", "upper"))
    _require(bool(((members >= lower) & (members <= upper)).all()), "members out of bounds")
    _require(bool(((about >= lower) & (about <= upper)).all()), "about out of bounds")


def _check_memory(memory: Matrix, contacts: int) -> None:
    bars = contacts + 1
    _require(memory.shape[1] == len(MEMORY) * bars + len(HELD), "memory")
    tension = memory[:, :bars]
    _require(bool((tension >= 0.0).all() and (tension <= MOST_TENSION).all()), "tension")
    slip = memory[:, MEMORY.slip * bars : MEMORY.slip * bars + contacts]
    _require(bool(np.isin(slip, (-1.0, 0.0, 1.0)).all()), "slip")


def _drives(saved: Mapping[str, Any]) -> dict[str, dict[str, float | None]]:
    of = vars(DriveTracker(0.0)).keys()
    _require(tuple(saved) == _DRIVES and all(one.keys() == of for one in saved.values()), "drives")
    for drive in saved.values():
        for name, value in drive.items():
            is_none = value is None and name == "_extreme"
            _require(is_none or (isinstance(value, int | float) and abs(value) <= _MOST), name)
        _require(drive["_way"] in (-1, 1) and drive["_noise"] >= 0.0, "drives")
    return {name: dict(drive) for name, drive in saved.items()}


def _random(saved: Any) -> tuple[int, int]:
    state, increment = (int(text, 16) for text in saved)
    _require(0 <= state < 1 << _BITS and 0 < increment < 1 << _BITS and increment % 2 == 1, "random")
    return state, increment


def _require(sound: bool, name: str) -> None:
    if not sound:
        raise ValueError(name)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value, dtype="<f8").tobytes()
        return {"shape": list(value.shape), "float64": base64.b64encode(data).decode()}
    if isinstance(value, Arcs):
        return route_object(value)
    if isinstance(value, float) and math.isnan(value):
        return None
    if isinstance(value, tuple | Alert):
        return msgspec.to_builtins(value)
    return value


def _numbers(saved: Mapping[str, Any]) -> Any:
    """Return the array that `_plain` wrote, of numbers that may be."""
    values = np.frombuffer(base64.b64decode(saved["float64"], validate=True), dtype="<f8")
    values = values.reshape([int(size) for size in saved["shape"]]).astype(np.float64)
    _require(bool((np.abs(values) <= _MOST).all()), "a number is not finite or too large")
    return values
