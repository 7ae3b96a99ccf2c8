"""Pairs: two tendons on one pulley that turn a joint against a spring, by the elements of one tendon.

Along the first tendon to the joint and back along the second one it is one chain: what the joint pulls in on
one side it lets out on the other. Movements count towards the pulley along the first tendon, so that both
ends of the chain move alike, and the joint is a node in the middle with a load and a friction of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.bristle import laws, sensors
from tests.bristle.chain import Bristles, Build, Chain, Table, linear
from tests.bristle.laws import Acts
from tests.bristle.rig import stride
from tests.bristle.sheath import Sheath, random_sheath, sensed
from tests.bristle.waves import KINDS, course

Array = np.ndarray


class PairRanges(NamedTuple):
    """What pairs are like (chosen, after instruments)."""

    friction: tuple[float, float] = (0.08, 0.15)
    compliance_per_N: tuple[float, float] = (2.2e-4, 4.0e-4)
    pretension_N: tuple[float, float] = (8.0, 11.0)
    pulley_m: tuple[float, float] = (0.008, 0.012)
    arm_m: tuple[float, float] = (0.005, 0.008)
    most_angle_rad: tuple[float, float] = (0.6, 0.9)
    """Of the joint, either way."""
    load_N: tuple[float, float] = (2.0, 3.5)
    """Of the joint's spring at that angle, at the lever arm."""
    length_m: tuple[float, float] = (0.4, 0.6)
    total_angle_rad: tuple[float, float] = (1.5, 3.5)
    runs: tuple[int, int] = (3, 5)
    slack_N: float = 0.5
    """Less tension than this is refused, since a tendon would go slack soon."""
    rest: int = 15
    """Samples at rest, and as many on the way to the course."""


PAIR_RANGES = PairRanges()
PAIR_PLANS: dict[str, tuple[str, ...]] = {
    "pair": ("motor_angle", "tension_in_1", "tension_in_2", "joint_angle"),
    "pair_torque": ("motor_angle", "motor_torque", "joint_angle"),
}
"""Channels of a run; the angle of the motor drives."""
PAIR_RATES = (20.0, 60.0, 150.0)
"""Sampling of runs in turn [1/s] (chosen: speeds are then apart by 7)."""
PAIR_SLOWEST = min(PAIR_RATES)
_UNITS = {"motor_angle": "rad", "joint_angle": "rad", "motor_torque": "Nm"}


@dataclass(slots=True)
class Pair:
    """A true pair, and what is wrong with it."""

    friction: float
    compliance: float
    """[1/N]"""
    pretension: float
    """[N]"""
    pulley: float
    """Radius [m]."""
    arm: float
    """Lever arm on the joint [m]."""
    stiffness: float
    """Of the joint [N m/rad]."""
    sheaths: list[Sheath]
    """One for each route; both tendons are in the same sheath."""
    most_angle: float
    """Of the joint [rad]."""
    joint_friction: float = 0.0
    """[N m]"""
    bristles: Bristles = field(default_factory=Bristles)
    acts: dict[str, Any] = field(default_factory=dict)
    readings: dict[str, Callable[[Array, Array], Array]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    law: tuple[str, str, Callable[[Array], Array]] | None = None

    def chain(self, sheath: Sheath) -> Chain:
        """Return both tendons at rest."""
        rise = self.stiffness / self.arm**2
        build = Build(
            sheaths=[sheath, sheath],
            friction=self.friction,
            strain=linear(self.compliance),
            pretension=self.pretension,
            load=Table(np.array([0.0, 1.0]), np.array([0.0, rise])),
            bristles=self.bristles,
            load_friction=self.joint_friction / self.arm,
        )
        return Chain(build)


def run_pair(pair: Pair, sheath: Sheath, time: Array, motor: Array) -> dict[str, Array]:
    """Follow the angle of the motor [n] in rad at times [n] in s; return true courses by channel.

    Raises
    ------
    ValueError
        Where a tendon would go slack.
    """
    chain, acts = pair.chain(sheath), Acts(**pair.acts)
    most = stride(acts)
    rows, old, then = list[tuple[float, ...]](), 0.0, 2.0 * time[0] - time[1]
    for now, goal in zip(time, pair.pulley * motor, strict=True):
        parts = int(np.ceil(max((now - then) / most.time_s, abs(goal - old) / most.move_m, 1.0)))
        dt = (now - then) / parts
        for k in range(parts):
            at = old + (goal - old) * (k + 1) / parts
            chain.advance(at, dt, far=at, renew=acts.renew)
            acts.commit(chain, dt)
        if np.min(chain.tension) < PAIR_RANGES.slack_N:
            raise ValueError(f"a tendon of the pair has {np.min(chain.tension):g} N")
        old, then = goal, now
        first, second = chain.tension_in, chain.tension_far
        out = chain.load_tensions
        speed = float(np.max(np.abs(chain.slip_rate)))
        angle, torque = chain.load_move / pair.arm, pair.pulley * (first - second)
        rows.append((angle, torque, first, second, *out, speed, chain.dissipated))
    names = ("joint_angle", "motor_torque", "tension_in_1", "tension_in_2", "tension_out_1", "tension_out_2")
    true = dict(zip((*names, "slide_speed", "dissipated"), np.array(rows).T, strict=True))
    return true | {"motor_angle": motor}


def _stribeck(pair: Pair, size: float, seconds: float) -> None:
    law = laws.stribeck(0.25 * size, 4e-3, 6.0 * size, 10e-3)
    pair.acts["over_speed"], pair.law = law, ("speed", "1", law)


def _play(pair: Pair, size: float, seconds: float) -> None:
    width = pair.parameters["play_rad"] = 0.04 * size
    pair.readings["joint_angle"] = lambda value, _: laws.play(value, width)


def _joint_friction(pair: Pair, size: float, seconds: float) -> None:
    pair.joint_friction = pair.parameters["friction_Nm"] = 0.5 * pair.arm * size


def _drift(pair: Pair, size: float, seconds: float) -> None:
    def drift(t: Array) -> Array:
        return 0.025 * size * np.sqrt(np.asarray(t) / seconds)

    pair.readings["joint_angle"] = lambda value, t: value + drift(t)
    pair.law = ("time", "rad", drift)


PAIR_CAUSES: dict[str, tuple[str, Callable[[Pair, float, float], None]]] = {
    "pair_stribeck": ("friction_over_speed", _stribeck),
    "pair_play": ("play_in_joint", _play),
    "pair_joint_friction": ("friction_in_joint", _joint_friction),
    "pair_drift": ("sensor_drift", _drift),
}
"""Mechanism, and what builds it in."""


def random_pair(rng: np.random.Generator) -> Pair:
    """Draw a pair."""
    ranges = PAIR_RANGES
    length, arm = rng.uniform(*ranges.length_m), rng.uniform(*ranges.arm_m)
    most = rng.uniform(*ranges.most_angle_rad)
    return Pair(
        friction=rng.uniform(*ranges.friction),
        compliance=rng.uniform(*ranges.compliance_per_N),
        pretension=round(rng.uniform(*ranges.pretension_N), 1),
        pulley=round(rng.uniform(*ranges.pulley_m), 4),
        arm=round(arm, 4),
        stiffness=round(rng.uniform(*ranges.load_N) * arm / most, 5),
        sheaths=[
            random_sheath(rng, length, rng.uniform(*ranges.total_angle_rad), int(k))
            for k in rng.permutation(3)[:2]
        ],
        most_angle=most,
    )


def write_pair(
    folder: Path, pair: Pair, rng: np.random.Generator, plan: str, errors: tuple[float, float], gain: float
) -> dict[str, tuple[float, float]]:
    """Write a campaign of a pair; return what speeds [m/s] and times [s] its runs reach.

    `errors` are those of friction and compliance in the rig file [1], `gain` is that of all sensed angles.
    """
    folder.mkdir(parents=True, exist_ok=True)
    noise_mm = rng.uniform(0.1, 0.2)
    specified = {name: _specified(name) for name in PAIR_PLANS[plan]}
    (folder / "rig.toml").write_text(_rig_file(pair, specified, noise_mm, errors), encoding="utf-8")
    for k, sheath in enumerate(pair.sheaths):
        stations, points = sensed(sheath, rng, int(rng.integers(90, 160)), 1e-3 * noise_mm, gain)
        sensors.write_shape(folder / f"shape_{k + 1}.csv", stations, points, millimetres=True)
    owned = {name: sensors.Sensor(spec, rng) for name, spec in specified.items()}
    listed, fastest, longest = [], 0.0, 0.0
    count = int(rng.integers(*PAIR_RANGES.runs)) + 1
    for k in range(count):
        route, samples, rate = (1 if k == count - 1 else 0), 300, PAIR_RATES[k % 3]
        time = np.arange(1, samples + 1) / rate
        true = run_pair(pair, pair.sheaths[route], time, _motor(pair, k, samples, rng))
        fastest, longest = max(fastest, float(np.max(true["slide_speed"]))), max(longest, float(time[-1]))
        names, rows = ["time_s"], [time]
        for name, sensor in owned.items():
            change = pair.readings.get(name)
            value = change(true[name], time) if change else true[name]
            names.append(f"{name}_{_UNITS.get(name, 'N')}")
            rows.append(sensor.read(value, rng))
        text = [",".join(names), *(",".join(f"{v:.9g}" for v in row) for row in np.array(rows).T)]
        (folder / f"run_{k + 1}.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
        listed.append((f"run_{k + 1}.csv", f"shape_{route + 1}.csv", k == count - 1))
    (folder / "campaign.toml").write_text(sensors.listing(listed), encoding="utf-8")
    return {"speed": (0.0, fastest), "time": (0.0, longest)}


def _motor(pair: Pair, k: int, samples: int, rng: np.random.Generator) -> Array:
    """Return angles of the motor [rad]: a rest, a way down, and a course between both ends."""
    sheath, rest = pair.sheaths[0], PAIR_RANGES.rest
    load = pair.stiffness * pair.most_angle / pair.arm
    # Either tendon takes half of the load, and friction adds to it on the way there.
    stretch = 0.5 * load * pair.compliance * sheath.length * np.exp(pair.friction * sheath.total_angle)
    most = (pair.arm * pair.most_angle + stretch) / pair.pulley * rng.uniform(0.8, 1.0)
    wave = most * (2.0 * course(KINDS[k % len(KINDS)], rng, samples - 2 * rest) - 1.0)
    return np.concatenate([np.zeros(rest), np.linspace(0.0, -most, rest + 1)[1:], wave])


def _specified(name: str) -> sensors.Specified:
    if name.endswith("angle"):
        return sensors.MOTOR if name.startswith("motor") else sensors.ANGLE
    return sensors.TORQUE if name.endswith("torque") else sensors.CELL


def _rig_file(
    pair: Pair, specified: dict[str, sensors.Specified], noise_mm: float, errors: tuple[float, float]
) -> str:
    tables: dict[str, dict[str, float | str]] = {
        "drive": {"kind": "pair", "radius_m": pair.pulley},
        "end": {"kind": "joint", "radius_m": pair.arm, "stiffness_Nm_per_rad": pair.stiffness},
        "tendon": {
            "compliance_per_N": pair.compliance * (1.0 + errors[1]),
            "pretension_N": pair.pretension,
        },
        "friction": {"coefficient": pair.friction * (1.0 + errors[0])},
        "shape": {"noise_mm": noise_mm, "angle_gain_sd": 0.004},
    }
    for name, spec in specified.items():
        tables[f"sensors.{name}_{_UNITS.get(name, 'N')}"] = dict(spec._asdict())
    return sensors.toml(tables)
