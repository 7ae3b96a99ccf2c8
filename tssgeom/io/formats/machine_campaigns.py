"""Campaigns of machines: the same `campaign.toml`, shapes where there are any, numbers that are not known."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec

from tssgeom.errors import SettingsError, TssgeomError
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_run import MachineRun, load_remarks, machine_run
from tssgeom.io.formats.campaigns import (
    Listed,
    Plan,
    listing_of,
    new_names,
    read_columns,
    read_finer_pieces,
    read_plan,
    run_names,
)
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.paths import split
from tssgeom.io.formats.runs import read_run
from tssgeom.mechanism import tendon_count
from tssgeom.plausibility.frames import rig_remarks
from tssgeom.plausibility.rules import warnings_of
from tssgeom.rig import Rig, read_uncertain_rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import route_of_rig

_FORCES = ("tension_in_N", "tension_out_N", "elongation_m")


def is_machine_campaign(folder: Path, columns: ColumnMap = NO_MAP) -> bool:
    """Whether a campaign is of a machine: by its rig, a missing shape, or runs of displacement alone.

    Raises SettingsError where `campaign.toml` or the rig cannot be used; ShapeError or SourceError where a
    file is missing or cannot be used.
    """
    listing = listing_of(folder)
    plan = read_plan(listing)
    rig, uncertain = read_uncertain_rig(listing.parent / plan.rig)
    if rig.is_machine or any(not each.stated for each in uncertain):
        return True
    if any(not listed.shape or not isinstance(listed.shape, str) for listed in plan.run):
        return True
    said = columns.with_rig(rig.columns)
    paths = [listing.parent / listed.data for listed in plan.run]
    if not all(os.path.isfile(split(path)[0]) for path in paths):
        return False  # the reader of one tendon names the file that is missing
    return not any(name in _FORCES for path in paths for name in read_run(path, said).columns)


def read_machine_campaign(
    folder: Path, unit: str | None = None, columns: ColumnMap = NO_MAP
) -> MachineCampaign:
    """Read a campaign of a machine.

    Parameters
    ----------
    folder
        The folder, or the `campaign.toml` in it. `shape` of a run may be left out where the rig has
        `[route]`, and may be a list of one file for each tendon.
    unit
        Unit of length, such as "mm" or "in", of shapes that state none.
    columns
        The user's statements on columns of the files.

    Raises
    ------
    SettingsError, ShapeError, SourceError
        As `read_campaign`.
    """
    listing = listing_of(folder)
    home = listing.parent
    plan = read_plan(listing)
    rig, uncertain = read_uncertain_rig(home / plan.rig)
    said, notes = columns.with_rig(rig.columns), list[str]()
    notes += [f"{plan.rig}: {warning}" for warning in warnings_of(plan.rig, rig_remarks(rig))]
    runs, held = _runs(listing, plan, rig, unit, said, notes)
    return MachineCampaign(home.resolve().name, rig, uncertain, runs, held, tuple(notes))


def with_machine_runs(
    campaign: MachineCampaign, folder: Path, unit: str | None = None, columns: ColumnMap = NO_MAP
) -> MachineCampaign:
    """Return a campaign with the runs that the `campaign.toml` of a folder lists, whose rig is not read.

    What is held out stays, beside what the new ones mark; of one run it is cycles unless these mark some.

    Raises SettingsError, ShapeError or SourceError as `read_campaign`.
    """
    listing, notes = listing_of(folder), list[str]()
    plan, rig = read_plan(listing), campaign.rig
    runs, held = _runs(listing, plan, rig, unit, columns.with_rig(rig.columns), notes)
    names = new_names([run.name for run in runs], {run.name for run in campaign.runs}, folder)
    named = tuple(replace(run, name=names.get(run.name, run.name)) for run in runs)
    alone = campaign.runs[0].name if len(campaign.runs) == 1 else campaign.in_cycles
    last = () if alone else (campaign.runs[-1].name,)
    held = (*(campaign.held_out or last), *(names.get(name, name) for name in held))
    notes.append(f"{', '.join(run.name for run in named)}: added from {folder}")
    every = (*campaign.runs, *named)
    notes = [*campaign.notes, *notes]
    return replace(campaign, runs=every, held_out=held, notes=tuple(notes), in_cycles=alone)


def _runs(
    listing: Path, plan: Plan, rig: Rig, unit: str | None, said: ColumnMap, notes: list[str]
) -> tuple[tuple[MachineRun, ...], tuple[str, ...]]:
    """Return the runs that a campaign lists, and the names of those that are held out."""
    home, names, runs = listing.parent, run_names(listing, plan.run), list[MachineRun]()
    routes = _Routes(home, rig, unit, said, notes)
    routes.read(plan.run)
    for name, listed in zip(names, plan.run, strict=True):
        path = home / listed.data
        columns_of_run = read_columns(path, name, said, notes)
        try:
            runs.append(machine_run(name, columns_of_run, routes.of(listed), rig))
        except TssgeomError as error:
            raise type(error)(f"{path}: {error}") from error
    notes += [each.text for each in load_remarks(runs, rig)]
    held = tuple(name for name, listed in zip(names, plan.run, strict=True) if listed.held_out)
    return tuple(runs), held


class _Routes:
    """The routes of runs: of shapes, each read once, or of the rig."""

    def __init__(self, home: Path, rig: Rig, unit: str | None, said: ColumnMap, notes: list[str]) -> None:
        self._home, self._rig, self._unit, self._said, self._notes = home, rig, unit, said, notes
        self._arcs = dict[str, Arcs]()

    def read(self, runs: Sequence[Listed]) -> None:
        """Read every shape that the runs name."""
        shapes = [shape for listed in runs for shape in _shapes_of(listed)]
        plain = msgspec.structs.replace(self._rig, effects=())
        for shape in dict.fromkeys(shapes):
            path = self._home / shape
            self._arcs[shape] = read_finer_pieces(path, plain, self._unit, self._said, self._notes)

    def of(self, listed: Listed) -> list[Arcs]:
        """Return the routes of a run: one for all tendons, or one each."""
        shapes = _shapes_of(listed)
        if not shapes:
            return [route_of_rig(self._rig)]
        tendons = tendon_count(self._rig.drive, self._rig.end)
        if len(shapes) not in (1, tendons):
            raise SettingsError(f"{len(shapes)} shapes for {tendons} tendons: give one for all, or one each")
        return [self._arcs[shape] for shape in shapes]


def _shapes_of(listed: Listed) -> tuple[str, ...]:
    if isinstance(listed.shape, str):
        return (listed.shape,) if listed.shape else ()
    return listed.shape
