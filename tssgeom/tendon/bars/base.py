"""One step of a tendon without effects, whose bars follow the sensed length of any route.

The equilibrium is that of `balance.py`, with the laws of the base model; docs/model.md (40)-(49).
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tssgeom.arrays import Vector
from tssgeom.errors import FitError, SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.balance import balanced, workspace
from tssgeom.tendon.bars.bar_state import UNTIMED, BarState
from tssgeom.tendon.bars.contact_grid import discretised
from tssgeom.tendon.bars.equilibrium import TOLERANCES
from tssgeom.tendon.bars.fixed_route import PULLED, RELEASED, STUCK, range_of_drive
from tssgeom.tendon.bars.model import check_compliance
from tssgeom.tendon.bars.plant import Memory, Plant
from tssgeom.tendon.capstan import check_tension

_FARTHEST = 1e6  # beyond it a position is taken for a mistake of units or of a sensor [m]


def step(
    state: BarState,
    arcs: Arcs,
    rig: Rig,
    *,
    tension_in: float | None = None,
    displacement_in: float | None = None,
    stretches_with_route: bool = True,
) -> BarState:
    """Move the drive and the route at once, with the rig's tendon, load and Coulomb friction.

    Parameters
    ----------
    state
        Tension along the tendon before the step.
    arcs
        The route after the step.
    rig
        Tendon, friction and load.
    tension_in, displacement_in
        New total tension [N] or new position [m] of the drive; one of them.
    stretches_with_route
        Whether a longer route stretches the tendon; otherwise only more of it lies in view.

    Raises
    ------
    SettingsError
        Where not exactly one drive is given, where it is negative, not finite, or out of balance with a dead
        weight; where the tendon does not stretch.
    FitError
        Where no equilibrium was found.
    """
    return against_load(
        state,
        arcs,
        rig,
        (rig.load.stiffness_N_per_m, 0.0),
        tension_in=tension_in,
        displacement_in=displacement_in,
        stretches_with_route=stretches_with_route,
    )


def against_load(
    state: BarState,
    arcs: Arcs,
    rig: Rig,
    load: tuple[float, float],
    *,
    tension_in: float | None,
    displacement_in: float | None,
    stretches_with_route: bool = False,
) -> BarState:
    """Do as `step` against a load with a stiffness [N/m] whose force grows in the step [N]."""
    drive, by_force = one_drive(tension_in, displacement_in)
    tendon, friction, stiffness = rig.tendon, rig.friction.coefficient, load[0]
    check_compliance(tendon.compliance_per_N)
    if by_force and stiffness == 0.0:
        angle = discretised(state.edge, arcs.length, arcs.angle)[2]
        low, high = np.exp(-friction * angle), np.exp(friction * angle)
        check_balance(drive, state.tension_out, low, high, np.zeros(len(low)))
    rig_numbers = (friction, float(tendon.compliance_per_N), float(tendon.pretension_N), *load)
    result = _on_route(
        of_bars(state),
        (state.edge, arcs.length, arcs.angle),
        rig_numbers,
        state.length if stretches_with_route else -1.0,
        (drive, by_force, state.displacement_in),
    )
    return after_step(state, result, drive, by_force)


def one_drive(tension_in: float | None, displacement_in: float | None) -> tuple[float, bool]:
    """Return the drive of a step, and whether it is a tension [N] or else a position [m].

    Raises
    ------
    SettingsError
        Where not exactly one is given, or where it is negative or not finite.
    """
    by_force = displacement_in is None
    drive = tension_in if by_force else displacement_in
    if drive is None or (tension_in is not None and not by_force):
        raise SettingsError("a step needs one drive: give tension_in [N] or displacement_in [m], not both")
    if by_force:
        check_tension(drive)
    elif not abs(drive) <= _FARTHEST:
        raise SettingsError(f"displacement_in is {drive:g} m: give a finite position, and check its unit")
    return float(drive), by_force


def direction_after(slip: int, moved_by: float, before: int) -> int:
    """Return ζ after a step in which the first contact did `slip` and the drive moved, in either unit."""
    if slip == STUCK and moved_by == 0.0:
        return before
    return 1 if slip == PULLED or (slip == STUCK and moved_by > 0.0) else -1


def no_equilibrium(drive: float, by_force: bool) -> FitError:
    """Return the error of a step that has no equilibrium."""
    what = f"tension_in {drive:g} N" if by_force else f"displacement_in {drive:g} m"
    return FitError(f"no equilibrium of the tendon was found at {what}: take smaller steps")


def of_bars(state: BarState) -> tuple[Vector, Vector, NDArray[np.int8], Vector | None]:
    """Return tension, displacement, slip and rest: what a step without effects starts from."""
    memory = state.memory
    return memory.tension, memory.displacement, memory.slip, state.rest


def after_step(state: BarState, result: tuple[Any, ...], drive: float, by_force: bool) -> BarState:
    """Return the state of what `advanced` returned.

    Raises
    ------
    FitError
        Where that is no equilibrium.
    """
    bars, ends, length, iterations = result
    if iterations == 0:
        raise no_equilibrium(drive, by_force)
    for array in bars:
        array.setflags(write=False)
    tension, displacement, slip, rest = bars
    _, _, speed, travel, creep, _, remembered = state.memory
    memory = Memory(tension, displacement, speed, travel, creep, slip, remembered)
    position, displacement_out, elongation = ends
    moved_by = position - state.displacement_in
    return BarState(
        edge=state.edge,
        memory=memory,
        displacement_in=position,
        displacement_out=displacement_out,
        elongation=elongation,
        direction_index=direction_after(slip[0], moved_by, state.direction_index),
        length=length,
        rest=rest,
        iterations=int(iterations),
        by_force=by_force,
    )


def check_balance(drive: float, weight: float, low: Vector, high: Vector, force: Vector) -> None:
    """Refuse a tension [N] that lets a dead weight run away; contacts as in `Plant`.

    Raises
    ------
    SettingsError
        With the tensions that hold the weight.
    """
    least, most = range_of_drive(weight, low, high, force)
    room = TOLERANCES.dead_weight
    if not least * (1 - room) <= drive <= most * (1 + room):
        raise SettingsError(
            f"tension_in is {drive:g} N: a dead weight of {weight:g} N would run away outside of "
            f"{least:.4g} to {most:.4g} N; drive by position, or give the load a stiffness"
        )


@njit(cache=True, nogil=True, error_model="numpy")
def _on_route(old, route, rig_numbers, length_before, drive):
    """Step the bars of the base model; `length_before` [m] is below 0 where no path grows.

    `route` is where the bars are cut, and length [m] and angle [rad] of its pieces; `rig_numbers` are
    friction [1], compliance [1/N], pretension [N], stiffness of the load [N/m] and growth of its force [N];
    `drive` is as in `advanced`.
    """
    edge, piece_length, piece_angle = route
    friction, compliance, pretension, stiffness, lift = rig_numbers
    length, _, angle, _ = discretised(edge, piece_length, piece_angle)
    whole, n = np.sum(length), length.size
    none, soft, exponent = np.zeros(n + 2), np.zeros(n + 2), friction * angle  # docs/model.md (41)
    growth = np.zeros(n + 2)
    share = 1.0 - length_before / whole if length_before > 0.0 else 0.0  # by which the path grew
    for j in range(n):
        soft[j + 1] = compliance * length[j]
        growth[j + 1] = share * (length[j] - soft[j + 1] * old[0][j + 1])  # docs/model.md (40)
    soft[n + 1] = 1.0 / stiffness if stiffness > 0.0 else 0.0
    growth[n + 1] = soft[n + 1] * lift
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
        low=np.exp(-exponent),
        high=np.exp(exponent),
        force=none[1:],
        drag=none[1:],
        load_exponent=0.0,
        load_reference=1.0,
        wear_gain=0.0,
        wear_travel=1.0,
        speed_gain=0.0,
        speed_reference=1.0,
        backlash=0.0,
        pretension=pretension,
        load=stiffness,
        curved=False,
        by_rate=False,
        varied=False,
        swift=False,
    )
    return advanced(plant, old, growth, drive, whole)


@njit(cache=True, nogil=True, error_model="numpy")
def advanced(plant, old, growth, drive, length):
    """Return the new bars; both ends and the elongation [m]; the length [m]; the solves spent.

    The step is the equilibrium nearest to the old bars, with laws of bars that are not curved. `growth` is
    by how much each bar is stretched besides: a longer path, less what the bar gained by itself [m]. `drive`
    is a tension [N] or position [m], whether it is a tension, and the position before [m]. No solve means no
    equilibrium.
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
        change, solves = balanced(plant, memory, by_force, target, weight, 0.0, UNTIMED, given, cone, room)
        solves = solves if change < np.inf else 0
    drive_moved, load, elongation = _ends(plant, memory, given, displacement[n])
    where = position + drive_moved if by_force else goal
    moved = displacement + memory.displacement
    if rigid_in and memory.tension[0] > 0.0:
        moved[0] = goal  # to the last digit: held there, the tendon shall not seem to move
    return (memory.tension, moved, memory.slip, rest), (where, load, elongation), length, solves


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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
