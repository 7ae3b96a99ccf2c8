"""Which campaigns are made, and what one of them gave."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.discovery_baselines import baselines
from benchmarks.discovery_scores import Outcome
from tests.campaigns import INSIDE, OUTSIDE, PAIRS, make_campaign

SIZES = (1.0, 0.5, 0.25)
_CLEAN_FOR_ONE = 12  # clean campaigns for each seed of an effect: false alarms are rare and need many
_TIED = {
    "G1": ("tension_in_gain", "one_route"),
    "G4": ("end_fitting_friction_proximal", "one_route"),
    "G5": ("viscous_drag", "one_rate"),
    "G6": ("curvature_dependent_friction", "one_route"),
}
_PARTIAL = (("no_tension_out", "tension_out_offset"), ("displacement_only", "backlash"))
_DRIVES = ("round_turns", "force_driven")
_DRIVEN = ("hidden_bend", "slack_take_up", "load_dependent_friction", "creep", "viscous_drag", "backlash")
_QUICK = ("hidden_bend", "backlash", "tension_out_offset")
_KEYS = ("verdict", "effects", "tie", "breaks_tie", "unobservable", "gap", "base")
_PATIENCE_S = 1800.0  # the first ones compile, perhaps beside other work


@dataclass(frozen=True, slots=True)
class Case:
    """One campaign to be made."""

    group: str
    """clean, single, half, quarter, pair, outside, partial, other drive, or a tie."""
    effects: tuple[str, ...]
    size: float
    plan: str
    seed: int
    split: str


def cases(names: Sequence[str], seeds: int, split: str, *, quick: bool) -> list[Case]:
    """Return the campaigns of a run; `names` keeps single causes to some, "clean" among them."""
    if quick:
        chosen, outside, pairs, sizes, clean = _QUICK, ("slipping_encoder",), PAIRS[:1], (1.0,), 2
    else:
        chosen, outside, pairs, sizes, clean = tuple(INSIDE), tuple(OUTSIDE), PAIRS, SIZES, _CLEAN_FOR_ONE
    made = [Case("clean", (), 1.0, "full", seed, split) for seed in range(clean * seeds)]
    for seed in range(seeds):
        group = dict(zip(SIZES, ("single", "half", "quarter"), strict=True))
        made += [Case(group[size], (name,), size, "full", seed, split) for size in sizes for name in chosen]
        made += [Case("outside", (name,), 1.0, "full", seed, split) for name in outside]
        made += [Case("pair", pair, 1.0, "full", seed, split) for pair in pairs]
        if not quick:
            made += [Case(tie, (name,), 1.0, plan, seed, split) for tie, (name, plan) in _TIED.items()]
            made += [Case("partial", (name,), 1.0, plan, seed, split) for plan, name in _PARTIAL]
            made += [
                Case("other drive", (name,), 1.0, plan, seed, split) for plan in _DRIVES for name in _DRIVEN
            ]
    return [case for case in made if not names or _asked(case, names)]


def _asked(case: Case, names: Sequence[str]) -> bool:
    return all(name in names for name in case.effects or ("clean",))


def outcome(case: Case, *, with_baselines: bool) -> Outcome:
    """Make a campaign in a folder of its own, let the workflow look at it, and return what it reports."""
    with TemporaryDirectory(prefix="discovery-") as room:
        folder = Path(room) / "campaign"
        truth = asdict(
            make_campaign(folder, case.seed, case.effects or None, case.size, case.plan, case.split)
        )
        begin = _worked_by_children()
        report, failure = discovered(folder, Path(room) / "out")
        seconds = _worked_by_children() - begin
        others = baselines(folder) if with_baselines and case.group == "single" else {}
    return Outcome(case.group, truth, report, seconds, failure, others)


def _worked_by_children() -> float:
    """Processor time of ended children [s], which other work beside them makes no longer."""
    times = os.times()
    return times.children_user + times.children_system


def discovered(campaign: Path, out: Path) -> tuple[dict[str, Any] | None, str]:
    """Run `tssgeom discover` and return its report, or what it said instead."""
    call = "import sys; from pipelines.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", call, "discover", str(campaign), "--out", str(out), "--quiet"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        return None, f"no answer within {_PATIENCE_S:g} s"
    try:
        report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        said = done.stderr.strip().splitlines()
        return None, f"exit {done.returncode}: {said[-1] if said else error}"
    absent = [key for key in _KEYS if key not in report]
    return (None, f"report.json lacks {', '.join(absent)}") if absent else (report, "")
