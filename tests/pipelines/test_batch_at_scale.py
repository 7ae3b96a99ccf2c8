"""A batch over many files: the same bytes whoever does the work and however often it is stopped."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pyarrow.parquet as papq
import pytest

from pipelines.batch.workers import BatchLimits, WorkerLost, worker_pool
from tests.pipelines.alike import alike
from tssgeom.io.results.run_record import locked
from tssgeom.io.storage import Folder

TSSGEOM = (sys.executable, "-c", "from pipelines.cli import main; main()")
PLAIN = ("--workers", "1", "--no-pictures", "--quiet")
FRAMES, RUNS = 10, 6


def moving(path: Path, seed: int, frames: int = FRAMES, *, bad: bool = False) -> Path:
    """A bend that sways while it is pulled and released."""
    rng = np.random.default_rng(seed)
    along = np.linspace(0.0, 1.0, 40)
    lines = []
    for k in range(frames):
        angle = (2.0 + 0.3 * np.sin(k / 4)) * along
        points = np.column_stack([np.sin(angle), 1 - np.cos(angle), 0.1 * along]) * 50
        points = (points + rng.normal(0, 0.05, points.shape)).round(4).tolist()
        tension = round(10 * abs(np.sin(k / 5)), 3)
        lines.append(json.dumps({"t": k / 10, "points": points, "unit": "mm", "tension_in_N": tension}))
    if bad:
        lines[3] = '{"t": 0.3, "points": [[1'
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    for seed in range(RUNS):
        moving(folder / f"run{seed}.jsonl", seed, bad=seed == 2)
    (folder / "broken.npz").write_bytes(b"PK no archive")
    return folder


Ended = subprocess.CompletedProcess[str]


def batch(inputs: str | Path, out: Path, *more: str, begin: Callable[[], None] | None = None) -> Ended:
    """Run the program in a process of its own; `begin` is called there first."""
    command = [*TSSGEOM, "batch", str(inputs), "--out", str(out), "--no-pictures", "--quiet", *more]
    return subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=begin)


def content(out: Path) -> dict[str, bytes]:
    """All files, notes included."""
    files = (path for path in out.rglob("*") if path.is_file() and path.name != "lock")
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def undisturbed(inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("undisturbed") / "out"
    done = batch(inputs, out, "--workers", "1")
    assert done.returncode == 1, done.stderr
    assert "broken.npz: cannot be read as NPZ" in done.stderr
    assert "run2.jsonl: frame 3: line 4" in done.stderr
    return out


def test_one_corrupt_file_and_one_corrupt_frame_leave_the_rest_done(undisturbed: Path) -> None:
    counts = json.loads((undisturbed / "run.json").read_text())["counts"]
    assert counts == {
        "inputs": RUNS,
        "inputs_rejected": 1,
        "frames": RUNS * FRAMES,
        "frames_rejected": 1,
    }


def test_a_batch_killed_at_any_moment_goes_on_to_the_same_bytes_by_other_workers(
    undisturbed: Path, inputs: Path, tmp_path: Path
) -> None:
    count = int(np.random.default_rng(int.from_bytes(os.urandom(4))).integers(1, RUNS + 1))
    out, endless = tmp_path / "out", inputs / "zz.jsonl"
    os.mkfifo(endless)  # nothing writes to it, so that the batch cannot end before it is killed
    command = [*TSSGEOM, "batch", str(inputs), "--out", str(out), "--workers", "2", "--no-pictures"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as running:
        wait_for_tables(out, count, running)
        running.kill()
        assert running.stderr is not None
        running.stderr.read()  # ends when the last of its workers has ended
    endless.unlink()
    assert not (out / "run.json").exists()
    last = batch(inputs, out, "--workers", "2")
    assert last.returncode == 1, last.stderr
    assert content(out) == content(undisturbed)


def wait_for_tables(out: Path, count: int, running: subprocess.Popen[bytes]) -> None:
    """Return when so many tables of frames are there or begun, whatever the pace of the machine."""
    while running.poll() is None and len(list((out / "frames").glob("*"))) < count:
        time.sleep(0.001)  # between two readings of the folder


def test_what_is_unchanged_is_not_done_again(tmp_path: Path, run) -> None:
    mine, out = tmp_path / "in", tmp_path / "out"
    mine.mkdir()
    for seed in range(3):
        moving(mine / f"run{seed}.jsonl", seed, 3)
    written = list[dict[str, int]]()
    for more in ((), (), ("--fresh",)):
        run("batch", mine, "--out", out, *PLAIN, *more)
        written.append({path.name: path.stat().st_mtime_ns for path in (out / "frames").iterdir()})
        moving(mine / "run1.jsonl", 77, 3)
    first, second, fresh = written
    assert {name for name in first if second[name] != first[name]} == {"run1.parquet"}
    assert all(fresh[name] != second[name] for name in second)


def test_a_batch_that_is_started_again_says_how_many_inputs_it_skipped(tmp_path: Path, run) -> None:
    mine, out = tmp_path / "in", tmp_path / "out"
    mine.mkdir()
    for seed in range(3):
        moving(mine / f"run{seed}.jsonl", seed, 3)
    (mine / "broken.jsonl").write_text("no frame\n")
    said = list[list[str]]()
    for more in ((), (), ("--fresh",)):
        outcome = run("batch", mine, "--out", out, "--no-pictures", *more)
        said.append([line for line in outcome.out.splitlines() if "done before" in line])
    assert said == [
        [],
        ["3 of 4 inputs were done before and are unchanged, skipped; 1 computed now (--fresh: all)"],
        [],
    ]


def test_a_version_that_is_refused_leaves_no_table_of_the_one_before(tmp_path: Path, run) -> None:
    inputs, out = [moving(tmp_path / name, 1, 3) for name in ("a.jsonl", "b.jsonl")], tmp_path / "out"
    run("batch", *inputs, "--out", out, *PLAIN)
    inputs[0].write_text("no frame\n")
    assert run("batch", *inputs, "--out", out, *PLAIN).status == 1
    assert [path.name for path in (out / "frames").iterdir()] == ["b.parquet"]


def test_a_second_run_into_the_same_folder_is_refused(inputs: Path, tmp_path: Path, run) -> None:
    out = tmp_path / "out"
    with locked(Folder.of(str(out))):
        second = run("batch", inputs, "--out", out, *PLAIN)
    assert second.status == 2
    assert len(second.errors) == 1
    assert "another batch is writing there" in second.errors[0]


def test_a_full_disk_is_one_clear_line_and_the_next_run_goes_on(inputs: Path, tmp_path: Path, run) -> None:
    first, out = inputs / "run0.jsonl", tmp_path / "out"

    def small_files_only() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    full = batch(first, out, "--workers", "1", begin=small_files_only)
    assert full.returncode == 2
    assert "no room left" in full.stderr
    assert "free space and run again" in full.stderr
    assert "Traceback" not in full.stderr
    assert not list(out.rglob("*.parquet"))
    assert run("batch", first, "--out", out, *PLAIN).status == 0


def die_of(what: str) -> str:
    if what == "poison":
        os.kill(os.getpid(), signal.SIGKILL)
    return what.upper()


def test_a_worker_that_dies_takes_only_its_own_call_with_it() -> None:
    with worker_pool(2, None, lambda frames, size: None) as pool:
        done = dict(pool.unordered(die_of, ["a", "poison"]))
        assert not [worker for worker in active_children() if still_there(worker.pid)]
    assert isinstance(done.pop("poison"), WorkerLost)
    assert done == {"a": "A"}


def still_there(process: int | None) -> bool:
    """Whether a process exists; active_children lists one for a moment that another thread has waited for."""
    try:
        os.kill(process or 0, 0)
    except ProcessLookupError:
        return False
    return True


def test_workers_that_die_while_they_wait_lose_no_call() -> None:
    with worker_pool(2, None, lambda frames, size: None) as pool:
        assert dict(pool.unordered(die_of, ["a", "b"])) == {"a": "A", "b": "B"}
        for worker in active_children():
            worker.kill()
            worker.join()
        time.sleep(0.2)  # until the executor knows it
        assert dict(pool.unordered(die_of, ["c", "d"])) == {"c": "C", "d": "D"}


def test_frames_that_stand_alone_give_the_same_bytes_however_they_are_spread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run
) -> None:
    source = moving(tmp_path / "long.jsonl", 3, 40)
    monkeypatch.setattr("pipelines.batch.task.CHUNK", 16)
    outs = [tmp_path / name for name in ("whole", "spread")]
    for out, small in zip(outs, (1 << 30, 0), strict=True):
        monkeypatch.setattr("pipelines.batch.run._LIMITS", BatchLimits(worker_size=small))
        run("batch", source, "--out", out, "--geometry-only", *PLAIN)
    assert content(outs[0]) == content(outs[1])
    rows = papq.read_table(outs[0] / "frames/long.parquet").to_pylist()
    assert [row["seq"] for row in rows] == list(range(40))
    assert {row["direction_index"] for row in rows} == {1}


def test_results_and_inputs_may_be_at_addresses(undisturbed: Path, inputs: Path, tmp_path: Path, run) -> None:
    pytest.importorskip("fsspec", reason="it gives the address of a file system that is not pyarrow's own")
    out = tmp_path / "out"
    for system, name in (("file", "a"), ("fsspec+local", "b")):
        done = run("batch", f"{system}://{inputs}", "--out", f"{system}://{out}/{name}", *PLAIN)
        assert done.status == 1
    here, there = (papq.read_table(out / name / "frames/run1.parquet") for name in ("a", "b"))
    assert alike(here, papq.read_table(undisturbed / "frames/run1.parquet"))
    assert alike(there, here)
    record = json.loads((out / "b/run.json").read_text())
    assert record["inputs"][0]["source"] == f"fsspec+local://{inputs}/run0.jsonl"
    assert sorted(path.name for path in (out / "b").iterdir() if path.is_file()) == [
        *("report.html", "run.json", "summary.parquet")
    ]


def test_an_unreachable_address_is_an_error_of_one_line(tmp_path: Path, run) -> None:
    done = run("batch", "nonsense://bucket/key", "--out", tmp_path / "out", "--quiet")
    assert done.status == 2
    assert "nonsense://bucket/key: cannot be reached" in done.errors[0]


def test_inputs_that_stand_out_are_named(tmp_path: Path, run) -> None:
    (tmp_path / "in").mkdir()
    for seed in range(5):
        moving(tmp_path / f"in/run{seed}.jsonl", seed, 4)
    lines = (tmp_path / "in/run3.jsonl").read_text().splitlines()
    (tmp_path / "in/run3.jsonl").write_text("\n".join([*lines[:2], "{", "{"]) + "\n")
    output = run("batch", tmp_path / "in", "--out", tmp_path / "out", "--no-pictures", "--workers", "1").out
    (line,) = [line for line in output.splitlines() if line.startswith("stands out: ")]
    assert line.startswith("stands out: run3: ")
    assert "rejected 50 % of the frames, the others about 0 %" in line
    assert "rejected 50 % of the frames" in (tmp_path / "out/report.html").read_text()
