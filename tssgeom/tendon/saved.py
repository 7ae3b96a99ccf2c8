"""A state as a plain object for JSON, and back to the last bit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from tssgeom.arrays import read_only
from tssgeom.errors import SettingsError
from tssgeom.shape.arcs import Arcs
from tssgeom.tendon.acting import ActingState
from tssgeom.tendon.material import MaterialState
from tssgeom.tendon.profile import Corners
from tssgeom.tendon.run_laws import Memory
from tssgeom.tendon.state import TendonState

VERSION = 2
"""Version of the objects that `state_object` writes."""
_KINDS = {"corners": Corners, "bars": MaterialState, "acting": ActingState}
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
        return TendonState(along, route, _untold(saved["time"]))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SettingsError(f"the saved state is broken ({error!r}): remove it and start anew") from error


def _plain(part: Corners | MaterialState | ActingState | Arcs | Memory) -> dict[str, Any]:
    names = part._fields if isinstance(part, Memory) else [field.name for field in fields(part)]
    return {name: _written(getattr(part, name)) for name in names if name != "model"}


def _written(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (Arcs, Memory)):
        return _plain(value)
    if isinstance(value, tuple):
        return [[_told(number) for number in pair] for pair in value]
    return _told(value)


def _told(value: Any) -> Any:
    """Return the value, or None for NaN, which JSON lacks."""
    return None if isinstance(value, float) and math.isnan(value) else value


def _untold(value: float | None) -> float:
    return math.nan if value is None else value


def _revived(kind: type[_Part], saved: Mapping[str, Any]) -> _Part:
    """Build a part from its plain values; arrays were written as lists."""
    return kind(
        **{name: _array(name, value) if isinstance(value, list) else value for name, value in saved.items()}
    )


def _acting(saved: Mapping[str, Any], route: Arcs | None) -> ActingState:
    memory = Memory(**{name: _array(name, value) for name, value in saved["memory"].items()})
    cut = route if saved["cut"] is None else _revived(Arcs, saved["cut"])
    lags = tuple((_untold(given), _untold(shows)) for given, shows in saved["lags"])
    rest = {"memory": memory, "cut": cut, "lags": lags, "temperature": _untold(saved["temperature"])}
    return _revived(ActingState, {**saved, **rest})


def _array(name: str, numbers: list[Any]) -> Any:
    if name != "slip":
        return read_only(np.array(numbers, dtype=np.float64))
    signs = np.array(numbers, dtype=np.int8)
    signs.setflags(write=False)
    return signs
