"""Campaigns: a folder whose `campaign.toml` lists measured runs, the shape of each, and the rig."""

from __future__ import annotations

import codecs
import os
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

import msgspec

from tssgeom.arrays import Vector
from tssgeom.channel_names import quantity_of
from tssgeom.engine import recorded
from tssgeom.errors import SettingsError, ShapeError, SourceError
from tssgeom.identify.campaign import Campaign, Route, Run
from tssgeom.io.formats.columns import CHANNELS
from tssgeom.io.formats.files import CAMPAIGN, open_recording, output_names
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.paths import SETTINGS_BYTES, bytes_of, split
from tssgeom.io.formats.runs import IN_SI, read_run
from tssgeom.plausibility.frames import rig_remarks
from tssgeom.plausibility.rules import warnings_of
from tssgeom.plausibility.runs import campaign_remarks, fit_remarks, run_remarks
from tssgeom.rig import Rig, Sensor, read_rig
from tssgeom.route.finer_pieces import finer_pieces
from tssgeom.route.pieces import Arcs
from tssgeom.stream import Frame, FrameResult, Rejected
from tssgeom.toml_keys import with_short_keys

_SPECIFIED = {quantity_of(name): (name, 1.0) for name in IN_SI.values()} | {
    name: (IN_SI[field], per_si) for name, (field, per_si) in CHANNELS.items()
}
"""Names of `[sensors.NAME]`: the column of a run in SI, and how many of the unit make one in SI."""


class Listed(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One `[[run]]`; its files are relative to the folder."""

    data: str
    shape: str | tuple[str, ...] = ""
    name: str = ""
    held_out: bool = False


class Plan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The content of `campaign.toml`."""

    run: tuple[Listed, ...]
    rig: str = "rig.toml"


def is_campaign(path: Path) -> bool:
    """Whether a path is the folder of a campaign, or the `campaign.toml` in it."""
    return path.name == CAMPAIGN or listing_of(path).is_file()


def listing_of(folder: Path) -> Path:
    """Return the `campaign.toml` of a folder, which may be given itself."""
    return folder if folder.name == CAMPAIGN else folder / CAMPAIGN


def read_campaign(folder: str | Path, unit: str | None = None, columns: ColumnMap = NO_MAP) -> Campaign:
    """Read a campaign, and fit the route of every shape in it.

    Parameters
    ----------
    folder
        The folder, or the `campaign.toml` in it.
    unit
        Unit of length, such as "mm" or "in", of shapes that state none.
    columns
        The user's statements on columns of the files.

    Returns
    -------
    Campaign
        The rig as it is believed to be, and each run with its route.

    Raises
    ------
    SettingsError
        Where `campaign.toml`, the rig or a run cannot be used.
    ShapeError, SourceError
        Where a file is missing or cannot be used.

    Examples
    --------
    >>> from tssgeom import read_campaign
    >>> campaign = read_campaign("sample_shapes/campaign_clean")
    >>> [run.name for run in campaign.runs if run.held_out]
    ['chain']
    """
    listing = listing_of(Path(folder))
    home = listing.parent
    plan = read_plan(listing)
    stated = read_rig(home / plan.rig)
    rig = _specified_in_si(stated)
    notes = list(_unknown_sensors(home / plan.rig, stated))
    notes += [f"{plan.rig}: {warning}" for warning in warnings_of(plan.rig, rig_remarks(rig))]
    runs, about = _runs(listing, plan, rig, unit, columns)
    return Campaign(home.resolve().name, rig, runs, (*notes, *about))


def read_more_runs(
    folder: Path, rig: Rig, unit: str | None = None, columns: ColumnMap = NO_MAP
) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Read the runs that the `campaign.toml` of a folder lists, of a rig that is known, and notes about them.

    Parameters
    ----------
    folder
        The folder; its own rig, if it has one, is not read.
    rig
        With specifications in SI, as `read_campaign` returns it.
    unit, columns
        As `read_campaign`.

    Raises
    ------
    SettingsError, ShapeError, SourceError
        As `read_campaign`.
    """
    listing = listing_of(folder)
    return _runs(listing, read_plan(listing), rig, unit, columns)


def read_run_on(
    path: Path, name: str, route: Route, rig: Rig, columns: ColumnMap = NO_MAP
) -> tuple[Run, tuple[str, ...]]:
    """Read one measured run on a route that is known, and notes about it; errors as `read_campaign`."""
    notes = list[str]()
    run = _run(path, name, route, columns.with_rig(rig.columns), notes, held_out=False)
    return run, (*notes, *_implausible(path, run, rig))


def _runs(
    listing: Path, plan: Plan, rig: Rig, unit: str | None, columns: ColumnMap
) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Return the runs that a campaign lists, and notes about them."""
    said, home, notes = columns.with_rig(rig.columns), listing.parent, list[str]()
    names, shapes = run_names(listing, plan.run), _shape_each(listing, plan.run)
    routes = _routes(home, shapes, rig, unit, said, notes)
    runs = []
    for name, listed, shape in zip(names, plan.run, shapes, strict=True):
        run = _run(home / listed.data, name, routes[shape], said, notes, held_out=listed.held_out)
        notes += _implausible(home / listed.data, run, rig)
        runs.append(run)
    notes += warnings_of(listing, campaign_remarks([(run.name, run.columns) for run in runs]))
    return tuple(runs), tuple(notes)


def read_plan(listing: Path) -> Plan:
    """Read `campaign.toml`; raises SettingsError or SourceError where it cannot be used."""
    if not listing.parent.is_dir():
        raise SourceError(f"{listing.parent}: no such folder: name the folder of a campaign")
    hint = f"a campaign is a folder with {CAMPAIGN} (docs/formats.md, Campaign)"
    content = bytes_of(listing, SETTINGS_BYTES, hint).removeprefix(codecs.BOM_UTF8)
    try:
        plan = msgspec.toml.decode(with_short_keys(content), type=Plan)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SettingsError(f"{listing}: {error}: mend it (docs/formats.md, Campaign)") from error
    if not plan.run:
        raise SettingsError(f"{listing}: no run: add a [[run]] with data and shape")
    if all(listed.held_out for listed in plan.run):
        raise SettingsError(f"{listing}: every run is held out: leave at least one to fit")
    return plan


def run_names(listing: Path, runs: Sequence[Listed]) -> list[str]:
    """Return the names of runs; raise SettingsError where two are alike."""
    names = [listed.name or Path(listed.data).stem for listed in runs]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise SettingsError(f"{listing}: two runs are called {twice[0]!r}: give each a name of its own")
    return names


def _shape_each(listing: Path, runs: Sequence[Listed]) -> list[str]:
    """Return the shape of each run of one tendon."""
    for k, listed in enumerate(runs):
        if not listed.shape or not isinstance(listed.shape, str):
            raise SettingsError(
                f"{listing}: `shape` of run[{k}] is not one file: name the shape of one tendon"
            )
    return [listed.shape for listed in runs if isinstance(listed.shape, str)]


def _specified_in_si(rig: Rig) -> Rig:
    """Return specifications named as columns in SI; a full name overrides a short one."""
    sensors = dict[str, Sensor]()
    for name in sorted(rig.sensors, key=CHANNELS.__contains__):
        whole, per_si = _SPECIFIED.get(name, (name, 1.0))
        stated = rig.sensors[name]
        sensors[whole] = Sensor(
            noise=stated.noise / per_si,
            resolution=stated.resolution / per_si,
            full_scale=stated.full_scale / per_si,
            nonlinearity=stated.nonlinearity,
        )
    return msgspec.structs.replace(rig, sensors=sensors)


def _unknown_sensors(path: Path, rig: Rig) -> list[str]:
    """Return a warning for each specification without a channel, since it has no effect."""
    unknown = [name for name in rig.sensors if name not in _SPECIFIED]
    return [f"{path.name}: [sensors.{name}] is no channel that a run can have: not used" for name in unknown]


def _routes(
    home: Path, shapes: Sequence[str], rig: Rig, unit: str | None, said: ColumnMap, notes: list[str]
) -> dict[str, Route]:
    """Return the route of each shape; runs that share a shape share the route."""
    files = {shape: home / shape for shape in shapes}
    named = output_names(list(dict.fromkeys(files.values())))
    return {shape: read_route(path, named[path], rig, unit, said, notes) for shape, path in files.items()}


def read_route(path: Path, name: str, rig: Rig, unit: str | None, said: ColumnMap, notes: list[str]) -> Route:
    """Fit the route of a shape, and add what was noticed to `notes`; raise ShapeError where there is none."""
    result = _read_shape(path, rig, unit, said, notes)
    return Route(name, result.arcs, result.route.position, result.route.s)


def read_finer_pieces(path: Path, rig: Rig, unit: str | None, said: ColumnMap, notes: list[str]) -> Arcs:
    """Do as `read_route`, and return its pieces as short as a machine needs them; docs/model.md (283)."""
    return finer_pieces(_read_shape(path, rig, unit, said, notes).fit)


def _read_shape(path: Path, rig: Rig, unit: str | None, said: ColumnMap, notes: list[str]) -> FrameResult:
    recording = open_recording(path, unit, said)
    result, reasons = _first_usable(recording.frames, rig)
    if result is None:
        raise ShapeError(f"{path}: {reasons[0] if reasons else 'no frame in it: give a shape'}")
    if recording.frame_count > 1:
        notes.append(
            f"{path.name} has {recording.frame_count} frames: the route is taken as fixed, "
            f"as in frame {result.seq}"
        )
    notes += [
        f"{path.name}: {warning}"
        for warning in (*how_read(recording.notes), *recording.warnings, *result.warnings)
    ]
    return result


def _first_usable(frames: Iterable[Frame | Rejected], rig: Rig) -> tuple[FrameResult | None, list[str]]:
    """Return the first frame that gives a route, and the reasons of those before it."""
    base = msgspec.structs.replace(rig, effects=())
    reasons = list[str]()
    for item in recorded(map(_shape_alone, frames), base, tension_in=rig.tendon.pretension_N):
        if isinstance(item, FrameResult):
            return item, reasons
        reasons.append(item.reason)
    return None, reasons


def _shape_alone(frame: Frame | Rejected) -> Frame | Rejected:
    """Return a frame without its measurements: the run has its own."""
    if isinstance(frame, Rejected):
        return frame
    return Frame(
        frame.points,
        frame.time,
        frame.stations,
        curvatures=frame.curvatures,
        curvature_noise=frame.curvature_noise,
        directions=frame.directions,
        length=frame.length,
    )


def how_read(notes: Sequence[str]) -> list[str]:
    """Return how a file was read as one note, or none."""
    return ["; ".join(notes)] if notes else []


def _run(path: Path, name: str, route: Route, said: ColumnMap, notes: list[str], *, held_out: bool) -> Run:
    return Run(name, route, read_columns(path, name, said, notes), held_out)


def read_columns(path: Path, name: str, said: ColumnMap, notes: list[str]) -> dict[str, Vector]:
    """Return the columns of a run that a campaign lists, in SI; how it was read is added to the notes.

    Raises SettingsError or SourceError where the file is missing or cannot be used.
    """
    if not os.path.isfile(split(path)[0]):
        raise SourceError(f"{path}: no such file: mend data in {CAMPAIGN}")
    measured = read_run(path, said)
    notes += [f"{name}: {text}" for text in (*how_read(measured.notes), *measured.warnings)]
    return measured.columns


def _implausible(path: Path, run: Run, rig: Rig) -> list[str]:
    """Return the warnings about a run; raise SettingsError where a rule refuses it."""
    arcs = run.route.arcs
    warnings_of(path, fit_remarks(run.columns))
    remarks = run_remarks(run.columns, rig, length=arcs.total_length, angle=arcs.total_angle)
    return [f"{run.name}: {warning}" for warning in warnings_of(path, remarks)]


def new_names(names: Iterable[str], taken: Collection[str], folder: Path) -> dict[str, str]:
    """Return names of runs that are taken with their new ones; SettingsError where these are taken too."""
    new = {name: f"{folder.resolve().name}_{name}" for name in names if name in taken}
    if again := [name for name in new.values() if name in taken]:
        raise SettingsError(f"--with {folder}: {again[0]} is there already: name each folder once")
    return new
