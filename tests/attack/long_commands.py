"""Commands that take a while, one of each kind, and what they work on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq

from tests.attack.kills import moving
from tests.attack.trial import attempt
from tests.scenes import Ball, Scene, arch, board_images, board_poses, checkerboard, render, ring

SHAPES = Path(__file__).parents[2] / "sample_shapes"
CAMPAIGN, LOOP = SHAPES / "campaign_hidden_bend", SHAPES / "setup_a.csv"
_ROWS = 100_000  # of a long run
_BOARD = ("--calibrate", "--board", "9x6", "--square-mm", "30")
_ADAPT = """
[adapt]
"friction.coefficient" = { sd = 0.015, hourly_change = 0.05 }
[sensors.tension_in_N]
noise = 0.03
[sensors.tension_out_N]
noise = 0.03
[sensors.displacement_in_m]
noise = 1e-5
[sensors.elongation_m]
noise = 1e-5
"""

Command = list[str | Path]


def commands(folder: Path) -> Iterator[Command]:
    """Yield commands that write to `folder / "out"`."""
    yield from _of_shapes(folder)
    yield from _of_runs(folder)
    yield from _of_films(folder)
    yield from _of_results(folder)


def _of_shapes(folder: Path) -> Iterator[Command]:
    out, many, long = folder / "out", folder / "in", moving(folder / "long.jsonl", 400)
    many.mkdir()
    for k in range(4):
        moving(many / f"run{k}.jsonl", 10 + k)
    batch: Command = ["batch", many, "--out", out]
    yield [*batch, "--workers", "2"]
    yield [*batch, "--workers", "1"]
    yield ["batch", long, "--out", out, "--geometry-only", "--workers", "2"]
    yield ["analyse", long, "--out", out, "--figures", out]
    yield ["analyse", LOOP, "--out", out, "--export", "vtp,ply"]
    yield ["check", long, *[_run(folder / "run.parquet")] * 3]
    yield ["remedy", "--shape", LOOP, "--out", out]
    yield ["paper", "--out", out]
    yield ["samples", "--out", out]
    replay = f"replay:{long}?speed=4"
    yield ["live", "--source", replay, "--record", out / "live.rrd", "--state", out / "state.json"]


def _of_runs(folder: Path) -> Iterator[Command]:
    out, slow, long = folder / "out", CAMPAIGN / "loop_slow.csv", _run(folder / "run.parquet")
    rig = folder / "rig.toml"
    rig.write_text(_ADAPT)
    yield ["simulate", folder / "long.jsonl", "--drive", slow, "--out", out]
    yield ["simulate", LOOP, "--drive", slow, "--rig", rig, "--adapt", "--out", out]
    yield ["compensate", LOOP, "--target", long, "--out", out]
    yield ["calibrate", slow, "--shape", LOOP, "--out", out / "rig.toml"]
    yield ["calibrate", long, "--shape", LOOP, "--every", "1000", "--force", "--out", out / "rigs"]
    yield ["discover", CAMPAIGN, "--out", out]
    yield ["discover", CAMPAIGN, "--propose", "2", "--out", out]


def _run(path: Path) -> Path:
    """Write a long run that is pulled and released."""
    time = 0.1 * np.arange(_ROWS)
    pull = 5.0 * (1.0 - np.cos(0.05 * time))
    columns = {"time_s": time, "tension_in_N": 1.0 + pull, "tension_out_N": 1.0 + 0.7 * pull}
    papq.write_table(pa.table(columns | {"elongation_m": 1e-4 * pull}), path)
    return path


def _of_films(folder: Path) -> Iterator[Command]:
    out, films = folder / "out", folder / "films"
    films.mkdir()
    lenses = [
        replace(lens, focal=tuple(0.75 * f for f in lens.focal), centre=(238.0, 182.0), width=480, height=360)
        for lens in ring(2)
    ]
    board, poses = checkerboard(), board_poses(checkerboard(), 16)[::2]
    routes = [arch(14, 0.03 * k)[0] for k in range(5)]
    for v, lens in enumerate(lenses):
        (films / f"board{v}").mkdir()
        for k, image in enumerate(board_images(lens, board, poses, v)):
            cv2.imwrite(str(films / f"board{v}" / f"{k}.png"), image)
        film = cv2.VideoWriter(str(films / f"cam{v}.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (480, 360))
        images = [render(lens, Scene([Ball(one, 0.005) for one in each]), v, 0) for each in routes]
        for image in images * 20:
            film.write(image)
        film.release()
    cameras, boards = folder / "cameras.toml", [films / "board0", films / "board1"]
    yield ["track", *boards, *_BOARD, "--out", out / "cameras.toml"]
    attempt(["track", *boards, *_BOARD, "--out", cameras])
    track: Command = ["track", films / "cam0.avi", films / "cam1.avi", "--calibration", cameras]
    beside: Command = ["--overlay", out / "overlay", "--picture", out / "track.rrd"]
    yield [*track, "--blobs", "bright", "--out", out / "run.jsonl", *beside]


def _of_results(folder: Path) -> Iterator[Command]:
    out, results = folder / "out", folder / "results"
    attempt(["batch", folder / "in", "--out", results])
    with next((results / "frames").iterdir()).open("wb") as file:
        file.truncate(1 << 30)  # its checksum takes a second
    yield ["verify", results]
    recordings = sorted(results.rglob("*.rrd"))[:2]
    yield ["view", *recordings, "--out", out]
    yield ["view", recordings[0], "--screenshot", out / "picture.png"]
