"""A tendon in a sheath, or two of them joined at a joint, by finite elements with bristles that stick.

The tendon stretches; bristles between it and the sheath are springs whose feet slip where their force is at
the limit of friction (Prandtl elements at the Gauss points). So there is no speed in the friction of a base
chain, a hold stays still, and every slip dissipates. Laws that depend on speed, travel, time and tension come
in as factors of each Gauss point, which the caller renews in every step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.bristle.sheath import Sheath
from tests.compiled import library_of

Array = np.ndarray
_HERE = Path(__file__).parent
_FFI, _LIBRARY = library_of(_HERE / "chain.h", [_HERE / "chain.c"])
_MODES = {"position": 0, "force": 1, "spring": 2, "free": 3}


class Numerics(NamedTuple):
    """How finely a chain is computed."""

    elements: int = 120
    """Of a tendon (measured: twice as many change no channel by more than its test states)."""
    most_newton: int = 60
    """Steps until a part of the drive is halved (chosen)."""
    tolerance_N: float = 1e-8
    """Largest force that a node may have left (chosen: a millionth of the noise of a cell)."""
    most_halvings: int = 12
    """Of a part of the drive (chosen)."""


class NoBalanceError(RuntimeError):
    """No balance of forces was reached within the steps allowed."""


class Table(NamedTuple):
    """A law as points, straight between them and beyond the ends."""

    x: Array
    value: Array

    def at(self, x: float) -> float:
        """Return the value at one abscissa."""
        k = int(np.clip(np.searchsorted(self.x, x) - 1, 0, len(self.x) - 2))
        slope = (self.value[k + 1] - self.value[k]) / (self.x[k + 1] - self.x[k])
        return float(self.value[k] + slope * (x - self.x[k]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Bristles:
    """How bristles give way before they slip."""

    breakaway_m: tuple[float, ...] = (0.05e-6,)
    """Movement at which each kind slips, at the reference tension [m] (measured: 0.5 µm moves T_in by 0.09 N
    at turns, this by 1 mN)."""
    share: tuple[float, ...] = (1.0,)
    """Share of each kind in the limit [1]; 1 in all."""
    reference_N: float = 10.0
    """Tension at which these movements hold [N]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """What a chain is made of. Tendons stand behind each other on it: of a pair, the second one backwards."""

    sheaths: Sequence[Sheath]
    """One, or the two of a pair."""
    friction: float
    """Coulomb coefficient at the reference of all laws [1]."""
    strain: Table
    """Strain [1] over tension [N]: `x` the strain, `value` the tension."""
    pretension: float
    """Tension at rest [N]."""
    load: Table
    """Force on the load node [N] over its movement [m]."""
    straight: float = 0.0
    """Friction without curvature [N/m]."""
    bristles: Bristles = field(default_factory=Bristles)
    near_friction: float = 0.0
    """Of the fitting at the drive [N]."""
    load_friction: float = 0.0
    """At the load node: of the fitting there, or of the joint over its lever arm [N]."""
    pull: Table | None = None
    """A spring between drive and tendon: force [N] over stretch [m]; none where rigid."""
    drive: str = "position"
    """Position or force."""
    numerics: Numerics = field(default_factory=Numerics)


class Chain:
    """The state of a chain, which `advance` takes on.

    `bend`, `middle_s`, `travel`, `slip_rate`, `gauss_tension` are [2 elements] at the Gauss points: curve
    angle for each length [rad/m], arc length in the own sheath [m], length slipped so far [m], slip in the
    last step [m/s], tension [N].
    """

    def __init__(self, build: Build) -> None:
        self.build = build
        n = build.numerics.elements
        parts = [_part(sheath, n, backwards=k == 1) for k, sheath in enumerate(build.sheaths)]
        self.length, self.bend, self.middle_s = (np.concatenate(rows) for rows in zip(*parts, strict=True))
        elements, kinds = len(self.length), len(build.bristles.share)
        self.backwards = np.repeat(np.arange(len(parts)) == 1, 2 * n)
        start = float(np.interp(build.pretension, build.strain.value, build.strain.x))
        self.factor_pull, self.factor_release = np.ones(2 * elements), np.ones(2 * elements)
        self.straight = np.full(2 * elements, build.straight)
        self.travel, self.slip_rate = np.zeros(2 * elements), np.zeros(2 * elements)
        limit = build.friction * self.bend * build.bristles.reference_N
        soft = np.array(build.bristles.breakaway_m)
        stiffness = np.maximum(limit + build.straight, _LEAST_LIMIT)[:, None] / soft[None, :]
        node_limit, node_stiffness = np.zeros(elements + 1), np.full(elements + 1, 1.0)
        last = n
        node_limit[0], node_limit[last] = build.near_friction, build.load_friction
        node_stiffness[[0, last]] = np.maximum(node_limit[[0, last]], _LEAST_LIMIT) / soft[0]
        pull = build.pull or Table(np.array([0.0, 1.0]), np.array([0.0, 1.0]))
        self._arrays = {
            "length": self.length,
            "curve_strain": build.strain.x,
            "curve_tension": build.strain.value,
            "start_strain": np.full(elements, start),
            "load_move": build.load.x,
            "load_force": build.load.value,
            "pull_stretch": pull.x,
            "pull_force": pull.value,
            "bend": self.bend,
            "rub_pull": build.friction * self.factor_pull,
            "rub_release": build.friction * self.factor_release,
            "rub_straight": self.straight,
            "stiffness": stiffness.ravel(),
            "share": np.array(build.bristles.share),
            "node_stiffness": node_stiffness,
            "node_limit": node_limit,
            "extra_strain": np.zeros(elements),
            "move": np.zeros(elements + 1),
            "slip": np.zeros(2 * elements * kinds),
            "node_slip": np.zeros(elements + 1),
            "tension": np.full(elements, build.pretension),
            "work": np.zeros(1),
            "ends": np.zeros(4),
        }
        self._arrays = {name: np.ascontiguousarray(row, dtype=float) for name, row in self._arrays.items()}
        self._load_node = last
        self._struct = _FFI.new("Chain *")
        for name, row in self._arrays.items():
            setattr(self._struct, name, _FFI.cast("double *", row.ctypes.data))
        self._struct.elements, self._struct.kinds = elements, kinds
        self._struct.curve_points, self._struct.load_points = len(build.strain.x), len(build.load.x)
        self._struct.pull_points, self._struct.load_node = len(pull.x), last
        mode = "spring" if build.pull is not None and build.drive == "position" else build.drive
        self._struct.drive_mode = _MODES[mode]
        self._struct.far_mode = _MODES["position" if len(parts) == 2 else "free"]
        self._struct.drive = build.pretension if build.drive == "force" else 0.0
        self.steps = 0

    @property
    def move(self) -> Array:
        """Movements of the nodes, towards the (first) drive [m]."""
        return self._arrays["move"]

    @property
    def tension(self) -> Array:
        """Tension of each element [N]."""
        return self._arrays["tension"]

    @property
    def gauss_tension(self) -> Array:
        """Tension at the Gauss points [N]."""
        return np.repeat(self.tension, 2)

    @property
    def extra_strain(self) -> Array:
        """Strain without force of each element [1]; write to it."""
        return self._arrays["extra_strain"]

    @property
    def dissipated(self) -> float:
        """Work that all bristles have turned to heat [J]."""
        return float(self._arrays["work"][0])

    @property
    def drive_move(self) -> float:
        """Movement of the drive [m]."""
        if self.build.drive == "position":
            return float(self._struct.drive)
        stretch = 0.0
        if self.build.pull is not None:
            stretch = float(np.interp(self.tension_in, self.build.pull.value, self.build.pull.x))
        return float(self.move[0]) + stretch

    @property
    def tension_in(self) -> float:
        """Tension at the (first) drive [N]."""
        return float(self._struct.drive if self.build.drive == "force" else self._arrays["ends"][0])

    @property
    def tension_far(self) -> float:
        """Tension at the second drive of a pair [N]."""
        return float(self._arrays["ends"][1])

    @property
    def load_move(self) -> float:
        """Movement of the load node [m]."""
        return float(self.move[self._load_node])

    @property
    def load_force(self) -> float:
        """Force of the load [N]."""
        return self.build.load.at(self.load_move)

    @property
    def load_tensions(self) -> tuple[float, float]:
        """Tension before and behind the load node [N]; behind it, 0 of one tendon."""
        return float(self._arrays["ends"][2]), float(self._arrays["ends"][3])

    def advance(
        self, drive: float, dt: float, far: float = 0.0, renew: Callable[[Chain, float], None] | None = None
    ) -> None:
        """Take the drive [m or N] to a value within a time [s], and the second drive [m] with it.

        `renew(chain, dt)` sets factors and extra strain by the state; it is called twice, so that what
        depends on the end of the step is that of the step.

        Raises
        ------
        NoBalanceError
            Where Newton steps do not end, even with tiny parts of the drive.
        """
        before = self._struct.drive, self._struct.far, self.move.copy(), self._arrays["slip"].copy()
        kept = self._arrays["node_slip"].copy(), self._arrays["work"].copy()
        for turn in range(2 if renew else 1):
            if renew:
                renew(self, dt)
            if turn:
                self._struct.drive, self._struct.far = before[:2]
                for name, row in zip(("move", "slip"), before[2:], strict=True):
                    self._arrays[name][:] = row
                for name, row in zip(("node_slip", "work"), kept, strict=True):
                    self._arrays[name][:] = row
            self._to(drive, far, 0)
        slipped = (self._arrays["slip"] - before[3]).reshape(len(self.bend), -1)
        slip = slipped @ np.array(self.build.bristles.share)
        self.travel += np.abs(slip)
        self.slip_rate = slip / dt

    def _to(self, drive: float, far: float, depth: int) -> None:
        build, struct = self.build, self._struct
        self._arrays["rub_pull"][:] = build.friction * np.where(
            self.backwards, self.factor_release, self.factor_pull
        )
        self._arrays["rub_release"][:] = build.friction * np.where(
            self.backwards, self.factor_pull, self.factor_release
        )
        start, start_far, move = struct.drive, struct.far, self.move.copy()
        struct.drive, struct.far = drive, far
        done = _LIBRARY.bristle_step(struct, build.numerics.most_newton, build.numerics.tolerance_N)
        if done >= 0:
            self.steps += done
            return
        if depth >= build.numerics.most_halvings:
            raise NoBalanceError(f"no balance at drive {drive:g}, {far:g}")
        self.move[:] = move
        struct.drive, struct.far = start, start_far
        self._to(0.5 * (start + drive), 0.5 * (start_far + far), depth + 1)
        self._to(drive, far, depth + 1)


_LEAST_LIMIT = 1e-3
"""Limit [N/m or N] below which a bristle is made no softer (chosen: a straight sheath then holds nothing)."""


def _part(sheath: Sheath, elements: int, *, backwards: bool) -> tuple[Array, Array, Array]:
    """Return lengths of elements [n], bend [2n] and arc length [2n] of the Gauss points along the chain."""
    nodes = np.linspace(0.0, sheath.length, elements + 1)
    h = nodes[1]
    offset = h / (2.0 * np.sqrt(3.0))
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    at = np.stack([middle - offset, middle + offset], axis=1).ravel()
    edges = np.stack([nodes[:-1], middle], axis=1).ravel()
    turned = np.interp(np.append(edges, sheath.length), sheath.s, sheath.angle)
    bend = np.diff(turned) / (0.5 * h)
    if backwards:
        at, bend = at[::-1], bend[::-1]
    return np.full(elements, h), np.ascontiguousarray(bend), np.ascontiguousarray(at)


def linear(compliance: float, most: float = 100.0) -> Table:
    """Return the strain law of a compliance [1/N]."""
    return Table(np.array([0.0, compliance * most]), np.array([0.0, most]))


def spring(pretension: float, stiffness: float) -> Table:
    """Return a load of a pretension [N] and a stiffness [N/m]."""
    return Table(np.array([0.0, 1.0]), np.array([pretension, pretension + stiffness]))
