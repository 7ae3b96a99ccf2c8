"""The same batch on a Dask cluster: a real scheduler with two workers."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as papq
import pytest

from tests.pipelines.alike import alike

pytest.importorskip("distributed", reason="the extra [cluster] is not installed")

TSSGEOM = (sys.executable, "-c", "from pipelines.cli import main; main()")
SHAPES = Path(__file__).parents[2] / "sample_shapes"
USED = ("half_circle.csv", "helix.csv", "setup_a.csv", "colon_markers.csv")


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a scheduler that runs as long as the tests need it."""
    folder = tmp_path_factory.mktemp("dask")
    file = folder / "scheduler.json"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    common = ["--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file)]
    server = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", *common]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", *common]
    processes = [subprocess.Popen(command, **quiet) for command in (server, worker, worker)]
    try:
        while not file.exists():
            assert processes[0].poll() is None
            time.sleep(0.05)  # between two readings of the folder
        address = json.loads(file.read_text())["address"]
        wait_for_workers(address)
        yield address
    finally:
        for process in processes:
            process.kill()
            process.wait()


def wait_for_workers(address: str) -> None:
    code = f"from distributed import Client; Client({address!r}).wait_for_workers(2, timeout=60)"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def tables(out: Path) -> dict[str, pa.Table]:
    return {path.relative_to(out).as_posix(): papq.read_table(path) for path in out.rglob("*.parquet")}


def test_a_cluster_gives_the_tables_of_one_process(scheduler: str, tmp_path: Path, run) -> None:
    files = [str(SHAPES / name) for name in USED]
    command = [*TSSGEOM, "batch", *files, "--out", str(tmp_path / "there"), "--scheduler", scheduler]
    there = subprocess.run([*command, "--no-pictures"], capture_output=True, text=True, check=False)
    assert there.returncode == 0, there.stderr
    here = run("batch", *files, "--out", tmp_path / "here", "--workers", "1", "--no-pictures", "--quiet")
    assert here.status == 0
    far, near = tables(tmp_path / "there"), tables(tmp_path / "here")
    assert far.keys() == near.keys()
    assert all(alike(far[name], near[name]) for name in near)
    assert len(near) == 2 * len(USED) + 1


def test_a_scheduler_that_is_not_there_is_one_line(tmp_path: Path, run) -> None:
    shape = SHAPES / "helix.csv"
    done = run("batch", shape, "--out", tmp_path, "--scheduler", "nonsense://x", "--quiet")
    assert done.status == 2
    assert "no Dask scheduler answers there" in done.errors[-1]
