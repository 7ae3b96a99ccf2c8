"""Scenarios of `tests.twins` as runs that are followed, and how well their truth is met."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tests.twins import Machine, Scenario
from tssgeom.adapt.followed import followed_numbers
from tssgeom.adapt.offline import FollowedRun, RunFollower
from tssgeom.adapt.readings import CHANNELS, Moment, Readings
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.rig import Friction, Load, Rig, Sensor, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.simulation import Measured
from tssgeom.uncertain import Follow

TRUTH = {
    "friction.coefficient": "friction",
    "tension_in_offset.offset_N": "zero_tension_in_N",
    "tension_out_offset.offset_N": "zero_tension_out_N",
}
BEGIN_S = 30.0  # of what counts; chosen: some strokes


def rig_of(machine: Machine, *, friction_hourly: float = 0.5, zero_hourly_N: float = 0.25) -> Rig:
    """Return the rig that is stated of a machine; friction changes by a share of its value in an hour."""
    zero = Follow(sd=0.1, hourly_change=zero_hourly_N)
    friction = Follow(sd=0.1 * machine.friction, hourly_change=friction_hourly * machine.friction)
    return Rig(
        tendon=Tendon(pretension_N=machine.pretension_N, compliance_per_N=machine.compliance_per_N),
        friction=Friction(coefficient=machine.friction),
        load=Load(stiffness_N_per_m=machine.stiffness_N_per_m),
        sensors={name: Sensor(noise=noise) for name, noise in machine.noise.items()},
        adapt={key: friction if key == "friction.coefficient" else zero for key in TRUTH},
    )


def route_of(scenario: Scenario) -> MovingRoute:
    """Return the route as its sensor states it, exact but for a wrong gain."""
    given, gains = scenario.machine, scenario.truth["route_angle_gain"]
    at = np.concatenate(([0], np.flatnonzero(np.diff(gains)) + 1))
    arcs = [Arcs.exact(given.lengths_m, gains[i] * given.angles_rad) for i in at]
    return MovingRoute(scenario.times[at], arcs)


def columns_of(scenario: Scenario, *, every: int = 1, tension_out: bool = False) -> Measured:
    """Return what was measured in each `every`-th sample: the drive with T_in, and T_out where wanted."""
    read = {name: values[::every] for name, values in scenario.readings.items()}
    distal = read["tension_out_N"] if tension_out else None
    return Measured(scenario.times[::every], read["tension_in_N"], read["displacement_in_m"], distal)


def follow(
    scenario: Scenario, rig: Rig | None = None, *, every: int = 1, tension_out: bool = False
) -> FollowedRun:
    """Follow a scenario from its begin to its end."""
    columns = columns_of(scenario, every=every, tension_out=tension_out)
    follower = RunFollower(rig or rig_of(scenario.machine), route_of(scenario), columns)
    for _ in follower.rows():
        pass
    return follower.result()


class Scores(NamedTuple):
    """Errors of the numbers at the kept moments after the first seconds."""

    error: np.ndarray
    """[m, d] Estimate less truth."""
    se: np.ndarray
    """[m, d] Standard errors."""
    nees: np.ndarray
    """[m] Normalised squared error, 1 on the average where the covariance is right: over its d."""

    @property
    def coverage(self) -> np.ndarray:
        """[d] Share of the 95 % bands that hold the truth."""
        return np.mean(np.abs(self.error) < 1.96 * self.se, axis=0)

    @property
    def rms(self) -> np.ndarray:
        """[d]"""
        return np.sqrt(np.mean(self.error**2, axis=0))

    @property
    def worst(self) -> np.ndarray:
        """[d]"""
        return np.abs(self.error).max(axis=0)


def scores(run: FollowedRun, scenario: Scenario) -> tuple[Scores, Scores]:
    """Return the scores of filtered and of smoothed numbers, of those that are followed from the begin on."""
    keys = [key for key in run.stretches[0].keys if key in TRUTH]
    results = list[tuple[np.ndarray, ...]]()
    for stretch in run.stretches:
        numbers, at = stretch.numbers, [stretch.keys.index(key) for key in keys]
        counts = numbers.time > BEGIN_S
        rows = np.searchsorted(scenario.times, numbers.time[counts])
        truth = np.column_stack([scenario.truth[TRUTH[key]][rows] for key in keys])
        results.append(
            (
                numbers.filtered[counts][:, at] - truth,
                numbers.filtered_covariance[counts][:, at][:, :, at],
                numbers.values[counts][:, at] - truth,
                numbers.covariance[counts][:, at][:, :, at],
            )
        )
    filtered, filtered_spread, smoothed, spread = (
        np.concatenate(parts) for parts in zip(*results, strict=True)
    )
    return _scores(filtered, filtered_spread), _scores(smoothed, spread)


def _scores(error: np.ndarray, spread: np.ndarray) -> Scores:
    se = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    whitened = np.linalg.solve(spread, error[:, :, None])[:, :, 0]
    return Scores(error, se, np.sum(error * whitened, axis=1) / error.shape[1])


def exact_tension_out(scenario, every):
    """Return T_out of the rig with its true numbers at each moment, driven by the position as read [N]."""
    rig, run = rig_of(scenario.machine), columns_of(scenario, every=every)
    numbers = followed_numbers(rig, CHANNELS[:1])
    truth = np.column_stack([scenario.truth[TRUTH[one.key]][::every] for one in numbers])
    model = RigFilter(rig, numbers, route_of(scenario).at(0.0))
    model.muted.update(CHANNELS)
    ends = np.empty(len(run.time))
    for i, now in enumerate(run.time):
        model.members[:] = truth[i]
        readings = Readings(displacement_in=float(scenario.readings["displacement_in_m"][::every][i]))
        ends[i] = model.step(Moment(float(now), model.cut, readings)).ends[1]
    return ends
