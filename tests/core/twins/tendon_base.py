"""Slow twin of one step of bars without effects; docs/model.md (40)-(49)."""

import numpy as np

from tests.core.twins.tendon_chain import PULLED, RELEASED, STUCK
from tests.core.twins.tendon_laws import Memory, Plant, balanced, workspace
from tests.core.twins.tendon_profile import discretised, exponential
from tssgeom.core.constants_tendon import BAR


def on_route(old, route, rig_numbers, length_before, drive):
    """Step the bars of the base model; `length_before` [m] is below 0 where no path grows.

    `route` is where the bars are cut, and length [m] and angle [rad] of its pieces; `rig_numbers` are
    friction [1], compliance [1/N], pretension [N] and stiffness of the load [N/m]; `drive` is as in
    `_advanced`.
    """
    edge, piece_length, piece_angle = route
    friction, compliance, pretension, stiffness = rig_numbers
    length, _, angle, _ = discretised(edge, piece_length, piece_angle)
    whole, n = np.sum(length), length.size
    none, soft, exponent = np.zeros(n + 2), np.zeros(n + 2), friction * angle  # docs/model.md (41)
    growth = np.zeros(n + 2)
    share = 1.0 - length_before / whole if length_before > 0.0 else 0.0  # by which the path grew
    for j in range(n):
        soft[j + 1] = compliance * length[j]
        growth[j + 1] = share * (length[j] - soft[j + 1] * old[0][j + 1])  # docs/model.md (40)
    soft[n + 1] = 1.0 / stiffness if stiffness > 0.0 else 0.0
    plant = Plant(
        soft=soft,
        toe=none,
        toe_scale=none,
        saved=none,
        saved_scale=1.0,
        clearance=0.0,
        creep_soft=none,
        creep_time=1.0,
        warm=none,
        rest=none,
        pulling=exponent,
        releasing=exponent,
        fitting=none[1:],
        low=exponential(-exponent),
        high=exponential(exponent),
        force=none[1:],
        load_friction=0.0,
        drag=none[1:],
        load_exponent=0.0,
        load_reference=1.0,
        wear_gain=0.0,
        wear_travel=1.0,
        speed_gain=0.0,
        speed_reference=1.0,
        presliding=none[1:],
        presliding_reference=1.0,
        backlash=0.0,
        pretension=pretension,
        load=stiffness,
        curved=False,
        by_rate=False,
        varied=False,
        swift=False,
    )
    return _advanced(plant, old, growth, drive, whole)


def _advanced(plant, old, growth, drive, length):
    """Return the new bars; both ends and the elongation [m]; the length [m]; the solves spent.

    The step is the equilibrium nearest to the old bars. `growth` is by how much a longer path stretches each
    bar [m]. `drive` is a tension [N] or position [m], whether it is a tension, and the position before [m].
    No solve means no equilibrium.
    """
    goal, by_force, position = drive
    tension, displacement, slip, old_rest = old
    n = displacement.size - 1
    rest, given = _rest(plant, tension, displacement, old_rest, growth, position)
    memory = Memory(  # of copies, as the old arrays refuse writes; displacements of this step alone
        tension.copy(),
        np.zeros(n + 1),
        np.zeros(n + 1),
        np.zeros(n + 1),
        np.zeros(n + 2),
        slip.copy(),
        np.zeros(1),
        np.zeros(6),
    )
    target, rigid_in = goal if by_force else goal - position, not by_force and plant.soft[0] == 0.0
    if rigid_in:  # docs/model.md (45)
        target += given[0]
        memory.tension[0] += (given[1] - plant.soft[1] * tension[1]) / plant.soft[1]
    if plant.load == np.inf and plant.soft[n + 1] == 0.0:
        memory.tension[n + 1] += (given[n] - plant.soft[n] * tension[n]) / plant.soft[n]
    solves, weight = 1, tension[n + 1]
    if not _hangs_loose(plant, memory, given, by_force, target):
        cone, room = workspace(plant)
        change, solves = balanced(
            plant, memory, by_force, target, weight, 0.0, BAR.untimed, given, cone, room
        )
        solves = solves if change < np.inf else 0
    drive_moved, load, elongation = _ends(plant, memory, given, displacement[n])
    where = position + drive_moved if by_force else goal
    moved = displacement + memory.displacement
    if rigid_in and memory.tension[0] > 0.0:
        moved[0] = goal  # to the last digit: held there, the tendon shall not seem to move
    return (memory.tension, moved, memory.slip, rest), (where, load, elongation), length, solves


def _rest(plant, tension, displacement, old_rest, growth, position):
    """Return the rest of each bar on the new route, and its stretch if no contact moves [m].

    A bar keeps its tension where its length or compliance changed; negative stretch is slack.
    """
    last = old_rest.size - 1
    rest, given = np.empty(last + 1), np.empty(last + 1)
    for j in range(last + 1):
        apart = displacement[j - 1] if j > 0 else position
        apart -= displacement[j] if j < last else 0.0
        pull = tension[j]
        given[j] = (plant.soft[j] * pull if pull > 0.0 else min(apart + old_rest[j], 0.0)) + growth[j]
        rest[j] = given[j] - apart if plant.soft[j] > 0.0 else 0.0
    return rest, given


def _hangs_loose(plant, memory, given, by_force, target):
    """Return whether the drive lets all tension go; the memory then has what each contact did.

    No tension at one contact is none anywhere, so the tendon hangs loose as soon as its path is no longer
    than it is itself. Each contact moves as little as leaves every bar loose; docs/model.md (46a).
    """
    n = memory.displacement.size - 1
    if plant.load == 0.0 or np.any(plant.force > 0.0) or np.any(plant.drag > 0.0):
        return False
    if target > 0.0 if by_force else plant.soft[0] > 0.0:
        return False
    most = np.empty(n + 1)
    most[n] = 0.0 if plant.soft[n + 1] == 0.0 else -given[n + 1]
    for i in range(n, 0, -1):
        most[i - 1] = most[i] - given[i]
    least = -np.inf if by_force else target
    if least > most[0]:
        return False
    for i in range(n + 1):
        moved = min(max(least, 0.0), most[i])
        memory.displacement[i] = moved
        memory.slip[i] = PULLED if moved > 0.0 else RELEASED if moved < 0.0 else STUCK
        if i < n:
            least = moved + given[i + 1]
    memory.tension[:] = 0.0
    return True


def _ends(plant, memory, given, load):
    """Return how far the drive moved, where the load is that was at `load`, and the elongation [m]."""
    tension, moved, n = memory.tension, memory.displacement, memory.displacement.size - 1
    elongation = 0.0
    for j in range(1, n + 1):
        elongation += plant.soft[j] * (tension[j] - plant.pretension)  # docs/model.md (44)
        if tension[j] <= 0.0:
            elongation += min(moved[j - 1] - moved[j] + given[j], 0.0)
    drive = moved[0] + plant.soft[0] * tension[0] - given[0]
    series = plant.soft[n + 1]
    load += moved[n]
    if plant.load > 0.0:
        series -= 1.0 / plant.load
        if tension[n + 1] <= 0.0 and plant.soft[n + 1] > 0.0:
            load += max(-moved[n] - given[n + 1], 0.0)
    return drive, load - series * (tension[n + 1] - plant.pretension), elongation
