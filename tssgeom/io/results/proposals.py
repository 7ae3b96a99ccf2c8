"""Proposed experiments as files: a drive file for each run, and what they are for."""

from __future__ import annotations

from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tssgeom.atomic import write_text
from tssgeom.identify.proposal import Proposal, ProposedRun
from tssgeom.io.formats.joined_campaigns import PROPOSAL
from tssgeom.io.results.keys.findings import ProposalObject, Proposed

FOLDER = "proposed"
"""Where proposals are written, below the folder of the report."""


def write_proposal(folder: Path, proposal: Proposal, version: str) -> None:
    """Write `proposal.toml` and the drive file of each run, `run_1.csv` and so on.

    Raises SourceError where the disk refuses.
    """
    for run in proposal.runs:
        write_text(folder / f"{run.name}.csv", _drive_file(run))
    listed = _without_none({"version": version, **proposal_object(proposal)})
    listed["run"] = listed.pop("runs")
    write_text(folder / PROPOSAL, tomli_w.dumps(listed))


def _drive_file(run: ProposedRun) -> str:
    """Return a drive as CSV: positions in mm, tensions in N."""
    by_force = run.drive == "tension_in_N"
    name, factor = (run.drive, 1.0) if by_force else ("displacement_in_mm", 1e3)
    rows = (f"{t:.6f},{factor * v:.6f}" for t, v in zip(run.time, run.values, strict=True))
    return "\n".join((f"time_s,{name}", *rows)) + "\n"


def proposal_object(proposal: Proposal) -> ProposalObject:
    """Return `proposed` of `report.json`, in SI but for the limits, whose keys have their units."""
    return {
        "sentence": proposal.sentence,
        "candidates": list(proposal.candidates),
        "limits": dict(proposal.limits),
        "stated_limits": list(proposal.stated),
        "in_the_way": proposal.in_the_way,
        "narrowed": proposal.narrowed,
        "runs": [_run(run) for run in proposal.runs],
    }


def _run(run: ProposedRun) -> Proposed:
    arcs = run.new_route
    return {
        "data": f"{run.name}.csv",
        "route": run.route,
        "like": run.like,
        "new_route": None
        if arcs is None
        else {"length_m": np.asarray(arcs.length).tolist(), "angle_rad": np.asarray(arcs.angle).tolist()},
        "drive": run.drive,
        "corner_time_s": run.corner_time.tolist(),
        "corners": run.corners.tolist(),
        "why": run.why,
        "outcomes": list(run.outcomes),
        "expected": run.expected,
    }


def _without_none(value: Any) -> Any:
    """Leave out what is not there, which TOML cannot express."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list | tuple) else value
