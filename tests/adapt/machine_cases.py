"""Scenarios of `tests.twins.mechanisms` as rigs that are followed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.twins.mechanisms import LENGTH_M, MARKER_M, SEGMENT_DEG, Given, MachineScenario
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.machine_readings import MachineReadings
from tssgeom.mechanism import Drive, End
from tssgeom.rig import Friction, Rig, Sensor, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.uncertain import Follow


def arcs_of(machine: Given) -> Arcs:
    """Return the route of every tendon."""
    return Arcs.exact(np.array(machine.lengths_m), np.array(machine.angles_rad))


def rig_of(machine: Given, *, friction_hourly: float = 1.5) -> Rig:
    """Return the rig that is stated of a machine; friction changes by a share of its value in an hour."""
    end = {"radius_m": machine.arm_m, "stiffness_Nm_per_rad": machine.stiffness_Nm_per_rad}
    if machine.kind == "segment":
        end |= {"tendon_angles_deg": SEGMENT_DEG, "length_m": LENGTH_M, "marker_m": MARKER_M}
    drive = {
        "pair": Drive(kind="pair", radius_m=machine.pulley_m, play_rad=machine.play_rad),
        "joint": Drive(radius_m=machine.pulley_m),
        "segment": Drive(kind="tendons"),
    }[machine.kind]
    friction = Follow(sd=0.1 * machine.friction, hourly_change=friction_hourly * machine.friction)
    return Rig(
        tendon=Tendon(pretension_N=machine.pretension_N, compliance_per_N=machine.compliance_per_N),
        friction=Friction(coefficient=machine.friction),
        drive=drive,
        end=End(kind="segment" if machine.kind == "segment" else "joint", **end),
        sensors={name: Sensor(noise=noise) for name, noise in machine.noise.items()},
        adapt={"friction.coefficient": friction},
    )


_SLICES = 8
"""Slices of work that a stream of 50 Hz has time for after a frame."""


def followed(scenario: MachineScenario, follower: Follower) -> Iterator[float]:
    """Yield the time of each frame, once it is taken in and the work is done that no frame waits for [s]."""
    arcs = arcs_of(scenario.machine)
    for i, now in enumerate(scenario.times):
        readings = MachineReadings({name: float(one[i]) for name, one in scenario.readings.items()})
        follower.take(arcs, readings, float(now))
        for _ in range(_SLICES):
            follower.work()
        yield float(now)
