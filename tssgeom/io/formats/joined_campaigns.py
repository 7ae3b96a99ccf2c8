"""New measured runs beside those of a campaign: `discover --with`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from tssgeom.errors import SettingsError, SourceError
from tssgeom.identify.campaign import Campaign, Route, Run
from tssgeom.identify.readings import with_held_out
from tssgeom.io.formats.campaigns import is_campaign, new_names, read_more_runs, read_run_on
from tssgeom.io.formats.files import CAMPAIGN
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.paths import SETTINGS_BYTES, bytes_of
from tssgeom.statistics import root_mean_square
from tssgeom.toml_keys import with_short_keys

PROPOSAL = "proposal.toml"
_FOLLOWED = 0.02  # of the range of the drive: rms beyond which another drive was run; chosen


def with_runs(
    campaign: Campaign,
    folder: Path,
    unit: str | None = None,
    columns: ColumnMap = NO_MAP,
    proposals: Sequence[Path] = (),
) -> Campaign:
    """Return a campaign with the runs of a folder; what is held out stays as it was.

    Parameters
    ----------
    campaign
        The runs so far.
    folder
        New runs: with a `campaign.toml` that lists them, whose rig is not read; or as CSV or Parquet files
        with the names of proposed runs, on their routes.
    unit, columns
        As `read_campaign`.
    proposals
        Files that may state the route on which each run was proposed, beside the one in the folder itself.

    Raises
    ------
    SettingsError, ShapeError, SourceError
        Where the folder has no run, or one cannot be used, or its route is not known.
    """
    if not folder.is_dir():
        raise SourceError(f"--with {folder}: no such folder: name the folder of the new runs")
    fixed = campaign if campaign.held_out_fixed else _fixed(campaign)
    if is_campaign(folder):
        runs, notes = read_more_runs(folder, campaign.rig, unit, columns)
    else:
        runs, notes = _tables(campaign, folder, columns, proposals)
    shared = [_known(run, fixed, folder.name) for run in runs]
    names = new_names([run.name for run in shared], {run.name for run in fixed.runs}, folder)
    named = [replace(run, name=names.get(run.name, run.name)) for run in shared]
    added = f"{', '.join(run.name for run in named)}: added from {folder}"
    return replace(fixed, runs=(*fixed.runs, *named), notes=(*fixed.notes, *notes, added))


def _fixed(campaign: Campaign) -> Campaign:
    """Return the campaign with its held-out runs decided."""
    runs, notes = with_held_out(campaign.runs)
    return replace(campaign, runs=runs, notes=(*campaign.notes, *notes), held_out_fixed=True)


def _known(run: Run, campaign: Campaign, folder: str) -> Run:
    """Return the run on the route of the campaign where the shapes are the same, else on one of its own."""
    routes = {each.route.name: each.route for each in campaign.runs}
    for route in routes.values():
        if np.array_equal(route.position, run.route.position):
            return replace(run, route=route)
    if run.route.name not in routes:
        return run
    return replace(run, route=replace(run.route, name=f"{folder}_{run.route.name}"))


def _tables(
    campaign: Campaign, folder: Path, columns: ColumnMap, proposals: Sequence[Path]
) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Read the tables of a folder as runs."""
    files = sorted(file for file in folder.iterdir() if file.suffix in (".csv", ".parquet"))
    if not files:
        raise SettingsError(
            f"--with {folder}: no run in it: put the measured runs there as CSV, or a {CAMPAIGN}"
        )
    proposed = _proposed((folder / PROPOSAL, *proposals))
    runs, notes = list[Run](), list[str]()
    for file in files:
        plan = proposed.get(file.stem, {})
        run, about = read_run_on(file, file.stem, _route(campaign, file, plan), campaign.rig, columns)
        runs.append(run)
        notes += [*about, *_followed(run, plan)]
    return tuple(runs), tuple(notes)


def _proposed(files: Sequence[Path]) -> dict[str, Mapping[str, Any]]:
    """Return what was proposed, by the name of the run; the first file that there is counts."""
    for file in files:
        if file.is_file():
            try:
                listed = tomllib.loads(with_short_keys(bytes_of(file, SETTINGS_BYTES)).decode())["run"]
                return {Path(run["data"]).stem: run for run in listed}
            except (msgspec.DecodeError, ValueError, KeyError, TypeError, RecursionError) as error:
                raise SettingsError(f"{file}: {error}: write it anew with --propose") from error
    return {}


def _route(campaign: Campaign, file: Path, plan: Mapping[str, Any]) -> Route:
    """Return the route of a run without a `campaign.toml`."""
    routes = {run.route.name: run.route for run in campaign.runs}
    name = plan.get("route", "")
    if name in routes:
        return routes[name]
    if name:
        raise SettingsError(
            f"{file}: it was proposed on another route ({name}): sense its shape, and list run and shape in "
            f"a {CAMPAIGN} in {file.parent}"
        )
    if len(routes) == 1:
        return next(iter(routes.values()))
    raise SettingsError(
        f"{file}: its route is not known: copy {PROPOSAL} of the proposal beside it, or list run and shape "
        f"in a {CAMPAIGN} there"
    )


def _followed(run: Run, plan: Mapping[str, Any]) -> list[str]:
    """Return a note where a run is not the one that was proposed; it counts all the same."""
    drive = plan.get("drive", "")
    if not drive:
        return []
    if drive not in run.columns:
        return [f"{run.name}: {drive} was proposed as drive and is missing; the run counts as it is."]
    time, values = run.columns["time_s"], run.columns[drive]
    there = np.isfinite(values)
    asked = np.array(plan["corners"], dtype=float)
    off = values[there] - np.interp(time[there] - time[0], plan["corner_time_s"], asked)
    if root_mean_square(off) <= _FOLLOWED * float(np.ptp(asked)):
        return []
    return [f"{run.name}: its drive is not the proposed one; it counts as the run that it is."]
