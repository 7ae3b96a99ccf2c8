"""`tssgeom compensate`: the proximal command that makes the distal end follow a target."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pipelines.console import say, show, tracking
from pipelines.runs import naming, sensed_route, temperature_of, warn_of_doubts
from pipelines.summary_table import acting
from pipelines.work import Options
from tssgeom.io.formats.columns import CHANNELS
from tssgeom.io.formats.runs import read_run
from tssgeom.io.results.tables import write_commands
from tssgeom.tendon.command import Command
from tssgeom.tendon.simulation import commands

TABLE = "compensate.parquet"
_TARGETS = ("displacement_out_m", "tension_out_N")


def run(shapes: Path, target: Path, chosen: Options, *, out: Path, as_json: bool, quiet: bool) -> int:
    """Find the commands for a run and return the exit status.

    Raises
    ------
    SettingsError, ShapeError, SourceError, FitError
        Where an input cannot be used, a target is out of reach, or the disk refuses.
    """
    wanted = read_run(target)
    name, values = wanted.channel(_TARGETS)
    sensed = sensed_route(shapes, chosen)
    found = list[Command]()
    with tracking(1, quiet=quiet or as_json) as tracker:
        tracker.begin(f"{sensed.name} follows {wanted.name}")
        warm, targets = temperature_of(wanted, chosen), {CHANNELS[name][0]: values}
        with naming(target, shapes):
            for command in commands(wanted.time, sensed.route, chosen.rig, temperature=warm, **targets):
                found.append(command)
                tracker.frame(len(values))
        tracker.end(str(target))
    warn_of_doubts(target, sensed, chosen.rig, max(one.tension_in for one in found))
    write_commands(out / TABLE, wanted.time.tolist(), found)
    places = np.array([one.displacement_in for one in found])
    tensions = np.array([one.tension_in for one in found])
    if as_json:
        summary = {
            "shape": sensed.name,
            "rejected": sensed.rejected,
            "run": wanted.name,
            "target": name,
            "rows": len(found),
            "range": {
                "displacement_in_m": [places.min(), places.max()],
                "tension_in_N": [tensions.min(), tensions.max()],
            },
            "files": [(out / TABLE).as_posix()],
        }
        say(json.dumps(summary, indent=1, ensure_ascii=False))
    elif not quiet:
        title = f"{sensed.name} follows {name} of {wanted.name}: {len(found)} commands" + acting(chosen)
        drive = f"{1e3 * places.min():.3f}–{1e3 * places.max():.3f}"
        pull = f"{tensions.min():.2f}–{tensions.max():.2f}"
        show(title, ("target", "drive [mm]", "T_in [N]"), [(name, drive, pull)])
        say(f"table: {out / TABLE}")
    return 1 if sensed.rejected else 0
