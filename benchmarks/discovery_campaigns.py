"""Campaigns of discovery, what the command makes of them, and how many runs break a tie.

Each campaign of `--propose` has a cause that its plan cannot show: viscous drag at one rate (G5), friction
that depends on curvature (G6) or sheath clearance (G10) on one route. Runs are added one at a time until the
first name is the cause: designed ones, or those of the fixed plan, which repeats the first run with the
change that the report names, in the order of the report, then of the menu. Both may go to 3 mm/s, ten times
the speed of the runs there are at one rate.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomli_w
from rich.console import Console
from rich.progress import track

from benchmarks import table
from tests import bristle, campaigns
from tests.bristle import CAUSES, PAIR_CAUSES
from tests.campaigns import INSIDE, OUTSIDE, PAIRS
from tests.campaigns.measure import measure_proposed
from tssgeom.identify.readings import Reading, readings
from tssgeom.identify.ties import MENU
from tssgeom.io.formats.campaigns import read_campaign


@dataclass(frozen=True, slots=True)
class Case:
    """One campaign to be made."""

    group: str
    """clean, single, half, quarter, pair, outside, partial, other drive, machine, hidden, or a tie."""
    effects: tuple[str, ...]
    """Of the second generator the one cause, in its own words."""
    size: float
    plan: str
    seed: int
    split: str
    generator: str = "first"

    def made(self, folder: Path) -> dict[str, Any]:
        """Write the campaign into a folder and return its truth."""
        if self.generator == "first":
            first = self.effects or None
            return asdict(campaigns.make_campaign(folder, self.seed, first, self.size, self.plan, self.split))
        cause = self.effects[0] if self.effects else ""
        return asdict(bristle.make_campaign(folder, self.seed, cause, self.size, self.plan, self.split))


_CONSOLE = Console(stderr=True)
_KEYS = ("verdict", "effects", "tie", "breaks_tie", "unobservable", "gap", "base")
_PATIENCE_S = 1800.0  # the first ones compile, perhaps beside other work
_MOST = 4  # runs that are added at most; chosen: a tie that stands then counts as one more
_SPEED_MM_PER_S = 3.0
_CHANGES = ("faster", "slower", "hold", "cycles", "tension", "straight", "unbend", "radii")
"""A word of what the report names for each plan of the menu, in its order."""
_KINDS = (
    ("hidden", ("viscous_drag",), 1.0, "one_rate"),
    ("hidden", ("viscous_drag",), 0.5, "one_rate"),
    ("hidden", ("curvature_dependent_friction",), 1.0, "one_route"),
    ("hidden", ("sheath_clearance",), 0.5, "one_route"),
)


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
_SECOND_QUICK = ("stribeck", "power_creep", "drive_play", "bend", "drifting_tension_out")
_SECOND_CLEAN = 6  # clean campaigns for each seed of a cause
_GROUPS = {1.0: "single", 0.5: "half"}


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


def second_cases(names: Sequence[str], seeds: int, split: str, *, quick: bool) -> list[Case]:
    """Return those of the second generator; `names` may have "clean" and "clean_pair" too."""
    chosen = _SECOND_QUICK if quick else tuple(CAUSES)
    made = list[Case]()
    for seed in range(seeds):
        clean = range(seed * _SECOND_CLEAN, (seed + 1) * _SECOND_CLEAN) if not quick else (seed,)
        made += [Case("clean", (), 1.0, "", number, split, "second") for number in clean]
        for size, group in _GROUPS.items():
            if quick and size != 1.0:
                continue
            made += [Case(group, (name,), size, "", seed, split, "second") for name in chosen]
        if not quick:
            made.append(Case("machine, clean", (), 1.0, "pair", seed, split, "second"))
            made += [Case("machine", (name,), 1.0, "", seed, split, "second") for name in PAIR_CAUSES]
    return [case for case in made if not names or _cause(case) in names]


def _cause(case: Case) -> str:
    return case.effects[0] if case.effects else "clean" if case.group == "clean" else "clean_pair"


def discovered(campaign: Path, out: Path, *more: str) -> tuple[dict[str, Any] | None, str]:
    """Run `tssgeom discover`, with `more` options, and return its report, or its message."""
    call = "import sys; from pipelines.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", call, "discover", str(campaign), "--out", str(out), "--quiet", *more]
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


@dataclass(frozen=True, slots=True)
class Broken:
    """How many runs it took."""

    case: Case
    before: str
    """Verdict of the campaign, and the name that stands first."""
    designed: int
    fixed: int


def hidden_causes(seeds: int, first: int = 0) -> list[Case]:
    """Return the campaigns of the benchmark."""
    seeds_of = range(first, first + seeds)
    return [Case(*kind, seed, "development") for seed in seeds_of for kind in _KINDS]


def runs_needed(case: Case) -> Broken | None:
    """Return how many runs name the cause; None where the campaign itself does."""
    with TemporaryDirectory(prefix="experiments-") as room:
        campaign = Path(room) / "campaign"
        case.made(campaign)
        start = _report(campaign, Path(room) / "start", (), proposes=False)
        if _named(start, case):
            return None
        counts = [
            _count(case, campaign, Path(room) / kind, kind == "designed") for kind in ("designed", "fixed")
        ]
    named = start["effects"][0]["name"] if start["effects"] else "–"
    return Broken(case, f"{start['verdict']}, {named}", *counts)


def _count(case: Case, campaign: Path, room: Path, designs: bool) -> int:
    folders = list[Path]()
    for k in range(_MOST):
        out = room / f"out_{k}"
        report = _report(campaign, out, folders, proposes=designs)
        if _named(report, case):
            return k
        if not designs:
            _write_menu(out / "proposed", campaign, report, k)
        measured = room / ("new" + "_" * k)
        measure_proposed(out / "proposed", measured, case.seed, case.effects[0], case.plan, case.size)
        (measured / "proposal.toml").write_bytes((out / "proposed" / "proposal.toml").read_bytes())
        folders.append(measured)
    named = _named(_report(campaign, room / "end", folders, proposes=False), case)
    return _MOST if named else _MOST + 1


def _report(campaign: Path, out: Path, more: Sequence[Path], *, proposes: bool) -> dict[str, Any]:
    options = ["--propose", "1", "--limits", f"speed_mm_per_s={_SPEED_MM_PER_S}"] if proposes else []
    report, failure = discovered(campaign, out, *(f"--with={folder}" for folder in more), *options)
    if report is None:
        raise RuntimeError(f"{campaign}: {failure}")
    return report


def _named(report: dict[str, Any], case: Case) -> bool:
    return report["verdict"] == "effect" and report["effects"][0]["name"] == case.effects[0]


def _write_menu(folder: Path, campaign: Path, report: dict[str, Any], k: int) -> None:
    """Write the run of the fixed plan as a proposal."""
    first = readings(read_campaign(campaign))[0][0]
    named = [which for each in report["breaks_tie"] for which in _plans(each["experiment"])]
    order = list(dict.fromkeys([*named, *range(len(MENU))]))
    reading = MENU[order[k]].changed(first)
    listed: dict[str, Any] = {"data": "run_1.csv", "route": first.route.name}
    if reading.route is not first.route:
        arcs = reading.route.arcs
        listed["new_route"] = {"length_m": arcs.length.tolist(), "angle_rad": arcs.angle.tolist()}
    folder.mkdir(parents=True)
    (folder / "proposal.toml").write_text(tomli_w.dumps({"run": [listed]}), "utf-8")
    rows = np.column_stack([reading.time, 1e3 * reading.given["displacement_in_m"]])
    cells = _sampled(rows, first)
    np.savetxt(
        folder / "run_1.csv",
        cells,
        delimiter=",",
        header="time_s,displacement_in_mm",
        comments="",
        fmt="%.6f",
    )


def _plans(experiment: str) -> Iterator[int]:
    """Yield the plans of the menu that an experiment of the report means."""
    yield from (k for k, word in enumerate(_CHANGES) if word in experiment)


def _sampled(rows: np.ndarray, first: Reading) -> np.ndarray:
    """Return a drive at as many even samples as the first run has."""
    time = np.linspace(rows[0, 0], rows[-1, 0], len(first.time))
    return np.column_stack([time, np.interp(time, rows[:, 0], rows[:, 1])])


def compared(seeds: int, first: int, jobs: int, *, markdown: bool) -> str:
    """Run the benchmark and return its table."""
    cases = hidden_causes(seeds, first)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        results = list(track(pool.map(runs_needed, cases), "campaigns", len(cases), console=_CONSOLE))
    made = [one for one in results if one is not None]
    rows = [
        (
            one.case.effects[0],
            one.case.plan,
            f"{one.case.size:g}",
            one.case.seed,
            one.before,
            one.designed,
            one.fixed,
        )
        for one in made
    ]
    head = ("cause", "plan", "size", "seed", "before", "designed", "fixed plan")
    text = table(head, [tuple(map(str, row)) for row in rows], text_columns=2, markdown=markdown)
    summary = (
        f"runs until named (at most {_MOST}; {_MOST + 1} where not): "
        f"designed {mean(one.designed for one in made):.2f}, "
        f"fixed plan {mean(one.fixed for one in made):.2f}; {len(cases) - len(made)} campaigns needed none"
    )
    return f"{text}\n\n{summary}"
