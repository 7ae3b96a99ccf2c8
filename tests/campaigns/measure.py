"""The rig of a campaign, driven once more: a proposal in, measured files out."""

import tomllib
from dataclasses import replace
from pathlib import Path as File

import numpy as np

from tests.campaigns.files import write, write_runs
from tests.campaigns.instruments import observed
from tests.campaigns.make import _RATES, Rig, _names, _points, _rig, columns
from tests.campaigns.routes import Route, path
from tests.lumped import Drive, simulate

_FIRST_DAY = 40  # beyond those of the campaign itself


def measure_proposed(
    proposed: File,
    folder: File,
    seed: int,
    effect: str | tuple[str, ...] | None,
    plan: str,
    size: float = 1.0,
    split: str = "development",
) -> None:
    """Drive the rig of `make_campaign` as a proposal asks, and write what it measures into a new `folder`.

    Runs on routes of the campaign are data files with the names of the proposed ones. Where one is on another
    route, all are listed in a `campaign.toml`, with their shapes as sensed.
    """
    rig = _rig(seed, _names(effect), size, split)
    listed = tomllib.loads((proposed / "proposal.toml").read_text("utf-8"))["run"]
    runs, shapes = [], {}
    for k, run in enumerate(listed):
        route, file, shape = _route(rig, run, k)
        read = driven(rig, proposed / run["data"], route, plan, _FIRST_DAY + len(folder.name) + k)
        runs.append((File(run["data"]).stem, file, False, read))
        shapes[file] = shape
    if any("new_route" in run for run in listed):
        write(folder, {}, runs, shapes)
    else:
        write_runs(folder, runs)


def driven(rig: Rig, drive_file: File, route: Route, plan: str, day: int) -> dict[str, np.ndarray]:
    """Return what a rig reads on a route, at the samples of a drive file."""
    table = np.genfromtxt(drive_file, delimiter=",", names=True)
    by_force = "tension_in_N" in table.dtype.names
    values = table["tension_in_N"] if by_force else np.round(1e-3 * table["displacement_in_mm"], 9)
    times = table["time_s"]
    warmth = 22.0 + 0.5 * np.sin(
        times / times[-1] + np.random.default_rng((rig.seed, day)).uniform(0.0, 6.28)
    )
    drive = Drive("force" if by_force else "displacement", times, values, warmth)
    curved = any(law in change.physics for change in rig.changes for law in _RATES)
    still = path(route, np.array([0.0]), 0.0)
    run = simulate(still, rig.physics, drive, rig.distal, times, (times[1] - times[0]) / (2 if curved else 1))
    return observed(run, list(rig.changes), columns(rig, plan), rig.seed, day)


def _route(rig: Rig, run: dict, k: int) -> tuple[Route, str, tuple[np.ndarray, str, bool]]:
    """Return the route of a proposed run, the name of its shape file, and its points as sensed."""
    if "new_route" not in run:
        which = int(run["route"].rpartition("_")[2]) - 1
        return rig.routes[which], f"route_{which + 1}.csv", _points(rig, which)
    new = run["new_route"]
    lengths = np.array(new["length_m"])
    route = Route(
        "another",
        lengths * rig.length / lengths.sum(),
        np.array(new["angle_rad"]),
        1.3 * np.arange(len(lengths)),
    )
    return route, f"another_{k + 1}.csv", _points(replace(rig, routes=(route,), seed=rig.seed + 1 + k), 0)
