"""How many runs break a tie: designed ones beside those of the fixed menu, on the independent simulator.

    python -m benchmarks.discovery --propose [--seeds N] [--first-seed N] [--jobs 2]

Each campaign has a cause that its plan cannot show: viscous drag at one rate (G5), friction that depends on
curvature (G6) or sheath clearance (G10) on one route. Runs are added one at a time until the first name is
the cause. The fixed plan repeats the first run with the change that the report names, in the order of the
report, then of the menu.
Both may go to 3 mm/s, ten times the speed of the runs there are at one rate.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomli_w
from rich.console import Console
from rich.progress import track

from benchmarks.tables import table
from tests.campaigns import make_campaign
from tests.campaigns.measure import measure_proposed
from tssgeom.identify.readings import Reading, readings
from tssgeom.identify.ties import MENU
from tssgeom.io.formats.campaigns import read_campaign

_CONSOLE = Console(stderr=True)
_MOST = 4  # runs that are added at most; chosen: a tie that stands then counts as one more
_SPEED_MM_PER_S = 3.0
_CHANGES = ("faster", "slower", "hold", "cycles", "tension", "straight", "unbend", "radii")
"""A word of what the report names for each plan of the menu, in its order."""
_KINDS = (
    ("viscous_drag", "one_rate", 1.0),
    ("viscous_drag", "one_rate", 0.5),
    ("curvature_dependent_friction", "one_route", 1.0),
    ("sheath_clearance", "one_route", 0.5),
)


@dataclass(frozen=True, slots=True)
class Hidden:
    """A campaign whose plan hides its cause."""

    effect: str
    plan: str
    size: float
    seed: int


@dataclass(frozen=True, slots=True)
class Broken:
    """How many runs it took."""

    case: Hidden
    before: str
    """Verdict of the campaign, and the name that stands first."""
    designed: int
    fixed: int


def hidden_causes(seeds: int, first: int = 0) -> list[Hidden]:
    """Return the campaigns of the benchmark."""
    return [Hidden(*kind, seed) for seed in range(first, first + seeds) for kind in _KINDS]


def runs_needed(case: Hidden) -> Broken | None:
    """Return how many runs name the cause; None where the campaign itself does."""
    with TemporaryDirectory(prefix="experiments-") as room:
        campaign = Path(room) / "campaign"
        make_campaign(campaign, case.seed, case.effect, case.size, case.plan)
        start = _discovered(campaign, Path(room) / "start", (), proposes=False)
        if _named(start, case):
            return None
        counts = [
            _count(case, campaign, Path(room) / kind, kind == "designed") for kind in ("designed", "fixed")
        ]
    named = start["effects"][0]["name"] if start["effects"] else "–"
    return Broken(case, f"{start['verdict']}, {named}", *counts)


def _count(case: Hidden, campaign: Path, room: Path, designs: bool) -> int:
    folders = list[Path]()
    for k in range(_MOST):
        out = room / f"out_{k}"
        report = _discovered(campaign, out, folders, proposes=designs)
        if _named(report, case):
            return k
        if not designs:
            _write_menu(out / "proposed", campaign, report, k)
        measured = room / ("new" + "_" * k)
        measure_proposed(out / "proposed", measured, case.seed, case.effect, case.plan, case.size)
        (measured / "proposal.toml").write_bytes((out / "proposed" / "proposal.toml").read_bytes())
        folders.append(measured)
    named = _named(_discovered(campaign, room / "end", folders, proposes=False), case)
    return _MOST if named else _MOST + 1


def _discovered(campaign: Path, out: Path, folders: Sequence[Path], *, proposes: bool) -> dict[str, Any]:
    call = "import sys; from pipelines.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", call, "discover", str(campaign), "--out", str(out), "--quiet"]
    for folder in folders:
        command += ["--with", str(folder)]
    if proposes:
        command += ["--propose", "1", "--limits", f"speed_mm_per_s={_SPEED_MM_PER_S}"]
    subprocess.run(command, check=True)
    return json.loads((out / "report.json").read_text("utf-8"))


def _named(report: dict[str, Any], case: Hidden) -> bool:
    return report["verdict"] == "effect" and report["effects"][0]["name"] == case.effect


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
            one.case.effect,
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
