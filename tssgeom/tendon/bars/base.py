"""One step of a tendon without effects, whose bars follow the sensed length of any route.

The laws are those of the base model, solved in core/tendon_bars.c; docs/model.md (40)-(49).
"""

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.errors import FitError, SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.bars.model import check_compliance
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.capstan import Transmission, check_tension

_SOLVED = 1e-8  # ln T of bars within which the front has come through: they are solved to 1e-10
_FARTHEST = 1e6  # beyond it a position is taken for a mistake of units or of a sensor [m]
_RUNS_AWAY, _STUCK_FAST = 3, 4  # codes of core/tendon.h


def step_on(
    state: BarState,
    routes: tuple[Arcs, Arcs],
    rig: Rig,
    load: float,
    drive: tuple[float, bool],
    stretches_with_route: bool,
    most_friction: float,
) -> tuple[BarState, Arcs]:
    """Return the state after a step, and the route on which it lies: the second where the route has moved.

    `load` is its stiffness [N/m]; `drive` is a tension [N] or a position [m], and whether it is a tension.

    Raises
    ------
    SettingsError
        Where the tendon does not stretch, μΦ is beyond `most_friction`, or a dead weight runs away.
    FitError
        Where there is no equilibrium.
    """
    before, now = routes
    tendon, friction, (goal, by_force) = rig.tendon, rig.friction.coefficient, drive
    check_compliance(tendon.compliance_per_N)
    code, block, ends = core.step_bars(
        state.edge,
        state.memory.block,
        before.length,
        before.angle,
        before.noise_covariance,
        now.length,
        now.angle,
        now.noise_covariance,
        before is not now,
        friction,
        tendon.compliance_per_N,
        tendon.pretension_N,
        load,
        most_friction,
        state.length if stretches_with_route else -1.0,
        goal,
        by_force,
        state.displacement_in,
    )
    numbers = ends.tolist()
    if code == _STUCK_FAST:
        raise too_much_friction(friction, numbers[8] / friction)
    return after_step(state, code, block, numbers, drive), now if numbers[5] else before


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
    """Return ζ after a step in which the drive moved, in either unit, and the first contact slipped.

    `slip` is +1 where it slid on a pull, −1 on a release, 0 where it stuck.
    """
    if slip == 0 and moved_by == 0.0:
        return before
    return 1 if slip == 1 or (slip == 0 and moved_by > 0.0) else -1


def no_equilibrium(drive: float, by_force: bool) -> FitError:
    """Return the error of a step that has no equilibrium."""
    what = f"tension_in {drive:g} N" if by_force else f"displacement_in {drive:g} m"
    return FitError(f"there is no equilibrium of the tendon at {what}: take smaller steps")


def too_much_friction(coefficient: float, angle: float) -> SettingsError:
    """Return the error of friction so large that no float holds what it makes of a tension; angle in rad."""
    return SettingsError(
        f"friction.coefficient is {coefficient:g} on {angle:.3g} rad of route: nothing gets through; "
        "check the coefficient"
    )


def after_step(
    state: BarState, code: int, block: Vector, ends: list[float], drive: tuple[float, bool]
) -> BarState:
    """Return the state of what `core.step_bars` returned; `drive` as in `step_on`.

    Raises
    ------
    SettingsError
        Where a dead weight runs away, with the tensions that hold it.
    FitError
        Where there is no equilibrium.
    """
    goal, by_force = drive
    if code == _RUNS_AWAY:
        raise SettingsError(
            f"tension_in is {goal:g} N: a dead weight of {state.tension_out:g} N would run away outside of "
            f"{ends[7]:.4g} to {ends[8]:.4g} N; drive by position, or give the load a stiffness"
        )
    if code:
        raise no_equilibrium(goal, by_force)
    block.setflags(write=False)
    position = ends[0]
    return BarState(
        edge=state.edge,
        memory=Memory(block),
        displacement_in=position,
        displacement_out=ends[1],
        elongation=ends[2],
        direction_index=direction_after(
            int(ends[6]), position - state.displacement_in, state.direction_index
        ),
        length=ends[4],
        iterations=int(ends[3]),
        by_force=by_force,
    )


def transmit(state: BarState, arcs: Arcs, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of bars on the route `arcs`; docs/model.md (49)."""
    tendon, way = rig.tendon, state.direction_index
    ends = core.transmit_bars(
        state.edge,
        state.memory.block,
        arcs.length,
        arcs.angle,
        arcs.covariance,
        tendon.compliance_per_N,
        tendon.pretension_N,
        rig.friction.coefficient,
        way,
    )
    # the tension of corners through the bars scales the dead zone alone; that of the result was solved for
    through_bars, tension_out_se, _, elongation_se, width, front, _ = ends.tolist()
    tension_in = state.tension_in
    inside = width > _SOLVED * max(tension_in, through_bars)  # bars are less exact than corners
    return Transmission(
        tension_in=tension_in,
        tension_out=state.tension_out,
        elongation=state.elongation,
        elongation_se=elongation_se,
        tension_out_se=tension_out_se,
        direction_index=way,
        dead_zone=inside,
        dead_zone_width=width if inside else 0.0,
        slip_front=front,
        displacement_in=state.displacement_in,
        displacement_out=state.displacement_out,
    )
