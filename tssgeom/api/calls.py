"""The calls of a user's program: each takes arrays and objects, or the paths of their files.

What a call needs is imported when it runs, so that `import tssgeom` and `analyse` of an array stay quick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from tssgeom import analysis
from tssgeom.api.arguments import in_metres, require_no_unit, tension_of
from tssgeom.errors import SettingsError
from tssgeom.stream import Frame, FrameResult, Rejected

if TYPE_CHECKING:
    from tssgeom.api.inputs import RigGiven, RunGiven, ShapesGiven
    from tssgeom.api.runs import RecordingResult
    from tssgeom.arrays import Points, Vector
    from tssgeom.identify.calibration import Calibration
    from tssgeom.identify.campaign import Campaign
    from tssgeom.identify.finding import Finding
    from tssgeom.identify.machine_estimates import MachineCalibration
    from tssgeom.identify.proposal import Asked
    from tssgeom.route.pieces import Arcs
    from tssgeom.tendon.simulation import Measured


def analyse(
    points: Points | Frame | str | Path,
    rig: RigGiven = None,
    *,
    tension_in: float = 15.0,
    stations: Vector | None = None,
    unit: str | None = None,
) -> FrameResult:
    """Fit the route of a shape, and compute tension and elongation of its tendon.

    Parameters
    ----------
    points
        [n, 3] Sensed points from the proximal to the distal end, n >= 4; a row of NaN is a missing point [m].
        Or a `Frame`, which also holds what was measured beside the points. Or the path of a file of sensed
        shapes (docs/formats.md): of a recording the tendon goes through all frames, and the result is that of
        the last usable one; `analyse_all` gives all.
    rig
        Tendon, friction, load and sensors, or the path of a rig file; that of the paper by default.
    tension_in
        Total tension at the proximal end, where the frame has no drive [N].
    stations
        [n] Known arc length of the points, increasing [m]; estimated where left out. Only beside an array.
    unit
        Unit of length, such as "mm" or "in", of a file that states none, or of an array and its stations (m
        where left out).

    Returns
    -------
    FrameResult
        `profile.total_angle` ± `profile.total_angle_se` [rad], `arcs` (pieces of constant curvature),
        `transmission.tension_out` [N] and `transmission.elongation` [m], `warnings`.

    Raises
    ------
    ShapeError
        Where the points cannot be a route.
    SettingsError
        Where the tension is negative or not finite, or the rig file cannot be used.
    FitError
        Where the points give no finite curve.
    SourceError
        Where the file cannot be read.

    Notes
    -----
    Source: docs/model.md, Geometry and Transmission; Sun, Wang and Phee (2014), eqs. (5) to (12).

    Examples
    --------
    A half circle of 0.5 m at 15 N passes exp(-0.145 π) of the tension:

    >>> import numpy as np
    >>> from tssgeom import analyse
    >>> s = np.linspace(0.0, 0.5, 40)
    >>> angle = 2 * np.pi * s
    >>> points = np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * s)) / (2 * np.pi)
    >>> result = analyse(points, tension_in=15.0)
    >>> print(f"{result.profile.total_angle:.4f} rad, {result.transmission.tension_out:.3f} N")
    3.1416 rad, 9.512 N
    """
    tension_in, commander = tension_of(tension_in), None
    if isinstance(rig, str | Path):
        from tssgeom.api.inputs import carried_rig_of

        rig, commander = carried_rig_of(rig)
    if isinstance(points, Frame):
        require_no_unit(unit, "a Frame")
        return analysis.analyse(points, rig, tension_in=tension_in, stations=stations, commander=commander)
    if not isinstance(points, str | Path):
        if unit not in (None, "m"):
            points = cast("Points", in_metres(points, unit))
            stations = None if stations is None else in_metres(stations, unit)
        return analysis.analyse(points, rig, tension_in=tension_in, stations=stations, commander=commander)
    if stations is not None:
        raise SettingsError(f"{points}: stations belong to an array: give them as the column s_m of the file")
    from tssgeom.api.inputs import last_result, read

    return last_result(read(points, unit), rig, tension_in, commander)


def analyse_all(
    frames: Iterable[Frame | Rejected] | str | Path,
    rig: RigGiven = None,
    *,
    tension_in: float = 15.0,
    unit: str | None = None,
) -> RecordingResult:
    """Carry a tendon through all frames of a recording, and keep every result.

    Parameters
    ----------
    frames
        The recording: its path, what `read` returns, or any frames in order of time. A recording too long to
        be kept whole is for `process`, which yields one result after the other.
    rig
        Tendon, friction, load and sensors, or the path of a rig file; that of the paper by default.
    tension_in
        Total tension at the proximal end for frames that bring no drive [N].
    unit
        Unit of length, such as "mm" or "in", of a file that states none.

    Returns
    -------
    RecordingResult
        A sequence of `FrameResult`; a frame that cannot be used is among its `rejected`.

    Raises
    ------
    ShapeError, SourceError
        Where the file cannot be read.
    SettingsError
        Where the rig cannot be used.

    Notes
    -----
    Source: docs/model.md; the points of each frame are filtered also by those after it, (162).

    Examples
    --------
    >>> from tssgeom import analyse_all
    >>> result = analyse_all("sample_shapes/insertion.jsonl")
    >>> len(result), result.plots
    (600, ('tension', 'elongation', 'angle', 'transmission', 'elongation_loop'))
    """
    from collections import Counter

    from tssgeom.api.inputs import carried_rig_of, read
    from tssgeom.api.runs import RecordingResult
    from tssgeom.engine import recorded
    from tssgeom.io.formats.recording import Recording, in_order

    tension_in = tension_of(tension_in)
    if isinstance(frames, str | Path):
        frames = read(frames, unit)
    else:
        require_no_unit(unit, "a recording")
    of = frames if isinstance(frames, Recording) else None
    known, commander = carried_rig_of(rig)
    items = list(recorded(in_order(frames), known, tension_in=tension_in, commander=commander))
    results = tuple(each for each in items if isinstance(each, FrameResult))
    rejected = tuple(each for each in items if isinstance(each, Rejected))
    warnings = tuple(Counter(text for each in results for text in each.warnings))
    name, own = ("", ()) if of is None else (of.name, of.warnings)
    return RecordingResult(results, name, rejected, (*own, *warnings))


def calibrate(
    measured: Measured | RunGiven | list[RunGiven],
    arcs: Arcs | ShapesGiven | list[ShapesGiven] | None,
    rig: RigGiven = None,
    *,
    from_tension: float = 4.0,
    progress: Callable[[str, float], object] = lambda step, share: None,
    unit: str | None = None,
) -> Calibration | MachineCalibration:
    """Fit friction, compliance and zeros to a run; or a machine and unknown numbers of a rig to runs.

    Parameters
    ----------
    measured
        Drive and responses of the run: `Measured`, a path, a `MeasuredRun`, or columns such as a data frame
        with `time_s`, `tension_in_N` or else `displacement_in_m`, and `tension_out_N` or `elongation_m`. Or a
        list of runs, which are fitted together.
    arcs
        The route, with the covariance of its pieces. Or the shape: a path, `Frame` or `FrameResult`; of a
        recording the last frame. Or a list of routes, one a run or one a tendon; None where the rig has its
        own angle (docs/machines.md).
    rig
        Nominal rig, or the path of its file: pretension, load and the standard deviation of the angle gain
        are taken from it; that of the paper by default.
    from_tension
        Proximal tension below which the elongation does not count: slack is taken up there [N].
    progress
        Called with each step and the share of the work that is done [1].
    unit
        Unit of length, such as "mm" or "in", of a file of shapes that states none.

    Returns
    -------
    Calibration or MachineCalibration
        `estimates` with 95 % intervals by name; `applied(rig)` gives the rig with them. Of several runs, of a
        rig with several tendons, a joint or a segment, and of one whose file has numbers that are "unknown"
        or have an `sd`, a `MachineCalibration`: its `estimates`, and the `rig` with them.

    Raises
    ------
    SettingsError
        Where the route is straight, so that there is no friction to find; where the run is refused
        (docs/checks.md).
    FitError
        Where nothing can be fitted.
    ShapeError, SourceError
        Where a file cannot be used.

    Notes
    -----
    Source: docs/model.md, section on calibration.

    Examples
    --------
    >>> import numpy as np
    >>> from tssgeom import Arcs, MovingRoute, Rig, calibrate, simulate
    >>> route, time = Arcs.exact([0.5], [np.pi]), np.linspace(0.0, 20.0, 401)
    >>> pull = 5.0 + 10.0 * (1.0 - np.abs(time - 10.0) / 10.0)
    >>> run = simulate(time, MovingRoute(np.array([0.0]), [route]), Rig(), tension_in=pull)
    >>> table = run.to_arrow()
    >>> names = ("time_s", "tension_in_N", "tension_out_N", "elongation_m")
    >>> measured = {name: table[name] for name in names}
    >>> print(f"{calibrate(measured, route).estimates['friction'].value:.3f}")
    0.145
    """
    from tssgeom.api.inputs import measured_of, route_of, run_of, uncertain_rig_of, warnings_of_run
    from tssgeom.identify import calibration
    from tssgeom.identify.stated import beside_stated
    from tssgeom.route.pieces import Arcs
    from tssgeom.tendon.simulation import Measured

    given = rig
    rig, uncertain = uncertain_rig_of(rig, may_be_unknown=True)
    several = isinstance(measured, list | tuple) or isinstance(arcs, list | tuple | None)
    if several or uncertain or rig.is_machine:
        from tssgeom.api.machine_calls import fitted_machine

        runs = [run_of(each, rig) for each in _listed(measured)]
        routes = [route_of(each, rig, unit).arcs[-1] for each in _listed(arcs)]
        return beside_stated(fitted_machine(runs, routes, rig, uncertain, progress), rig, given)
    one: Any = measured
    route = arcs if isinstance(arcs, Arcs) else route_of(cast("Any", arcs), rig, unit).arcs[-1]
    warnings: tuple[str, ...] = ()
    if not isinstance(one, Measured):
        run = run_of(one, rig)
        warnings = warnings_of_run(run, rig, route_of(route, rig), fitted=True)
        one = measured_of(run, rig)
    fitted = calibration.calibrate(one, route, rig, from_tension=from_tension, progress=progress)
    return beside_stated(replace(fitted, warnings=(*warnings, *fitted.warnings)), rig, given)


def _listed(given: Any) -> list[Any]:
    return list(given) if isinstance(given, list | tuple) else [] if given is None else [given]


def discover(
    campaign: Campaign | str | Path,
    *,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
    propose: Asked | None = None,
    unit: str | None = None,
) -> Finding:
    """Find what the model of a rig lacks.

    Parameters
    ----------
    campaign
        Measured runs and the nominal rig, or the path of their folder, of one tendon or of a
        machine.
    seed
        Of the simulated clean campaigns; the same seed gives the same answer.
    progress
        Is called with each step and the share that is done [1].
    propose
        How many experiments to design, and within which limits; left out, none.
    unit
        Unit of length, such as "mm" or "in", of files of shapes that state none.

    Returns
    -------
    Finding
        Verdict, effects with intervals, misfit before and after, and the updated rig.

    Raises
    ------
    SettingsError
        Where the runs cannot be used, or limits forbid every experiment.
    ShapeError, SourceError
        Where a file is missing or cannot be used.

    Notes
    -----
    Source: docs/discovery.md.

    Examples
    --------
    >>> from tssgeom import discover
    >>> finding = discover("sample_shapes/campaign_hidden_bend")  # doctest: +SKIP
    >>> [effect.names for effect in finding.effects]  # doctest: +SKIP
    [('hidden_bend',)]
    """
    from tssgeom.identify import workflow

    if not isinstance(campaign, str | Path):
        return workflow.discover(campaign, seed=seed, progress=progress, propose=propose)
    from tssgeom.io.formats.campaigns import read_campaign
    from tssgeom.io.formats.machine_campaigns import is_machine_campaign, read_machine_campaign

    folder = Path(campaign)
    if not is_machine_campaign(folder):
        read = read_campaign(folder, unit)
        return workflow.discover(read, seed=seed, progress=progress, propose=propose)
    from tssgeom.identify.machine_discovery import discover_machine

    report = progress or cast("Callable[[str, float], object]", lambda step, share: None)
    machine = read_machine_campaign(folder, unit)
    return discover_machine(machine, progress=report, propose=propose, seed=seed)
