"""The result of `discover` as files: `report.json` and the updated rig."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tssgeom.atomic import write_text
from tssgeom.effects import KINDS, chosen
from tssgeom.identify.finding import (
    Candidate,
    Estimate,
    Evidence,
    Finding,
    LawCurve,
    Misfit,
)
from tssgeom.identify.mechanisms import MECHANISM_OF
from tssgeom.io.results.keys.findings import (
    BaseNumber,
    EffectOf,
    EvidenceOf,
    Law,
    MisfitOf,
    Number,
    RankedCandidate,
    Report,
    RunOf,
    SelectedEffect,
)
from tssgeom.io.results.proposals import proposal_object
from tssgeom.rig import write_rig

REPORT, RIG = "report.json", "rig.updated.toml"


def write_report(folder: Path, finding: Finding, version: str) -> Path:
    """Write `report.json`, whole or not at all, and return its path.

    Raises SourceError where the disk refuses.
    """
    text = json.dumps(report_object(finding, version), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(folder / REPORT, text + "\n")
    return folder / REPORT


def write_updated_rig(folder: Path, finding: Finding, version: str) -> Path:
    """Write the updated rig, its provenance as comments; return its path.

    Raises SourceError where the disk refuses.
    """
    write_rig(folder / RIG, finding.rig, _provenance(finding, version))
    return folder / RIG


def report_object(finding: Finding, version: str) -> Report:
    """Return the object of `report.json`, in SI; what is not known is null, never NaN."""
    report: Report = {
        "version": version,
        "campaign": finding.campaign.name,
        "verdict": finding.verdict,
        "sentence": finding.sentence,
        "effects": [effect for each in finding.effects for effect in _effects(each)],
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
        "runs": [_run(trace.run, trace.route, trace.held_out, len(trace.time)) for trace in finding.traces],
        "notes": list(finding.notes),
        "seconds": finding.seconds,
    }
    return _finite(report)


def _effects(each: Candidate) -> list[SelectedEffect]:
    return [{**effect, "evidence": _evidence(each.evidence)} for effect in _named(each)]


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
            "parameters": _parameters(parameters),
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


def _parameters(parameters: Mapping[str, Estimate]) -> dict[str, Number]:
    return {key: _estimate(each) for key, each in parameters.items()}


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


def _run(name: str, route: str, held_out: bool, samples: int) -> RunOf:
    return {"name": name, "route": route, "held_out": held_out, "samples": samples}


def _finite(value: Any) -> Any:
    """Return plain objects for JSON, null instead of numbers that are not finite."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _finite(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, np.generic):
        return _finite(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value


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
