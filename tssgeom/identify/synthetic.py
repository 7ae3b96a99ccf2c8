"""Campaigns whose truth is known: the samples, made with the model itself and instruments of their own.

They show how the workflow is used. They are no test of it, since data and model share every equation;
`benchmarks.discovery` tests it on an independent simulator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.effects import HiddenBend, Library, LoadDependentFriction, SlackTakeUp
from tssgeom.rig import Friction, Load, Rig, Sensor, ShapeSensor, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import Course, chain, half_circle, positions, setup_a
from tssgeom.tendon.bars.model import predict

_BARS, _STEPS = 240, 4  # bars of the tendon, and steps of the model between two samples
_SAMPLES, _POINTS = 240, 121
_POINT_NOISE = 2e-4  # m
_REST = 0.03  # share of a run before the first pull
_SHARE_BENT = 0.6  # of the nonlinearity that the specification allows
_ZERO = 0.2  # sd of a channel's zero, of its noise
_CHANNELS: tuple[str, ...] = ("displacement_in_m", "tension_in_N", "tension_out_N", "elongation_m")

BELIEVED = Rig(
    tendon=Tendon(compliance_per_N=3.1e-4, pretension_N=1.5),
    friction=Friction(coefficient=0.145),
    load=Load(stiffness_N_per_m=5000.0),
    sensors={
        "tension_in_N": Sensor(noise=0.02, resolution=0.01, full_scale=30.0, nonlinearity=1e-3),
        "tension_out_N": Sensor(noise=0.02, resolution=0.01, full_scale=30.0, nonlinearity=1e-3),
        "elongation_m": Sensor(noise=3e-6, resolution=1e-6, full_scale=0.05),
        "displacement_in_m": Sensor(noise=1e-6, resolution=5e-7, full_scale=0.05),
    },
    shape=ShapeSensor(noise_mm=1e3 * _POINT_NOISE, angle_gain_sd=0.005),
)
"""The nominal rig."""
TRUE = msgspec.structs.replace(
    BELIEVED, tendon=Tendon(compliance_per_N=3.16e-4, pretension_N=1.5), friction=Friction(coefficient=0.149)
)
"""The rig as it is, but for its effects."""


@dataclass(frozen=True, slots=True)
class Pull:
    """One run of the plan."""

    name: str
    route: str
    levels: tuple[float, ...]
    """Proximal tensions at which the drive turns [N]."""
    speed: float
    """Of the drive [m/s]."""
    held_out: bool = False


@dataclass(frozen=True, slots=True)
class SampleRun:
    """What was recorded in one run."""

    plan: Pull
    columns: Mapping[str, Vector]
    """`time_s` [s] and the channels, in SI."""


@dataclass(frozen=True, slots=True)
class SampleCampaign:
    """A campaign and its truth."""

    name: str
    text: str
    """What acts, in a few words."""
    effects: tuple[Library, ...]
    routes: Mapping[str, Points]
    """Sensed points [n, 3] of each route [m]."""
    runs: tuple[SampleRun, ...]


COURSES: Mapping[str, Course] = {
    "half_circle": half_circle(),
    "setup_a": setup_a(),
    "chain": chain(
        np.array([0.08, 0.12, 0.07, 0.15, 0.08]),
        np.array([6.0, 0.0, 18.0, 7.0, 12.0]),
        np.array([0.0, 0.0, 1.2, 2.6, 4.0]),
    ),
}
"""Routes of all sample campaigns, each about half a metre long."""
PLAN = (
    Pull("half_slow", "half_circle", (8.0, 2.0, 12.0, 2.0, 16.0, 2.0), 3e-4),
    Pull("half_fast", "half_circle", (14.0, 3.0, 16.0, 6.0, 14.0, 1.5), 3e-3),
    Pull("loop_slow", "setup_a", (15.0, 4.0, 10.0, 2.0), 3e-4),
    Pull("loop_fast", "setup_a", (16.0, 5.0, 12.0, 5.0, 16.0, 3.0), 3e-3),
    Pull("chain", "chain", (10.0, 2.0, 16.0, 4.0, 12.0, 2.0), 1e-3, held_out=True),
)
_CAUSES: Mapping[str, tuple[str, tuple[Library, ...]]] = {
    "campaign_hidden_bend": (
        "a bend of 0.6 rad at 0.21 m that the shape sensor does not see",
        (HiddenBend(at_m=0.21, angle_rad=0.6),),
    ),
    "campaign_slack_take_up": (
        "0.6 mm of slack outside the sheath, taken up over 2 N",
        (SlackTakeUp(slack_m=6e-4, scale_N=2.0),),
    ),
    "campaign_load_dependent_friction": (
        "friction that falls with the tension, to the power of −0.2",
        (LoadDependentFriction(exponent=-0.2),),
    ),
    "campaign_clean": ("nothing: only friction and compliance are 3 % and 2 % off", ()),
}


def sample_campaigns() -> tuple[SampleCampaign, ...]:
    """Return all sample campaigns, the same at every call."""
    return tuple(
        _campaign(seed, name, text, effects)
        for seed, (name, (text, effects)) in enumerate(_CAUSES.items(), start=1)
    )


def _campaign(seed: int, name: str, text: str, effects: tuple[Library, ...]) -> SampleCampaign:
    rng = np.random.default_rng(seed)
    routes = {key: _sensed(course, rng) for key, course in COURSES.items()}
    bends = dict(zip(_CHANNELS, rng.choice([-1.0, 1.0], len(_CHANNELS)), strict=True))
    runs = tuple(SampleRun(pull, _recorded(pull, effects, bends, rng)) for pull in PLAN)
    return SampleCampaign(name, text, effects, routes, runs)


def arcs_of(course: Course) -> Arcs:
    """Return a course as the model takes it, without error."""
    return Arcs.exact(course.length, np.linalg.norm(course.bend, axis=1) * course.length)


def _sensed(course: Course, rng: np.random.Generator) -> Points:
    points = positions(course, np.linspace(0.0, course.total_length, _POINTS))
    return points + _POINT_NOISE * rng.standard_normal(points.shape)


def _recorded(
    pull: Pull, effects: tuple[Library, ...], bends: Mapping[str, float], rng: np.random.Generator
) -> dict[str, Vector]:
    """Return what the instruments read in a run that is driven by position."""
    arcs = arcs_of(COURSES[pull.route])
    time, position = _drive(pull, arcs)
    observed = predict(
        {"time_s": time, "displacement_in_m": position},
        arcs,
        TRUE,
        effects,
        drive="displacement_in_m",
        bars=_BARS,
    )
    read = {
        name: _read(observed[name][::_STEPS], BELIEVED.sensors[name], bends[name], rng) for name in _CHANNELS
    }
    return {"time_s": time[::_STEPS], **read}


def _drive(pull: Pull, arcs: Arcs) -> tuple[Vector, Vector]:
    """Return times [s] and positions [m] that take the nominal rig through the tensions of a plan.

    The drive turns at samples: a turn between two is not recorded, and costs more than all noise.
    """
    levels = np.array([BELIEVED.tendon.pretension_N, *pull.levels])
    order = np.arange(len(levels), dtype=float)
    believed = predict({"time_s": order, "tension_in_N": levels}, arcs, BELIEVED, bars=_BARS)
    turns = believed["displacement_in_m"]
    ends = np.cumsum([0.0, *np.abs(np.diff(turns)) / pull.speed])
    rest = _REST * ends[-1]
    step = (ends[-1] + rest) / (_SAMPLES - 1)
    step = round(step, 6 if step < 0.1 else 4)
    time = step / _STEPS * np.arange(_STEPS * (_SAMPLES - 1) + 1)
    return time, np.interp(time, step * np.round((rest + ends) / step), turns)


def _read(truth: Vector, sensor: Sensor, bend: float, rng: np.random.Generator) -> Vector:
    """Return readings: bent over full scale by a half sine, off by a zero of the day, noisy, in digits."""
    share = np.sin(np.pi * truth / sensor.full_scale)
    bent = truth + bend * _SHARE_BENT * sensor.nonlinearity * sensor.full_scale * share
    zero = _ZERO * sensor.noise * rng.standard_normal()
    noisy = bent + zero + sensor.noise * rng.standard_normal(len(truth))
    return sensor.resolution * np.round(noisy / sensor.resolution) + 0.0
