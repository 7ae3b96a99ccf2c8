"""What the drives of a machine may do in one more run, and that run as its model has it.

Source: docs/discovery.md, "Designed experiments"; docs/model.md (345).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import TssgeomError
from tssgeom.identify.experiment_search import EFFORT
from tssgeom.identify.machine_evidence import FittedModel
from tssgeom.identify.machine_prediction import Machines
from tssgeom.identify.machine_run import MachineRun, turns_of
from tssgeom.identify.run_limits import RunLimits, top_speed, within_limits
from tssgeom.identify.waveform import Course, Range, Reach, Waveform, random_waveform, with_ways
from tssgeom.tendon.machine_simulation import drive_channels, simulated_channels


class Drives:
    """What the drives of the next run may do, and the run that they make."""

    def __init__(self, model: FittedModel, runs: Sequence[MachineRun], stated: Mapping[str, float]) -> None:
        template = runs[0]
        self.model, self.runs = model, runs
        self.channels = drive_channels(template.drive, template.tendons)
        self.by_force = template.drive in ("tension_in", "motor_torque_Nm")
        self.metres = model.rig.drive.arm if template.drive.startswith("motor") else 1.0
        routes = model.on_known_routes(template).routes
        none = np.zeros(0, dtype=bool)
        self.template = replace(template, name="proposed", routes=routes, legs=None, bends={}, held_out=none)
        self.machines = Machines(model.rig, model.problem.bars)
        time = [run.given["time_s"] for run in runs]
        reached = [self._reached(run) for run in runs]
        interval = min(float(np.median(np.diff(each))) for each in time)
        self.limits: RunLimits = within_limits(
            reached, model.rig, stated, interval, max(len(each) for each in time)
        )
        self.range = self._range(reached)

    def waveform(self, rng: np.random.Generator) -> Waveform:
        """Return a waveform at random."""
        made = random_waveform(rng)
        return with_ways(made, rng) if isinstance(self.range, Reach) else made

    def run(self, course: Course) -> MachineRun | None:
        """Return a run as the model has it; None where it goes beyond a limit or has no equilibrium."""
        level = {name: np.full(len(course.time), np.mean(each)) for name, each in self.template.given.items()}
        driven = dict(zip(self.channels, np.ascontiguousarray(course.drive.T), strict=True))
        given = {**level, "time_s": course.time, **driven}
        held = np.zeros(len(course.time), dtype=bool)
        run = replace(self.template, given=given, held_out=held)
        try:
            channels = simulated_channels(self.machines.simulation(run, {}))
        except TssgeomError:
            return None
        measured = {name: channels[name] for name in self.template.measured}
        return replace(run, measured=measured) if self._allowed(course.time, channels) else None

    def _allowed(self, time: Vector, channels: Mapping[str, Vector]) -> bool:
        """Whether a run stays within the limits; a drive by position has its course within those of it."""
        tension, limits = _tensions(channels), self.limits
        within = (
            tension.max() <= EFFORT.over * limits.tension_N
            and tension.min() >= limits.least_tension_N / EFFORT.over
        )
        if not (within and self.by_force):
            return bool(within)
        moved = self._moved(channels)
        return bool(
            1e3 * np.abs(moved).max() <= EFFORT.over * limits.travel_mm
            and 1e3 * max(top_speed(time, each) for each in moved.T) <= EFFORT.over * limits.speed_mm_per_s
        )

    def _moved(self, channels: Mapping[str, Vector]) -> Matrix:
        """Return how far the drives have gone [n, drives] [m]."""
        if self.by_force:
            drive = "displacement_in" if self.template.drive == "tension_in" else "motor_angle_rad"
            return self.metres * _columns(channels, drive_channels(drive, self.template.tendons))
        driven = _columns(channels, self.channels)
        return self.metres * (driven - driven[0])

    def _reached(self, run: MachineRun) -> dict[str, float]:
        """Return the extremes of one run by `KEYS`, by the model where they are not measured."""
        time = run.given["time_s"]
        known = replace(run, routes=self.model.on_known_routes(run).routes, bends={})
        channels = simulated_channels(self.machines.simulation(known, {}))
        tension, moved = _tensions(channels), self._moved(channels if self.by_force else run.given)
        return {
            "tension_N": float(tension.max()),
            "least_tension_N": float(tension.min()),
            "speed_mm_per_s": 1e3 * max(top_speed(time, each) for each in moved.T),
            "travel_mm": 1e3 * float(np.abs(moved).max()),
            "least_mm": 1e3 * float(moved.min()),
            "duration_s": float(time[-1] - time[0]),
        }

    def _range(self, reached: Sequence[Mapping[str, float]]) -> Range | Reach:
        """Return how far and how fast the drives may go."""
        limits = self.limits
        long = {"duration": limits.duration_s, "interval": limits.interval_s, "samples": limits.samples}
        if self.by_force or len(self.channels) > 1:
            start, points = self._points(reached)
            return Reach(start, points, speed=self._rate(reached), **long)
        both = 2.0 * min(each["least_mm"] for each in reached) < -max(each["travel_mm"] for each in reached)
        high, speed = (1e-3 * each / self.metres for each in (limits.travel_mm, limits.speed_mm_per_s))
        return Range(0.0, -high if both else 0.0, high, speed=speed, **long)

    def _points(self, reached: Sequence[Mapping[str, float]]) -> tuple[Vector, Matrix]:
        """Return where the drives begin, and [points, drives] where they were when one turned.

        They are farther from it, or nearer, as limits that are stated allow; docs/model.md (345).
        """
        by_tension = self.template.drive == "tension_in"
        rest = self.model.rig.tendon.pretension_N if self.by_force else 0.0
        start = np.full(len(self.channels), rest if by_tension else 0.0)
        points = np.concatenate([_turning(_columns(run.given, self.channels)) for run in self.runs])
        key = "tension_N" if self.by_force else "travel_mm"
        most = max(each[key] for each in reached)
        points = start + (points - start) * (self.limits.values[key] - rest) / (most - rest)
        return start, np.maximum(points, self.limits.least_tension_N) if by_tension else points

    def _rate(self, reached: Sequence[Mapping[str, float]]) -> float:
        """Return how fast a drive may change, in its unit over s: of forces what made the limit of speed."""
        if not self.by_force:
            return 1e-3 * self.limits.speed_mm_per_s / self.metres
        rate = max(
            top_speed(run.given["time_s"], run.given[each]) for run in self.runs for each in self.channels
        )
        return rate * self.limits.speed_mm_per_s / max(each["speed_mm_per_s"] for each in reached)


def _columns(run: Mapping[str, Vector], names: Sequence[str]) -> Matrix:
    return np.column_stack([run[name] for name in names])


def _turning(drives: Matrix) -> Matrix:
    """Return the samples [points, drives] at which any of some drives [n, drives] turns."""
    return drives[np.unique(np.concatenate([turns_of(each) for each in drives.T]))]


def _tensions(channels: Mapping[str, Vector]) -> Vector:
    """Return the proximal tensions of all tendons, one after the other [N]."""
    return np.concatenate([each for name, each in channels.items() if name.startswith("tension_in_")])
