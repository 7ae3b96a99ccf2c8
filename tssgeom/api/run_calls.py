"""The calls for whole runs, `simulate` and `compensate`: each takes arrays and objects, or paths of files.

What a call needs is imported when it runs, so that `import tssgeom` stays quick.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, overload

from tssgeom.channel_names import quantity_of
from tssgeom.errors import SettingsError

if TYPE_CHECKING:
    from tssgeom.api.inputs import RigGiven, RunGiven, ShapesGiven
    from tssgeom.api.machine_calls import MachineChannels
    from tssgeom.api.runs import Compensation, Simulation
    from tssgeom.arrays import Vector
    from tssgeom.route.pieces import Arcs
    from tssgeom.route.route_fit import SharedErrors
    from tssgeom.tendon.command import Command
    from tssgeom.tendon.command_error import DistalErrors
    from tssgeom.tendon.commander import Policy
    from tssgeom.tendon.moving import MovingRoute
    from tssgeom.tendon.state import TendonState

_DRIVES = ("tension_in_N", "displacement_in_m")
_TARGETS = ("displacement_out_m", "tension_out_N")


@overload
def simulate(
    time: Vector,
    route: MovingRoute,
    rig: RigGiven = None,
    *,
    tension_in: Vector | None = None,
    displacement_in: Vector | None = None,
    temperature: Vector | None = None,
    state: TendonState | None = None,
) -> Simulation: ...
@overload
def simulate(
    shapes: ShapesGiven,
    run: RunGiven,
    /,
    rig: RigGiven = None,
    *,
    state: TendonState | None = None,
    unit: str | None = None,
) -> Simulation | MachineChannels: ...
def simulate(  # pyright: ignore[reportInconsistentOverload]
    time: Any,
    route: Any,
    rig: RigGiven = None,
    *,
    tension_in: Vector | None = None,
    displacement_in: Vector | None = None,
    temperature: Vector | None = None,
    state: TendonState | None = None,
    unit: str | None = None,
) -> Simulation | MachineChannels:
    """Drive a tendon through a run.

    Call `simulate(time, route, rig, tension_in=...)`, or `simulate(shapes, run, rig)`.

    Parameters
    ----------
    time
        [n] Times of the run [s]. Or the shapes: a path, `Frame`, `FrameResult`, `Arcs` or `MovingRoute`;
        with None the route is the even bend that the rig gives.
    route
        The route over time. After shapes, the run instead: a path, a `MeasuredRun`, or columns such as a data
        frame with `time_s` and `tension_in_N` or else `displacement_in_m` (docs/formats.md, Measured runs).
    rig
        Tendon, friction, load and effects, or the path of a rig file; that of the paper by default.
    tension_in, displacement_in
        [n] Total tension [N] or position [m] of the drive; one of them, and only beside times. A tension is
        what its sensor reads, which is not the true one where effects spoil that sensor.
    temperature
        [n] Temperature [°C]; the same throughout where left out. Only beside times.
    state
        Tension along the tendon before the run; the rig's pretension by default.
    unit
        Unit of length, such as "mm" or "in", of a file of shapes that states none.

    Returns
    -------
    Simulation or MachineChannels
        A sequence with one `Moment` for each time. Of a rig with several tendons, a joint or a segment the
        `channels` over time, on the first route of a recording.

    Raises
    ------
    SettingsError, FitError
        As `tssgeom.step`; where the sensor of the drive lags, or the run is refused (docs/checks.md).
    ShapeError, SourceError
        Where a file cannot be used.

    Notes
    -----
    Source: docs/model.md; Sun, Wang and Phee (2014), Theorem 1 and Fig. 5.

    Examples
    --------
    A pull to 15 N and back to 10 N on a half circle of 0.5 m, in the dead zone of Fig. 4 at the end:

    >>> import numpy as np
    >>> from tssgeom import Arcs, MovingRoute, Rig, simulate
    >>> route = MovingRoute(np.array([0.0]), [Arcs.exact([0.5], [np.pi])])
    >>> time, pull = np.array([0.0, 1.0, 2.0]), np.array([0.0, 15.0, 10.0])
    >>> run = simulate(time, route, Rig(), tension_in=pull)
    >>> [round(1e3 * float(moment.transmission.elongation), 3) for moment in run]
    [0.0, 1.904, 1.728]
    """
    from tssgeom.api.inputs import route_of, run_of, temperature_of, uncertain_rig_of, warnings_of_run
    from tssgeom.api.runs import Simulation
    from tssgeom.tendon import simulation
    from tssgeom.tendon.moving import MovingRoute

    rig, uncertain = uncertain_rig_of(rig)
    begun: dict[str, Any] = {"state": state, "uncertain": uncertain}
    columns: dict[str, Any] = {
        "tension_in": tension_in,
        "displacement_in": displacement_in,
        "temperature": temperature,
    }
    if isinstance(route, MovingRoute):
        rows = simulation.simulate(time, route, rig, **columns, **begun)
        return Simulation(tuple(rows), angles=_angles(route, time))
    if any(each is not None for each in columns.values()):
        raise SettingsError("simulate: the run brings its drive: leave tension_in and displacement_in out")
    run, moving = run_of(route, rig), route_of(time, rig, unit)
    if rig.is_machine:
        from tssgeom.api.machine_calls import machine_on, simulated_machine

        return simulated_machine(run, machine_on(moving.arcs[:1], rig))
    warnings = warnings_of_run(run, rig, moving, fitted=False)
    name, drive = run.channel(_DRIVES)
    columns = {quantity_of(name): drive, "temperature": temperature_of(run, rig)}
    rows = simulation.simulate(run.time, moving, rig, **columns, **begun)
    return Simulation(tuple(rows), run, _angles(moving, run.time), warnings)


def _angles(route: MovingRoute, time: Vector) -> tuple[tuple[float, float], ...]:
    """Return the curve angle and its standard error at each time [rad]; nothing where the route stands."""
    if len(route.arcs) == 1:
        return ()
    return tuple((each.total_angle, each.total_angle_se) for each in map(route.at, time.tolist()))


@overload
def compensate(
    state: TendonState,
    arcs: Arcs,
    rig: RigGiven = None,
    *,
    tension_out: float | None = None,
    displacement_out: float | None = None,
    time: float | None = None,
    temperature: float | None = None,
    position: float | None = None,
    elapsed: float | None = None,
    may_wait: Callable[[TendonState], bool] | None = None,
    shared: SharedErrors | None = None,
    kept: DistalErrors | None = None,
) -> Command: ...
@overload
def compensate(
    shapes: ShapesGiven,
    target: RunGiven,
    /,
    rig: RigGiven = None,
    *,
    tolerance: float | None = None,
    policy: Policy = "cross",
    unit: str | None = None,
) -> Compensation | MachineChannels: ...
def compensate(  # pyright: ignore[reportInconsistentOverload]
    state: Any,
    arcs: Any,
    rig: RigGiven = None,
    *,
    tolerance: float | None = None,
    policy: Policy = "cross",
    unit: str | None = None,
    **options: Any,
) -> Command | Compensation | MachineChannels:
    """Return what the drive has to do for a target of the distal end.

    Call `compensate(state, arcs, rig, displacement_out=...)` for one move, or
    `compensate(shapes, target, rig)` for a run of targets.

    Parameters
    ----------
    state
        Tension along the tendon before the move. Or the shapes: a path, `Frame`, `FrameResult`, `Arcs` or
        `MovingRoute`; with None the route is the even bend that the rig gives.
    arcs
        The route after the move. After shapes, the targets instead: a path, a `MeasuredRun`, or columns such
        as a data frame with `time_s` and `displacement_out_m` or else `tension_out_N`, or of a joint
        `joint_angle_rad`.
    rig
        Tendon, friction, load and effects, or the path of a rig file, whose errors then count in those of the
        commands; that of the paper by default.
    tolerance
        Distance from the target that may be missed [m]; only of a run.
    policy
        What the drive does where a target asks it to turn: "cross" the dead zone, or "wait" in it; only of a
        run.
    unit
        Unit of length, such as "mm" or "in", of a file of shapes that states none.
    options
        Of one move: `tension_out` [N] or `displacement_out` [m], one of them, and the others of
        `tssgeom.tendon.command.compensate`.

    Returns
    -------
    Command, Compensation or MachineChannels
        The command of one move; of a run a sequence of them; of a rig with a joint the `channels` over time.

    Raises
    ------
    SettingsError
        Where not exactly one target is given, where no proximal tension can reach it, or where the command is
        beyond reason (docs/checks.md).
    FitError
        Where a moving route has no equilibrium.
    ShapeError, SourceError
        Where a file cannot be used.

    Notes
    -----
    Source: docs/model.md, "Compensation: the inverse model".

    Examples
    --------
    The load, a spring of 1000 N/m, moves by 5 mm where the drive moves by 6 mm and pulls with 7.9 N:

    >>> import numpy as np
    >>> from tssgeom import Arcs, Rig, compensate, pretensioned
    >>> route = Arcs.exact([0.5], [np.pi])
    >>> command = compensate(pretensioned(Rig()), route, Rig(), displacement_out=0.005)
    >>> print(f"{1e3 * command.displacement_in:.2f} mm, {command.tension_in:.2f} N")
    6.00 mm, 7.89 N
    """
    from tssgeom.api.inputs import rig_of
    from tssgeom.tendon import command
    from tssgeom.tendon.state import TendonState

    if isinstance(state, TendonState):
        if "shared" in options and options["shared"] is None:
            del options["shared"]
        return command.compensate(state, arcs, rig_of(rig), **options)
    if options:
        raise SettingsError(f"compensate: {next(iter(options))} is of one move: a run brings its targets")
    from tssgeom.api.inputs import route_of, run_of, temperature_of, uncertain_rig_of, warnings_of_run
    from tssgeom.api.runs import Compensation
    from tssgeom.tendon.commander import commander_of
    from tssgeom.tendon.simulation import commands

    known, uncertain = uncertain_rig_of(rig)
    run, moving = run_of(arcs, known), route_of(state, known, unit)
    if known.is_machine:
        from tssgeom.api.machine_calls import commanded_machine

        return commanded_machine(run, moving.arcs[:1], known, uncertain, tolerance=tolerance, policy=policy)
    commander = commander_of(known, uncertain, tolerance=tolerance, policy=policy)
    warnings = warnings_of_run(run, known, moving, fitted=False)
    name, target = run.channel(_TARGETS)
    given: dict[str, Any] = {quantity_of(name): target, "temperature": temperature_of(run, known)}
    rows = commands(run.time, moving, known, commander=commander, **given)
    return Compensation(tuple(rows), run.time, target, name == _TARGETS[1], warnings)
