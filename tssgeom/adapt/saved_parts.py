"""Parts of saved filters: arrays, drives, generators and alerts, as JSON has them."""

from __future__ import annotations

import base64
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from tssgeom.adapt.alert import Alert
from tssgeom.adapt.drift_rate import DriftRate
from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.followed import FollowedNumber
from tssgeom.adapt.trailed_drive import TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants_tendon_rows import HELD, MEMORY
from tssgeom.errors import SettingsError
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.capstan import MOST_TENSION
from tssgeom.tendon.saved import require, route_object

VERSION = 4
"""Version of the objects of filters."""
MOST = 1e12
"""Most of any number; chosen: as of a tendon's."""
_BITS = 128  # of each number of the random generator; its own


def alert_of(saved: Mapping[str, Any], channels: Collection[str]) -> dict[str, Any]:
    """Return the alert about one of some channels, which files of older programs do not have."""
    alert = msgspec.convert(saved.get("alert"), Alert | None)
    disagreed = msgspec.convert(saved.get("disagreed"), float | None)
    require(alert is None or (alert.channel in channels and disagreed is not None), "alert")
    require(disagreed is None or abs(disagreed) <= MOST, "disagreed")
    return {"alert": alert, "disagreed": math.nan if disagreed is None else disagreed}


def check_numbers(fresh: Ensemble, members: Matrix, about: Vector) -> None:
    """Refuse numbers out of bounds, with a ValueError."""
    lower, upper = (np.array([getattr(one, side) for one in fresh.numbers]) for side in ("lower", "upper"))
    require(bool(((members >= lower) & (members <= upper)).all()), "members out of bounds")
    require(bool(((about >= lower) & (about <= upper)).all()), "about out of bounds")


def check_memory(memory: Matrix, contacts: int) -> None:
    """Refuse memories of tendons [tendons, numbers] that cannot be, with a ValueError."""
    bars = contacts + 1
    require(memory.shape[1] == len(MEMORY) * bars + len(HELD), "memory")
    tension = memory[:, :bars]
    require(bool((tension >= 0.0).all() and (tension <= MOST_TENSION).all()), "tension")
    slip = memory[:, MEMORY.slip * bars : MEMORY.slip * bars + contacts]
    require(bool(np.isin(slip, (-1.0, 0.0, 1.0)).all()), "slip")


def drives_of(saved: Mapping[str, Any], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return what was kept of drives."""
    require(set(saved) == set(names), "drives")
    return {name: _drive_of(saved[name]) for name in names}


def more_of(saved: Any) -> tuple[FollowedNumber, ...]:
    """Return what is followed beside the numbers of the rig; JSON has null for a bound that is infinite."""
    none = {"lower": -math.inf, "upper": math.inf}
    numbers = [one | {side: far for side, far in none.items() if one[side] is None} for one in saved]
    return msgspec.convert(numbers, tuple[FollowedNumber, ...])


def drift_of(saved: Mapping[str, Any], fresh: Ensemble) -> Matrix:
    """Return what was kept of the drift of a filter's numbers."""
    rows = numbers_of(saved, may_lack=True)
    require(rows.shape == fresh.drift.rows.shape, "drift")
    rate = DriftRate(fresh.drift.stated)
    rate.set_rows(rows)
    for one in (rate.chances, rate.spreads, rate.waiting):
        require(bool((one >= 0.0).all()), "drift")
    require(np.allclose(rate.chances.sum(axis=1), 1.0) and bool(np.isfinite(rate.means).all()), "drift")
    require(not (rate.last[:, 1] < 0.0).any() and bool((rate.last[:, 2:] >= 0.0).all()), "drift")
    require(bool(np.isfinite(rate.beyond).all()), "drift")
    return rows


def _drive_of(saved: Mapping[str, Any]) -> dict[str, Any]:
    like = TrailedDrive(0.0).plain()
    require(saved.keys() == like.keys() and saved["way"] in (-1, 0, 1), "drives")
    arrays = {name: numbers_of(saved[name]) for name, one in like.items() if isinstance(one, np.ndarray)}
    for name, one in arrays.items():
        require(one.ndim == 1 and (name == "recent" or len(one) == len(like[name])), "drives")
    rest = like.keys() - arrays.keys() - {"way"}
    numbers = {name: math.nan if saved[name] is None else float(saved[name]) for name in rest}
    require(not any(abs(one) > MOST for one in numbers.values()), "drives")
    require(numbers["noise"] >= 0.0 and 0.0 <= numbers["turn_probability"] <= 1.0, "drives")
    return {**arrays, **numbers, "way": saved["way"]}


def random_of(now: Ensemble) -> tuple[int, int]:
    """Return state and increment of the generator of a filter."""
    random: Any = now.random.bit_generator.state["state"]
    return random["state"], random["inc"]


def set_random(now: Ensemble, random: tuple[int, int]) -> None:
    """Set the generator of a filter to state and increment."""
    now.random.bit_generator.state = {
        "bit_generator": "PCG64",
        "state": {"state": random[0], "inc": random[1]},
        "has_uint32": 0,
        "uinteger": 0,
    }


def random_numbers(saved: Any) -> tuple[int, int]:
    """Return state and increment of a generator as they were written."""
    state, increment = (int(text, 16) for text in saved)
    require(0 <= state < 1 << _BITS and 0 < increment < 1 << _BITS and increment % 2 == 1, "random")
    return state, increment


def plain(value: Any) -> Any:
    """Return a value as it goes into JSON."""
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value, dtype="<f8").tobytes()
        return {"shape": list(value.shape), "float64": base64.b64encode(data).decode()}
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, Arcs):
        return route_object(value)
    if isinstance(value, float) and math.isnan(value):
        return None
    if isinstance(value, tuple | Alert):  # JSON has no NaN
        return msgspec.json.decode(msgspec.json.encode(value))
    return value


def numbers_of(saved: Mapping[str, Any], *, may_lack: bool = False) -> Any:
    """Return the array that `plain` wrote, of numbers that may be; NaN only where they `may_lack`."""
    values = np.frombuffer(base64.b64decode(saved["float64"], validate=True), dtype="<f8")
    values = values.reshape([int(size) for size in saved["shape"]]).astype(np.float64)
    sound = (np.abs(values) <= MOST) | (may_lack & np.isnan(values))
    require(bool(sound.all()), "a number is not finite or too large")
    return values


def require_keys(saved: Mapping[str, Any], own: tuple[str, ...]) -> None:
    """Refuse a filter of other numbers than the rig names, with a SettingsError."""
    if tuple(saved["keys"]) != own:
        raise SettingsError(
            f"the saved filter follows {', '.join(saved['keys'])}, the rig {', '.join(own)}: it is not used"
        )
