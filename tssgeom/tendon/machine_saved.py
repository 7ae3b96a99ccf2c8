"""The state of a machine as a plain object, so that a restarted stream continues from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

import numpy as np

from tssgeom.core.constants_tendon_rows import HELD, MEMORY
from tssgeom.errors import SettingsError, broken_state
from tssgeom.mechanism import coordinates
from tssgeom.rig import Rig
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.machine import BARS, MachineState
from tssgeom.tendon.machine_history import DriveName, MachineHistory, Turning
from tssgeom.tendon.machine_stream import CarriedMachine
from tssgeom.tendon.saved import VERSION, numbers, require, route_object, route_of
from tssgeom.tendon.state import HALVINGS

KIND = "machine"
"""Kind of the objects that `machine_object` writes."""
_MOST_COORDINATES = 4


def machine_object(state: CarriedMachine) -> dict[str, Any]:
    """Return a machine as an object for JSON, from which `machine_from` makes the same to the last bit."""
    history, route = state.history, state.route
    saved: dict[str, Any] = {"version": VERSION, "kind": KIND, "way": state.way, "history": None}
    if history is None or route is None:
        return saved
    held = {
        **{name: getattr(history.state, name).tolist() for name in MachineState._fields},
        "held": history.held.tolist(),
        "drive": history.drive,
        "time": history.time,
        "begun_at": history.begun_at,
        **{name: None if (of := getattr(history, name)) is None else list(of) for name in ("motor", "joint")},
        "lags": {name: list(pair) for name, pair in history.lags.items()},
        "recent": None if history.recent is None else history.recent.tolist(),
    }
    return saved | {"history": held, "route": route_object(route)}


def machine_from(saved: Mapping[str, Any]) -> CarriedMachine:
    """Return the machine that `machine_object` wrote.

    Raises
    ------
    SettingsError
        Where the object is of another version, or is none of a machine.
    """
    if saved.get("version") != VERSION:
        raise SettingsError(
            f"the saved machine has version {saved.get('version')!r}, this program reads {VERSION}: remove it"
        )
    try:
        require(saved["way"] in (-1, 1), "way")
        if saved["history"] is None:
            return CarriedMachine(way=saved["way"])
        route, history = route_of(saved["route"]), _history(saved["history"])
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise broken_state(error) from error
    return CarriedMachine(None, route, history, saved["way"])


def require_state_of(rig: Rig, state: CarriedMachine) -> None:
    """Refuse the state of a machine with other tendons than a rig has, with a SettingsError."""
    if state.history is None:
        return
    motion = coordinates(rig.drive, rig.end, rig.load.stiffness_N_per_m)
    tendons, m = motion.distal.shape
    sizes = len(state.history.held), len(state.history.state.coordinate)
    m += state.history.drive == "motor_torque_Nm"
    if sizes != (tendons, m):
        raise SettingsError(
            f"the state is of {sizes[0]} tendons and {sizes[1]} coordinates, the rig has {tendons} and {m}: "
            "remove it and start anew"
        )


def _history(saved: Mapping[str, Any]) -> MachineHistory:
    memory, held = _array(saved["memory"]), _array(saved["held"])
    where, lags = _array(saved["coordinate"]), {name: _pair(of) for name, of in saved["lags"].items()}
    bars = BARS + 2 * HALVINGS + 2
    size = len(MEMORY) * bars + len(HELD)
    require(held.ndim == 2 and numbers(held, len(held), 2) and len(held) > 0, "held")
    require(memory.shape == (len(held), size) and bool(np.isfinite(memory).all()), "memory")
    for row in memory:
        _check(Memory(row))
    require(numbers(where, len(where)) and 0 < len(where) <= _MOST_COORDINATES, "coordinate")
    require(saved["drive"] in get_args(DriveName), "drive")
    time = float(saved["time"])
    begun_at = float(saved.get("begun_at", time))  # of an older file, where nothing drifts
    require(bool(np.isfinite([time, begun_at]).all()), "time")
    motor, joint = _turning(saved["motor"]), _turning(saved["joint"])
    recent = None if (rows := saved.get("recent")) is None else _array(rows)  # of an older file: none
    if recent is not None:
        drives = 1 if saved["drive"].startswith("motor") else len(held)
        require(recent.ndim == 2 and numbers(recent, len(recent), 1 + drives) and len(recent) > 0, "recent")
    return MachineHistory(
        MachineState(memory, where), held, saved["drive"], time, begun_at, motor, joint, lags, recent
    )


def _turning(saved: Any) -> Turning | None:
    return None if saved is None else Turning(*_numbers(saved, 3))


def _check(memory: Memory) -> None:
    require(numbers(memory.block[: -len(HELD)], len(memory.block) - len(HELD)), "memory")
    require(float(memory.tension.min()) >= 0.0, "tension")
    require(bool(np.isin(memory.slip, (-1, 0, 1)).all()), "slip")


def _array(values: Any) -> np.ndarray:
    return np.array(values, dtype=np.float64)


def _numbers(values: Any, count: int) -> list[float]:
    array = _array(values)
    require(numbers(array, count), "numbers")
    return array.tolist()


def _pair(values: Any) -> tuple[float, float]:
    first, last = _numbers(values, 2)
    return first, last
