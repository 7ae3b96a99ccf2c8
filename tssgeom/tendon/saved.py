"""A state as a plain object for JSON, and back to the last bit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from tssgeom.arrays import read_only
from tssgeom.core.constants_tendon_rows import HELD
from tssgeom.errors import SettingsError, broken_state
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.bars.plant import Memory, memory_of
from tssgeom.tendon.bars.sensors import CHANNELS
from tssgeom.tendon.capstan import MOST_TENSION, Corners, check_tension
from tssgeom.tendon.state import TendonState

VERSION = 5
"""Version of the objects that `state_object` writes; `state_of` reads versions 3 and 4 too."""
_KINDS = {"corners": Corners, "bars": BarState}
_ROUTE = "route"  # stands for the route of the state where the bars were cut on it
_OF_BARS = ("tension", "creep", "creep_2", "creep_3")
_OF_CONTACTS = ("displacement", "speed", "travel", "slip")
_MEMORY = (*_OF_BARS, *_OF_CONTACTS, "drive")
_SCALARS = (
    "length",
    "elongation",
    "displacement_in",
    "displacement_out",
    "front",
    "iterations",
    "load_friction",
)
_DRIVE = len(HELD)  # numbers that bars with effects remember of their drive
_MOST = 1e12  # of any number in a state
_Part = TypeVar("_Part", Corners, BarState, Arcs)


def state_object(state: TendonState) -> dict[str, Any]:
    """Return a state as an object for JSON, from which `state_of` makes the same state to the last bit."""
    kind = next(name for name, each in _KINDS.items() if isinstance(state.along, each))
    along = _plain(state.along)
    if isinstance(state.along, BarState):
        memory = state.along.memory
        along["memory"] = {name: getattr(memory, name).tolist() for name in _MEMORY}
        if state.along.load_friction > 0.0:
            along["memory"]["travel"].append(memory.before_load)
        along["rest"] = _written(state.along.rest)
        if state.along.has_effects and state.along.cut is state.route:
            along["cut"] = _ROUTE
    route = None if state.route is None else _plain(state.route)
    return {
        "version": VERSION,
        "kind": kind,
        "along": along,
        "route": route,
        "time": _or_none(state.time),
        "tension_out_se": state.tension_out_se,
    }


def state_of(saved: Mapping[str, Any]) -> TendonState:
    """Return the state that `state_object` wrote.

    Raises SettingsError where the object is of another version, or is none of a state.
    """
    if saved.get("version") not in (3, 4, VERSION):
        raise SettingsError(
            f"the saved state has version {saved.get('version')!r}, this program reads {VERSION}: start anew"
        )
    try:
        saved = _of_version_3(saved) if saved["version"] == 3 else saved
        saved = saved if saved["version"] == VERSION else _of_version_4(saved)
        route = None if saved["route"] is None else _revived(Arcs, saved["route"])
        is_bars = _KINDS[saved["kind"]] is BarState
        along = _bars(saved["along"], route) if is_bars else _revived(Corners, saved["along"])
        _check(along, route)
        error = float(saved.get("tension_out_se", 0.0))
        require(0.0 <= error <= _MOST, "tension_out_se")
        return TendonState(along, route, _time(saved["time"]), error)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise broken_state(error) from error


def route_object(route: Arcs) -> dict[str, Any]:
    """Return a route as an object for JSON, from which `route_of` makes the same to the last bit."""
    return _plain(route)


def route_of(saved: Mapping[str, Any]) -> Arcs:
    """Return the route that `route_object` wrote; a ValueError or its like where it is none."""
    route = _revived(Arcs, saved)
    _check_route(route)
    return route


def _of_version_3(saved: Mapping[str, Any]) -> dict[str, Any]:
    """Return the object of a version in which bars with and without effects were two kinds."""
    along = dict(saved["along"])
    if saved["kind"] == "bars":
        along = _with_memory(along)
    elif saved["kind"] == "acting":
        along |= {"cut": along["cut"] or _ROUTE, "rest": None, "iterations": 0, "length": 0.0}
        memory = {"displacement" if name == "place" else name: v for name, v in along["memory"].items()}
        along["memory"] = memory
        along["elongation"] = along["displacement_in"] - along["displacement_out"]
    return {**saved, "kind": "corners" if saved["kind"] == "corners" else "bars", "along": along}


def _of_version_4(saved: Mapping[str, Any]) -> dict[str, Any]:
    """Return the object of a version with one element of creep, whose runs had no clock."""
    along = dict(saved["along"])
    if saved["kind"] == "bars":
        memory = dict(along["memory"])
        memory["drive"] = [*memory["drive"], 0.0][:_DRIVE]
        none = [0.0] * len(memory["creep"])
        along["memory"] = memory | {"creep_2": none, "creep_3": none}
    return {**saved, "along": along}


@np.errstate(invalid="ignore")  # an infinite position is refused with the rest
def _with_memory(along: dict[str, Any]) -> dict[str, Any]:
    """Return bars without effects in the form of today, with contacts anywhere between both ends."""
    tension, slack, slip = (along.pop(name) for name in ("tension", "slack", "slip"))
    del along["inelastic"]
    first, last = along["displacement_in"] + slack[0], along["displacement_out"] - slack[-1]
    moved = np.linspace(first, last, len(slip))
    stretch = -np.diff(np.concatenate(([along["displacement_in"]], moved, [0.0])))
    none = [0.0] * len(tension)
    along["memory"] = {
        "tension": tension,
        "displacement": moved.tolist(),
        "speed": none[1:],
        "travel": none[1:],
        "creep": none,
        "slip": slip,
        "drive": [0.0] * _DRIVE,
    }
    rest = -np.array(slack) - stretch  # a bar that is taut takes it from its tension in the next step
    state = {"cut": None, "by_force": True, "span": 1.0, "temperature": None, "lags": {}, "front": 0}
    return {**along, **state, "rest": rest.tolist()}


def _check(along: Corners | BarState, route: Arcs | None) -> None:
    """Refuse a state that no step could have left: compiled code reads its arrays without a check of sizes.

    Raises
    ------
    ValueError
        With what is wrong.
    """
    for part in (route, along.cut if isinstance(along, BarState) else None):
        if part is not None:
            _check_route(part)
    if isinstance(along, Corners):
        _check_corners(along)
    else:
        _check_bars(along)
        require(route is not None, "no route")
    require(along.direction_index in (-1, 1), "direction_index")


def _check_route(route: Arcs) -> None:
    pieces = len(route.length)
    require(numbers(route.length, pieces) and pieces > 0 and route.length.min() > 0.0, "length of pieces")
    require(numbers(route.angle, pieces) and route.angle.min() >= 0.0, "angle of pieces")
    require(numbers(route.covariance, 2 * pieces, 2 * pieces), "covariance of pieces")
    for part in (route.form_variance, route.model_variance):
        require(isinstance(part, float) and 0.0 <= part < math.inf, "shared variance of pieces")


def _check_corners(along: Corners) -> None:
    corners = len(along.angle)
    require(numbers(along.angle, corners) and corners > 0 and along.angle[0] == 0.0, "angle of corners")
    require(bool((np.diff(along.angle) >= 0.0).all()), "angle of corners")
    require(numbers(along.log_tension, corners), "log_tension")
    require(along.log_tension.max() <= math.log(MOST_TENSION), "log_tension")
    check_tension(along.tension_in)


def _check_bars(along: BarState) -> None:
    contacts = len(along.edge)
    require(numbers(along.edge, contacts) and contacts > 1 and bool((np.diff(along.edge) > 0).all()), "edge")
    require(along.tension.min() >= 0.0 and along.tension.max() <= MOST_TENSION, "tension")
    for name in _SCALARS:
        require(abs(getattr(along, name)) <= _MOST, name)
    require(math.isfinite(along.span), "span")
    require(isinstance(along.front, int), "front")
    require(isinstance(along.by_force, bool), "by_force")
    require(along.lags.keys() <= set(CHANNELS) and all(map(_may_lag, along.lags.values())), "lags")


def _may_lag(kept: tuple[float, ...]) -> bool:
    """Whether a sensor may have kept these numbers: two, then ages and values, the oldest first; (353)."""
    pairs = np.array(kept)
    if pairs.ndim != 1 or len(pairs) < 2 or len(pairs) % 2 or not (np.abs(pairs) <= _MOST).all():
        return False
    return bool((np.diff(pairs[2::2]) <= 0.0).all() and (pairs[2::2] >= 0.0).all())


def numbers(values: Any, *size: int) -> bool:
    """Whether values are an array of a size, of numbers that may be."""
    return isinstance(values, np.ndarray) and values.shape == size and bool((np.abs(values) <= _MOST).all())


def _time(saved: Any) -> float:
    time = _or_nan(saved)
    require(not math.isinf(time), "time")
    return time


def require(sound: bool, name: str) -> None:
    """Refuse what a saved state cannot hold, with a ValueError that names it."""
    if not sound:
        raise ValueError(name)


def _plain(part: Corners | BarState | Arcs) -> dict[str, Any]:
    names = part._fields if isinstance(part, BarState) else [field.name for field in fields(part)]
    return {name: _written(getattr(part, name)) for name in names if name not in ("model", "memory")}


def _written(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Arcs):
        return _plain(value)
    if isinstance(value, Mapping):
        return {name: list(pair) for name, pair in value.items()}
    return _or_none(value)


def _or_none(value: Any) -> Any:
    """Return the value, or None for NaN, which JSON lacks."""
    return None if isinstance(value, float) and math.isnan(value) else value


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _revived(kind: type[_Part], saved: Mapping[str, Any]) -> _Part:
    """Build a part from its plain values; arrays were written as lists."""
    return kind(
        **{name: _array(value) if isinstance(value, list) else value for name, value in saved.items()}
    )


def _bars(saved: Mapping[str, Any], route: Arcs | None) -> BarState:
    require("model" not in saved, "model")
    cut = saved["cut"]
    if cut is not None:
        cut = route if cut == _ROUTE else _revived(Arcs, cut)
        require(cut is not None, "cut")
    lags = {channel: tuple(map(float, kept)) for channel, kept in saved["lags"].items()}
    others = {name: value for name, value in saved.items() if name != "rest"}
    rest = {"memory": _memory(saved), "cut": cut, "lags": lags}
    return _revived(BarState, {**others, **rest, "temperature": _or_nan(saved["temperature"])})


def _memory(saved: Mapping[str, Any]) -> Memory:
    """Return what bars remember; its arrays have the sizes that the number of contacts gives them."""
    contacts = len(saved["edge"])
    sizes = dict.fromkeys(_OF_BARS, contacts + 1) | dict.fromkeys(_OF_CONTACTS, contacts) | {"drive": _DRIVE}
    require(saved["memory"].keys() == sizes.keys(), "memory")
    sizes["travel"] += saved.get("load_friction", 0.0) > 0.0
    arrays = {name: _array(saved["memory"][name]) for name in sizes}
    require((saved["rest"] is None) == (saved["cut"] is not None), "rest")
    if saved["rest"] is not None:
        arrays["rest"], sizes["rest"] = _array(saved["rest"]), contacts + 1
    drive = arrays["drive"]
    require(drive.shape == (_DRIVE,) and math.isfinite(drive[HELD.time]), "drive")  # a clock has no limit
    bounded = np.delete(drive, HELD.time)
    for name, values in (arrays | {"drive": bounded}).items():
        require(numbers(values, len(bounded) if name == "drive" else sizes[name]), name)
    require(bool(np.isin(arrays["slip"], (-1.0, 0.0, 1.0)).all()), "slip")
    memory = memory_of(**arrays)
    memory.block.setflags(write=False)
    return memory


def _array(numbers: list[Any]) -> Any:
    return read_only(np.array(numbers, dtype=np.float64))
