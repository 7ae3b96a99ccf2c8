"""Scenarios of the independent simulator, followed."""

import numpy as np

from tests.twins.scenarios import Scenario
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.readings import Readings
from tssgeom.rig import Friction, Load, Rig, Sensor, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.uncertain import Follow


def rig_of(scenario: Scenario) -> Rig:
    """Return the rig that a user would write for the machine of a scenario."""
    machine = scenario.machine
    return Rig(
        tendon=Tendon(pretension_N=machine.pretension_N, compliance_per_N=machine.compliance_per_N),
        friction=Friction(coefficient=machine.friction),
        load=Load(stiffness_N_per_m=machine.stiffness_N_per_m),
        sensors={name: Sensor(noise=noise) for name, noise in machine.noise.items()},
        adapt={
            "friction.coefficient": Follow(sd=0.1 * machine.friction, hourly_change=0.5 * machine.friction),
            "tension_in_offset.offset_N": Follow(sd=0.1, hourly_change=0.25),
        },
    )


def followed(
    scenario: Scenario, follower: Follower, seconds: float, tension_out: bool = False, begin: int = 0
):
    """Yield the sample, and what is known after it, of so many seconds of a scenario from a sample on."""
    machine, gains = scenario.machine, scenario.truth["route_angle_gain"]
    arcs, last = None, None
    for i in range(begin, min(begin + round(100 * seconds), len(scenario.times))):
        if gains[i] != last:
            last = gains[i]
            arcs = Arcs.exact(machine.lengths_m, last * machine.angles_rad)
        read = {name: float(values[i]) for name, values in scenario.readings.items()}
        out = read["tension_out_N"] if tension_out else None
        readings = Readings(read["tension_in_N"], read["displacement_in_m"], out)
        known = follower.take(arcs, readings, float(scenario.times[i]))
        follower.work()
        yield i, known


def errors(scenario: Scenario, follower: Follower, seconds: float, first: float = 30.0):
    """Return errors of friction and of the zero of T_in, [n, 2], and their standard errors."""
    truth = np.column_stack((scenario.truth["friction"], scenario.truth["zero_tension_in_N"]))
    rows = [(known.values - truth[i], known.se) for i, known in followed(scenario, follower, seconds)]
    begin = round(100 * first)
    return np.array([row[0] for row in rows[begin:]]), np.array([row[1] for row in rows[begin:]])
