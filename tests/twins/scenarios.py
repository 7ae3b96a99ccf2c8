"""Hours of a running machine: sound, drifting, and with a fault that begins in the midst of drifting."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from tests.lumped import Change, Distal, Drive, Physics, Sensor, measure, simulate, true_channels
from tests.twins.machine import RATE_HZ, Machine, machine, motion, route

CHANNELS = ("tension_in_N", "displacement_in_m", "tension_out_N", "displacement_out_m")
HOUR_S = 3600.0
KNOTS_S = 10.0  # between knots of what drifts; chosen: short against an hour
FRICTION_DRIFT = 0.3  # of the friction; chosen: what wear and wetting may do in an hour
LONGEST_WAIT_S = 120.0  # after a fault begins; chosen: several periods of the motion
KINK_M = 0.03  # width of a kink; chosen: some diameters of a sheath

Channel = Literal["tension_in_N", "displacement_in_m", "tension_out_N", "displacement_out_m"]
Course = tuple[np.ndarray, np.ndarray]


class Scenario(NamedTuple):
    """A run of n samples at 100 Hz, and the truth about it."""

    kind: str
    """Name of what happens: a key of `DRIFTS` or `FAULTS`."""
    seed: int
    machine: Machine
    """What a rig may state: the truth at the first sample, but for zeros."""
    times: np.ndarray
    """[n] s, from 0."""
    readings: dict[str, np.ndarray]
    """[n] What the sensor of each of `CHANNELS` reads, in its unit."""
    truth: dict[str, np.ndarray]
    """[n] of each, read only:

    `friction`                 coefficient, as its mean over the angle that the route has without a kink [1]
    `compliance_per_N`         mean along the tendon [1/N]
    `tendon_longer_m`          what the unstretched tendon is longer than at the start [m]
    `play_m`                   of the drive [m]
    `kink_rad`                 turn that the shape sensor does not sense [rad]
    `route_angle_gain`         angle that the shape sensor senses over that of the route without a kink [1]
    `zero_<channel>`           zero of each of `CHANNELS`, in its unit; an unplugged sensor has none in fact
    each of `CHANNELS`         its true value"""
    begins_s: float | None = None
    """When the fault begins [s]; None without a fault."""
    full_s: float | None = None
    """When it has its full size [s]."""
    stretch_m: tuple[float, float] | None = None
    """Arc lengths between which the fault is, where it is on a stretch [m]."""
    channel: str | None = None
    """Channel of a sensor that is unplugged."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What changes in a run, and what the sensors add."""

    changes: tuple[Change, ...] = ()
    zeros: dict[str, Course] = field(default_factory=dict)
    gain: Course = field(default_factory=lambda: (np.zeros(1), np.ones(1)))
    unplugged: dict[str, tuple[float, Literal["zero", "hold", "noise"]]] = field(default_factory=dict)


def sound(seed: int, hours: float = 1.0) -> Scenario:
    """Nothing changes."""
    return _run("sound", seed, hours, Plan())


def drifting_friction(
    seed: int, hours: float = 1.0, course: Literal["sinusoid", "random_walk"] = "sinusoid"
) -> Scenario:
    """Friction drifts within ±30 %, from its nominal value: a sinusoid of one hour, or a random walk."""
    drift = _friction_sinusoid(seed, hours) if course == "sinusoid" else friction_walk(seed, hours)
    return _run(f"drifting_friction_{course}", seed, hours, Plan((drift,)))


def rising_friction(seed: int, hours: float = 1.0, begins_s: float = 0.0, in_minute: float = 0.2) -> Scenario:
    """Friction rises from `begins_s` [s] on, by the share `in_minute` of its nominal value in each minute."""
    end = hours * HOUR_S
    when = np.array([-1.0, begins_s, end])
    rise = Change("friction", when, 1.0 + in_minute / 60.0 * np.maximum(when - begins_s, 0.0))
    return _run("rising_friction", seed, hours, Plan((rise,)))


def stepping_friction(seed: int, hours: float = 0.04, factors: tuple[float, ...] = (0.6, 1.0)) -> Scenario:
    """Friction goes to the next of `factors` in half a second once a minute."""
    minutes = 60.0 * np.arange(1, len(factors) + 1)
    when = np.concatenate([[-1.0], np.column_stack([minutes, minutes + 0.5]).ravel()])
    values = np.repeat([1.0, *factors], 2)[:-1]
    return _run("stepping_friction", seed, hours, Plan((Change("friction", when, values),)))


def drifting_zeros(seed: int, hours: float = 1.0) -> Scenario:
    """The zeros of T_in and T_out drift by 0.1 to 0.3 N within an hour."""
    return _run("drifting_zeros", seed, hours, Plan(zeros=_zeros(seed, hours)))


def growing_play(seed: int, hours: float = 1.0, play_m: float = 3e-4) -> Scenario:
    """The play of the drive grows from 0 to `play_m` [m] within the run, evenly."""
    grown = Change("play", np.array([0.0, hours * HOUR_S]), np.array([0.0, play_m]))
    return _run("growing_play", seed, hours, Plan((grown,)))


def drifting(seed: int, hours: float = 1.0) -> Scenario:
    """Friction (a sinusoid) and both zeros of tension drift: what each fault below begins in."""
    return _run("drifting", seed, hours, drifts_of(seed, hours))


def frayed_tendon(
    seed: int, hours: float = 0.5, softer: float = 1.6, longer_m: float = 5e-4, span_s: float = 0.3
) -> Scenario:
    """Strands break: the tendon becomes `softer` by a factor along its length, and longer on 10 mm.

    A broken strand carries nothing from end to end. The unstretched length of the others stays, so that T_in
    falls while the drive stands.
    """
    begins, site = _begin(seed, hours), _site(seed, 0.01)
    when = np.array([begins, begins + span_s])
    changes = (
        Change("compliance", when, np.array([1.0, softer])),
        Change("length", when, np.array([0.0, longer_m]), *site),
    )
    return _fault("frayed_tendon", seed, hours, when, site, changes)


def wet_sheath(
    seed: int, hours: float = 0.5, factor: float = 0.45, span_s: float = 3.0, whole: bool | None = None
) -> Scenario:
    """Friction falls to a `factor`, on the `whole` route or on half of it; None lets the seed choose."""
    begins = _begin(seed, hours)
    when, length = np.array([begins, begins + span_s]), machine(seed).length_m
    if whole is None:
        whole = bool(np.random.default_rng((seed, 5)).integers(2))
    site = (0.0, length) if whole else _site(seed, 0.5 * length)
    wet = Change("friction", when, np.array([1.0, factor]), *site)
    return _fault("wet_sheath", seed, hours, when, site, (wet,))


def kinked_sheath(seed: int, hours: float = 0.5, kink_rad: float = 0.8, span_s: float = 0.5) -> Scenario:
    """The sheath turns by `kink_rad` [rad] more on 30 mm; the shape sensor misses it."""
    begins, site = _begin(seed, hours), _site(seed, KINK_M)
    when = np.array([begins, begins + span_s])
    kink = Change("bend", when, np.array([0.0, kink_rad]), *site)
    return _fault("kinked_sheath", seed, hours, when, site, (kink,))


def unplugged(
    seed: int,
    hours: float = 0.5,
    channel: Channel = "tension_in_N",
    reads: Literal["zero", "hold", "noise"] = "zero",
) -> Scenario:
    """A sensor is unplugged and reads 0, its last value, or noise about 0."""
    begins = _begin(seed, hours)
    plan = replace(drifts_of(seed, hours), unplugged={channel: (begins, reads)})
    result = _run(f"unplugged_{channel}", seed, hours, plan)
    return result._replace(begins_s=begins, full_s=begins, channel=channel)


def wrong_shape(seed: int, hours: float = 0.5, gain: float | None = None, span_s: float = 0.5) -> Scenario:
    """The shape sensor senses all angles times `gain`; None lets the seed choose 0.75 or 1.25.

    The machine itself stays as it is.
    """
    begins = _begin(seed, hours)
    if gain is None:
        gain = 1.25 if np.random.default_rng((seed, 6)).integers(2) else 0.75
    when = np.array([begins, begins + span_s])
    plan = replace(drifts_of(seed, hours), gain=(when, np.array([1.0, gain])))
    result = _run("wrong_shape", seed, hours, plan)
    return result._replace(begins_s=begins, full_s=begins + span_s)


def acts_s(
    scenario: Scenario, channels: Sequence[str] = ("tension_in_N", "displacement_in_m"), sizes: float = 5.0
) -> float | None:
    """Return when a fault first changes one of some channels by `sizes` times its noise [s], or None.

    The comparison is the same machine in the same motion with the same drifts. A shape that is wrong acts on
    what is predicted, hence when it begins; so does an unplugged sensor, if its channel is among these.
    """
    if scenario.begins_s is None or scenario.kind == "wrong_shape":
        return scenario.begins_s
    if scenario.channel is not None:
        return scenario.begins_s if scenario.channel in channels else None
    until = min(scenario.begins_s + LONGEST_WAIT_S, scenario.times[-1] + 1.0 / RATE_HZ)
    plain = drifting(scenario.seed, until / HOUR_S)
    acts = np.zeros(len(plain.times), dtype=bool)
    for name in channels:
        change = np.abs(scenario.truth[name][: len(acts)] - plain.truth[name])
        acts |= change > sizes * scenario.machine.noise[name]
    acts &= plain.times >= scenario.begins_s
    return float(plain.times[np.argmax(acts)]) if acts.any() else None


def _run(kind: str, seed: int, hours: float, plan: Plan) -> Scenario:
    given = machine(seed)
    times, moved = motion(given, seed, hours * HOUR_S)
    physics = Physics(
        friction=given.friction,
        compliance_per_N=given.compliance_per_N,
        pretension_N=given.pretension_N,
    )
    kinks = [change for change in plan.changes if change.kind == "bend"]
    path = route(given, fine=(kinks[0].start_m, kinks[0].stop_m) if kinks else None)
    drive, load = Drive("displacement", times, moved), Distal("spring", given.stiffness_N_per_m)
    run = simulate(path, physics, drive, load, times, 1.0 / RATE_HZ, plan.changes, ends_only=True)
    sensors = {name: _sensor(given, name, plan) for name in CHANNELS}
    readings = measure(run, sensors, seed)
    channels = true_channels(run)
    truth = _truth(given, plan, times) | {name: channels[name] for name in CHANNELS}
    for values in truth.values():
        values.setflags(write=False)
    return Scenario(kind, seed, given, times, {name: readings[name] for name in CHANNELS}, truth)


def _sensor(given: Machine, name: str, plan: Plan) -> Sensor:
    since, reads = plan.unplugged.get(name, (math.inf, "zero"))
    return Sensor(noise=given.noise[name], zero=plan.zeros.get(name), unplugged_s=since, unplugged=reads)


def _truth(given: Machine, plan: Plan, times: np.ndarray) -> dict[str, np.ndarray]:
    """Return the parameters over time; what does not change is one number, broadcast."""

    def factor(kind: str, portion: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        product = np.ones(1)
        for change in plan.changes:
            if change.kind == kind:
                start, stop = portion(np.clip((change.start_m, change.stop_m), 0.0, given.length_m))
                product = product * (1.0 + (change.at(times) - 1.0) * (stop - start))
        return product

    def total(kind: str) -> np.ndarray:
        return np.zeros(1) + sum(change.at(times) for change in plan.changes if change.kind == kind)

    parameters = {
        "friction": given.friction * factor("friction", lambda s: given.angle_at(s) / given.total_angle_rad),
        "compliance_per_N": given.compliance_per_N * factor("compliance", lambda s: s / given.length_m),
        "tendon_longer_m": total("length"),
        "play_m": total("play"),
        "kink_rad": total("bend"),
        "route_angle_gain": np.interp(times, *plan.gain),
    }
    for name in CHANNELS:
        zero = plan.zeros.get(name, (np.zeros(1), np.zeros(1)))
        parameters[f"zero_{name}"] = np.interp(times, *zero)
    return {name: np.broadcast_to(value, times.shape) for name, value in parameters.items()}


def _fault(
    kind: str,
    seed: int,
    hours: float,
    when: np.ndarray,
    site: tuple[float, float],
    changes: tuple[Change, ...],
) -> Scenario:
    plan = drifts_of(seed, hours)
    result = _run(kind, seed, hours, replace(plan, changes=plan.changes + changes))
    return result._replace(begins_s=float(when[0]), full_s=float(when[1]), stretch_m=site)


def drifts_of(seed: int, hours: float) -> Plan:
    """Return what drifts in every run with a fault."""
    return Plan((_friction_sinusoid(seed, hours),), _zeros(seed, hours))


def _knots(hours: float) -> np.ndarray:
    return np.arange(math.ceil(hours * HOUR_S / KNOTS_S) + 1) * KNOTS_S


def _friction_sinusoid(seed: int, hours: float) -> Change:
    """A period of an hour, up or down first by the seed."""
    sign = 1.0 if np.random.default_rng((seed, 3)).integers(2) else -1.0
    at = _knots(hours)
    return Change("friction", at, 1.0 + sign * FRICTION_DRIFT * np.sin(2.0 * np.pi * at / HOUR_S))


def friction_walk(seed: int, hours: float) -> Change:
    """A walk of 0.3 in an hour (one standard deviation), thrown back from ±30 %."""
    at = _knots(hours)
    steps = np.random.default_rng((seed, 7)).standard_normal(len(at)) * np.sqrt(KNOTS_S / HOUR_S)
    walk = np.cumsum(FRICTION_DRIFT * steps)
    walk -= walk[0]
    folded = np.abs((walk - FRICTION_DRIFT) % (4.0 * FRICTION_DRIFT) - 2.0 * FRICTION_DRIFT)
    return Change("friction", at, 1.0 + folded - FRICTION_DRIFT)


def _zeros(seed: int, hours: float) -> dict[str, Course]:
    """Slow waves of both tensions from 0, with 0.1 to 0.3 N as their amplitude."""
    rng, at = np.random.default_rng((seed, 4)), _knots(hours)
    courses = {}
    for name in ("tension_in_N", "tension_out_N"):
        amplitude = rng.uniform(0.1, 0.3) * rng.choice((-1.0, 1.0))
        courses[name] = at, amplitude * np.sin(2.0 * np.pi * at / (HOUR_S * rng.uniform(1.0, 2.0)))
    return courses


def _begin(seed: int, hours: float) -> float:
    """When a fault begins, in the middle fifth of the run, at a sample [s]."""
    at = np.random.default_rng((seed, 8)).uniform(0.4, 0.6) * hours * HOUR_S
    return round(at * RATE_HZ) / RATE_HZ


def _site(seed: int, length: float) -> tuple[float, float]:
    """Where a fault is, in arc length: somewhere in the route, off its ends where it is short [m]."""
    given = machine(seed)
    clear = min(0.1 * given.length_m, 0.5 * (given.length_m - length))
    start = np.random.default_rng((seed, 9)).uniform(clear, given.length_m - length - clear)
    return float(start), float(start + length)


def _unplugged(channel: Channel) -> Callable[..., Scenario]:
    return lambda seed, hours=0.5, **options: unplugged(seed, hours, channel, **options)


DRIFTS: dict[str, Callable[..., Scenario]] = {
    "sound": sound,
    "drifting_friction_sinusoid": drifting_friction,
    "drifting_friction_random_walk": lambda seed, hours=1.0: drifting_friction(seed, hours, "random_walk"),
    "drifting_zeros": drifting_zeros,
    "growing_play": growing_play,
    "drifting": drifting,
}
"""Runs without a fault, each by (seed, hours)."""

FAULTS: dict[str, Callable[..., Scenario]] = {
    "frayed_tendon": frayed_tendon,
    "wet_sheath": wet_sheath,
    "kinked_sheath": kinked_sheath,
    "wrong_shape": wrong_shape,
    "unplugged_tension_in_N": _unplugged("tension_in_N"),
    "unplugged_displacement_in_m": _unplugged("displacement_in_m"),
    "unplugged_tension_out_N": _unplugged("tension_out_N"),
}
"""Runs with a fault of full size, each by (seed, hours)."""
