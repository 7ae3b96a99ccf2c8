"""A state as a plain object for JSON, and back to the last bit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from tssgeom.arrays import read_only
from tssgeom.errors import SettingsError
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import MaterialState
from tssgeom.tendon.bars.laws import Memory
from tssgeom.tendon.bars.sensors import CHANNELS
from tssgeom.tendon.bars.with_effects import ActingState
from tssgeom.tendon.capstan import MOST_TENSION, Corners, check_tension
from tssgeom.tendon.state import TendonState

VERSION = 3
"""Version of the objects that `state_object` writes."""
_KINDS = {"corners": Corners, "bars": MaterialState, "acting": ActingState}
_OF_BARS = ("tension", "slack", "inelastic", "creep")
_OF_CONTACTS = ("slip", "place", "speed", "travel")
_SCALARS = {"length", "elongation", "displacement_in", "displacement_out", "span", "front", "iterations"}
_DRIVE = 6  # numbers that the march keeps of the drive
_MOST = 1e12  # of any number in a state
_Part = TypeVar("_Part", Corners, MaterialState, ActingState, Arcs)


def state_object(state: TendonState) -> dict[str, Any]:
    """Return a state as an object for JSON, from which `state_of` makes the same state to the last bit."""
    kind = next(name for name, each in _KINDS.items() if isinstance(state.along, each))
    along = _plain(state.along)
    if isinstance(state.along, ActingState) and state.along.cut is state.route:
        along["cut"] = None
    route = None if state.route is None else _plain(state.route)
    return {
        "version": VERSION,
        "kind": kind,
        "along": along,
        "route": route,
        "time": _told(state.time),
    }


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
        kind = _KINDS[saved["kind"]]
        route = None if saved["route"] is None else _revived(Arcs, saved["route"])
        along = _acting(saved["along"], route) if kind is ActingState else _revived(kind, saved["along"])
        _check(along, route)
        return TendonState(along, route, _time(saved["time"]))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise SettingsError(f"the saved state is broken ({error!r}): remove it and start anew") from error


def _check(along: Corners | MaterialState | ActingState, route: Arcs | None) -> None:
    """Refuse a state that no step could have left: compiled code reads its arrays without a look at sizes.

    Raises
    ------
    ValueError
        With what is wrong.
    """
    for part in (route, along.cut if isinstance(along, ActingState) else None):
        if part is not None:
            _check_route(part)
    if isinstance(along, Corners):
        _check_corners(along)
    else:
        _check_bars(along)
        _require(route is not None, "no route")
    _require(along.direction_index in (-1, 1), "direction_index")


def _check_route(route: Arcs) -> None:
    pieces = len(route.length)
    _require(_numbers(route.length, pieces) and pieces > 0 and route.length.min() > 0.0, "length of pieces")
    _require(_numbers(route.angle, pieces) and route.angle.min() >= 0.0, "angle of pieces")
    _require(_numbers(route.covariance, 2 * pieces, 2 * pieces), "covariance of pieces")


def _check_corners(along: Corners) -> None:
    corners = len(along.angle)
    _require(_numbers(along.angle, corners) and corners > 0 and along.angle[0] == 0.0, "angle of corners")
    _require(bool((np.diff(along.angle) >= 0.0).all()), "angle of corners")
    _require(_numbers(along.log_tension, corners), "log_tension")
    _require(along.log_tension.max() <= math.log(MOST_TENSION), "log_tension")
    check_tension(along.tension_in)


def _check_bars(along: MaterialState | ActingState) -> None:
    contacts = len(along.edge)
    _require(
        _numbers(along.edge, contacts) and contacts > 1 and bool((np.diff(along.edge) > 0).all()), "edge"
    )
    held = along.memory._asdict() if isinstance(along, ActingState) else _parts(along)
    sizes = {
        **dict.fromkeys(_OF_BARS, contacts + 1),
        **dict.fromkeys(_OF_CONTACTS, contacts),
        "drive": _DRIVE,
    }
    for name in sizes.keys() & held.keys():
        _require(_numbers(held[name], sizes[name]), name)
    _require(held["tension"].min() >= 0.0 and held["tension"].max() <= MOST_TENSION, "tension")
    for name in _SCALARS & _parts(along).keys():
        _require(abs(getattr(along, name)) <= _MOST, name)
    if isinstance(along, ActingState):
        _require(isinstance(along.front, int), "front")
        shown = np.array(list(along.lags.values()))
        _require(along.lags.keys() <= set(CHANNELS) and bool((np.abs(shown) <= _MOST).all()), "lags")


def _parts(part: MaterialState | ActingState) -> dict[str, Any]:
    return {field.name: getattr(part, field.name) for field in fields(part)}


def _numbers(values: Any, *size: int) -> bool:
    """Whether values are an array of a size, of numbers that may be."""
    return isinstance(values, np.ndarray) and values.shape == size and bool((np.abs(values) <= _MOST).all())


def _time(saved: Any) -> float:
    time = _untold(saved)
    _require(not math.isinf(time), "time")
    return time


def _require(sound: bool, name: str) -> None:
    if not sound:
        raise ValueError(name)


def _plain(part: Corners | MaterialState | ActingState | Arcs | Memory) -> dict[str, Any]:
    names = part._fields if isinstance(part, Memory) else [field.name for field in fields(part)]
    return {name: _written(getattr(part, name)) for name in names if name != "model"}


def _written(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (Arcs, Memory)):
        return _plain(value)
    if isinstance(value, Mapping):
        return {name: list(pair) for name, pair in value.items()}
    return _told(value)


def _told(value: Any) -> Any:
    """Return the value, or None for NaN, which JSON lacks."""
    return None if isinstance(value, float) and math.isnan(value) else value


def _untold(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _revived(kind: type[_Part], saved: Mapping[str, Any]) -> _Part:
    """Build a part from its plain values; arrays were written as lists."""
    return kind(
        **{name: _array(name, value) if isinstance(value, list) else value for name, value in saved.items()}
    )


def _acting(saved: Mapping[str, Any], route: Arcs | None) -> ActingState:
    memory = Memory(**{name: _array(name, value) for name, value in saved["memory"].items()})
    cut = route if saved["cut"] is None else _revived(Arcs, saved["cut"])
    lags = {channel: (float(given), float(shows)) for channel, (given, shows) in saved["lags"].items()}
    rest = {"memory": memory, "cut": cut, "lags": lags, "temperature": _untold(saved["temperature"])}
    return _revived(ActingState, {**saved, **rest})


def _array(name: str, numbers: list[Any]) -> Any:
    if name != "slip":
        return read_only(np.array(numbers, dtype=np.float64))
    signs = np.array(numbers, dtype=np.int8)
    signs.setflags(write=False)
    return signs
