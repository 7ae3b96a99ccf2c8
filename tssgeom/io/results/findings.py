"""The result of `discover` as files: `report.json`, the updated rig, and the drives of proposed runs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tssgeom.atomic import write_text
from tssgeom.effects import KINDS, chosen
from tssgeom.identify.finding import Candidate, Estimate, Evidence, Finding, LawCurve, Misfit
from tssgeom.identify.mechanism_names import MECHANISM_OF
from tssgeom.identify.proposal import Proposal, ProposedRun
from tssgeom.io.formats.joined_campaigns import PROPOSAL
from tssgeom.io.results.keys.findings import (
    BaseNumber,
    EffectOf,
    EvidenceOf,
    Law,
    MisfitOf,
    Number,
    ProposalObject,
    Proposed,
    RankedCandidate,
    Report,
)
from tssgeom.result import for_json
from tssgeom.rig import write_rig
from tssgeom.uncertain import CERTAIN

REPORT, RIG = "report.json", "rig.updated.toml"


def write_report(folder: Path, finding: Finding, version: str) -> Path:
    """Write `report.json`, whole or not at all, and return its path.

    Raises SourceError where the disk refuses.
    """
    text = json.dumps(report_object(finding, version), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(folder / REPORT, text + "\n")
    return folder / REPORT


def write_updated_rig(folder: Path, finding: Finding, version: str, *, with_errors: bool = False) -> Path:
    """Write the updated rig, its provenance as comments; return its path.

    With errors it has those of the numbers that were fitted, and what it leaves unexplained; (354).

    Raises SourceError where the disk refuses.
    """
    errors = replace(finding.errors, unexplained=finding.unexplained) if with_errors else CERTAIN
    write_rig(folder / RIG, finding.rig, _provenance(finding, version), errors)
    return folder / RIG


def report_object(finding: Finding, version: str) -> Report:
    """Return the object of `report.json`, in SI; what is not known is null, never NaN."""
    report: Report = {
        "version": version,
        "campaign": finding.campaign.name,
        "verdict": finding.verdict,
        "sentence": finding.sentence,
        "effects": [
            {**effect, "evidence": _evidence(each.evidence)}
            for each in finding.effects
            for effect in _named(each)
        ],
        "tie": [list(tie.names) for tie in finding.ties],
        "tie_why": [{"gauge": tie.gauge, "why": tie.why} for tie in finding.ties],
        "breaks_tie": finding.breaks_tie,
        "proposed": None if finding.proposal is None else proposal_object(finding.proposal),
        "unobservable": list(finding.unobservable),
        "unobservable_why": dict(finding.unobservable),
        "where": finding.where,
        "along_route": finding.along,
        "gap": _misfit(finding.misfit),
        "base": {name: _base(name, each, finding.nominal) for name, each in finding.base.items()},
        "base_tie": finding.base_tie,
        "missing_shapes": finding.missing_shapes,
        "ranking": [_ranked(each) for each in finding.ranking],
        "rig": RIG,
        "runs": [
            {"name": one.run, "route": one.route, "held_out": one.held_out, "samples": len(one.time)}
            for one in finding.traces
        ],
        "notes": list(dict.fromkeys(finding.notes)),
        "seconds": finding.seconds,
    }
    return for_json(report)


def _ranked(each: Candidate) -> RankedCandidate:
    return {
        "name": " + ".join(each.names),
        "effects": _named(each),
        "evidence": _evidence(each.evidence),
        "why_not": each.why_not,
    }


def _named(each: Candidate) -> list[EffectOf]:
    """Return name, numbers and choices (such as the end at which it acts) of each effect."""
    return [
        {
            "name": name,
            "mechanism": MECHANISM_OF.get(name, name),
            "formula": name if name in KINDS else None,
            "law": None if each.law is None else _law(each.law),
            "parameters": {key: _estimate(number) for key, number in parameters.items()},
            "choices": chosen(effect),
        }
        for name, effect, parameters in zip(each.names, each.effects, each.parameters, strict=True)
    ]


def _law(each: LawCurve) -> Law:
    return {
        "over": each.over,
        "x": each.x.tolist(),
        "value": each.value.tolist(),
        "lo": each.low.tolist(),
        "hi": each.high.tolist(),
        "unit": each.unit,
        "nearest": [{"formula": name, "log_evidence": -0.5 * less} for name, less in each.nearest],
    }


def _estimate(each: Estimate) -> Number:
    return {"value": each.value, "unit": each.unit, "ci95": [each.low, each.high]}


def _evidence(each: Evidence) -> EvidenceOf:
    return {
        "delta_bic": each.delta_bic,
        "held_out_fall": each.held_out_fall,
        "threshold": each.threshold,
        "size_over_guard": each.size_over_limit,
        "heldout_ratio": each.heldout_ratio,
    }


def _base(name: str, each: Estimate, nominal: Mapping[str, float]) -> BaseNumber:
    number: BaseNumber = {**_estimate(each)}
    if name in nominal:
        number["nominal"] = nominal[name]
    return number


def _misfit(each: Misfit) -> MisfitOf:
    return {
        "noise": dict(each.noise),
        "before": {runs: dict(rms) for runs, rms in each.before.items()},
        "after": {runs: dict(rms) for runs, rms in each.after.items()},
        "by_phase": {
            channel: {phase: {"before": pair[0], "after": pair[1]} for phase, pair in phases.items()}
            for channel, phases in each.by_phase.items()
        },
    }


def _provenance(finding: Finding, version: str) -> list[str]:
    return [
        f"Updated by tssgeom {version} discover from the campaign {finding.campaign.name}.",
        f"Verdict: {finding.verdict}. {finding.sentence}",
        "Friction and compliance, nominal to refitted, with 95 % intervals:",
        *(f"  {name}: {_change(name, each, finding.nominal)}" for name, each in finding.base.items()),
        *_misfit_lines(finding.misfit),
        *(
            f"Tied: {', '.join(tie.names)}: {tie.why}"
            for tie in finding.ties
            if KINDS.keys() >= set(tie.names)
        ),
        *([finding.base_tie] if finding.base_tie else []),
    ]


def _change(name: str, each: Estimate, nominal: Mapping[str, float]) -> str:
    unit = "" if each.unit == "1" else f" {each.unit}"
    before = f"{nominal[name]:.6g} → " if name in nominal else ""
    return f"{before}{each.value:.6g}{unit} [{each.low:.6g}, {each.high:.6g}]"


def _misfit_lines(misfit: Misfit) -> Sequence[str]:
    runs = "held_out" if misfit.before.get("held_out") else "fitted"
    before, after = misfit.before.get(runs, {}), misfit.after.get(runs, {})
    title = {"held_out": "on runs that were held out", "fitted": "on the runs that were fitted"}[runs]
    return [
        f"Measured less simulated {title}, rms before → after (noise):",
        *(
            f"  {channel}: {before[channel]:.3g} → {after[channel]:.3g} ({misfit.noise[channel]:.3g})"
            for channel in before
        ),
    ]


PROPOSED = "proposed"
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
    """Return the drives as CSV: positions in mm, tensions in N, angles in rad, torques in N·m."""
    moved = [each.endswith("_m") for each in run.drives]
    names = [f"{each}m" if in_mm else each for each, in_mm in zip(run.drives, moved, strict=True)]
    values = run.values * np.where(moved, 1e3, 1.0)
    rows = (",".join(f"{each:.6f}" for each in row) for row in np.column_stack([run.time, values]))
    return "\n".join((",".join(("time_s", *names)), *rows)) + "\n"


def proposal_object(proposal: Proposal) -> ProposalObject:
    """Return `proposed` of `report.json`, in SI but for the limits, whose keys have their units."""
    return {
        "sentence": proposal.sentence,
        "candidates": list(proposal.candidates),
        "limits": dict(proposal.limits),
        "stated_limits": list(proposal.stated),
        "in_the_way": proposal.in_the_way,
        "narrowed": proposal.narrowed,
        "runs": [_proposed(run) for run in proposal.runs],
    }


def _proposed(run: ProposedRun) -> Proposed:
    arcs, drives, one = run.new_route, list(run.drives), len(run.drives) == 1
    return {
        "data": f"{run.name}.csv",
        "route": run.route,
        "like": run.like,
        "new_route": None
        if arcs is None
        else {"length_m": np.asarray(arcs.length).tolist(), "angle_rad": np.asarray(arcs.angle).tolist()},
        "drive": drives[0] if one else drives,
        "corner_time_s": run.corner_time.tolist(),
        "corners": (run.corners[:, 0] if one else run.corners.T).tolist(),
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
