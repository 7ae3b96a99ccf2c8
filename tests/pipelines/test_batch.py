"""`tssgeom batch`: what is written, what is rejected, and what an interruption leaves."""

import csv
import json
import math
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as papq
import pytest
import trimesh


def half_circle(count: int = 30) -> np.ndarray:
    angle = np.linspace(0.0, math.pi, count)
    return 500 / math.pi * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def files_in(folder: Path) -> list[str]:
    """Files of results; the notes of the batch itself are in a hidden folder."""
    files = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return sorted(path.as_posix() for path in files if path.parts[0] != ".batch")


@pytest.fixture
def inputs(write_csv, recording, tmp_path) -> Path:
    """A folder with a shape, a recording with a broken line, a bad shape, and things that are no shapes."""
    folder = write_csv("in/half.csv", half_circle()).parent
    recording.rename(folder / "pull.jsonl")
    write_csv("in/bad.csv", half_circle()[:3])
    (folder / "README.md").write_text("no shape")
    (folder / "rig.toml").write_text("[friction]\ncoefficient = 0.2\n")
    return folder


def test_files_of_no_format_are_counted_on_stderr_in_the_report_and_in_the_record(run, write_csv, tmp_path):
    folder = write_csv("in/half.csv", half_circle()).parent
    for name in ("a.json", "b.json", "wall.obj"):
        (folder / name).write_text("{}")
    out = tmp_path / "out"
    write_csv("in/half.txt", half_circle())
    said = (
        "3 files left out, of no format of shapes: .json 2, .obj 1; "
        "1 file left out, of an ending that is read where it is named, as in FOLDER/*.txt: .txt 1"
    )
    outcome = run("batch", folder, "--out", out, "--no-pictures")
    assert (outcome.status, outcome.errors) == (0, [f"tssgeom: {said}"])
    assert said in outcome.out  # at its end too, below hundreds of lines of progress
    assert json.loads((out / "run.json").read_text())["left_out"] == {".json": 2, ".obj": 1, ".txt": 1}
    assert said in (out / "report.html").read_text()
    assert run("check", folder).errors == run("analyse", folder).errors == [f"tssgeom: {said}"]


def test_every_result_is_written_and_what_is_bad_is_rejected(run, inputs, tmp_path):
    out = tmp_path / "out"
    outcome = run("batch", inputs, "--out", out)
    assert outcome.status == 1
    assert [error.partition(": ")[2].partition(": ")[0] for error in outcome.errors] == [
        str(inputs / "bad.csv"),
        str(inputs / "pull.jsonl"),
    ]
    assert files_in(out) == [
        *("frames/half.parquet", "frames/pull.parquet", "recordings/half.rrd", "recordings/pull.rrd"),
        *("report.html", "run.json", "segments/half.parquet", "segments/pull.parquet", "summary.parquet"),
    ]
    summary = papq.read_table(out / "summary.parquet").to_pylist()
    assert [(row["name"], row["frames"], row["rejected"]) for row in summary] == [
        ("half", 1, 0),
        ("pull", 6, 1),
    ]
    assert papq.read_table(out / "frames/pull.parquet").num_rows == 6
    record = json.loads((out / "run.json").read_text())
    assert record["counts"] == {"inputs": 2, "inputs_rejected": 1, "frames": 7, "frames_rejected": 1}
    assert "3 distinct points" in record["rejected"][0]["reason"]
    assert {*record["files"], "run.json"} == set(files_in(out))
    report = (out / "report.html").read_text()
    assert all(word in report for word in ("half", "pull", "bad.csv"))


def test_rejected_inputs_are_named_below_the_table_with_their_reasons(run, inputs, tmp_path):
    output = run("batch", inputs, "--out", tmp_path / "out", "--no-pictures").out
    assert re.search(r"^ half +30 ", output, re.MULTILINE)
    assert "\nrejected: bad.csv: 3 distinct points: a route needs at least 4" in output


def test_of_many_inputs_the_first_are_listed(run, write_csv, tmp_path):
    for k in range(43):
        write_csv(f"many/line{k:02}.csv", half_circle())
    output = run("batch", tmp_path / "many", "--out", tmp_path / "out", "--no-pictures").out
    assert len(re.findall(r"^ line\d+ ", output, re.MULTILINE)) == 40
    assert "\nand 3 more inputs, 0 of them with warnings: all are in the report" in output


def test_without_pictures_no_message_speaks_of_them(run, inputs, tmp_path):
    for options, words in (((), True), (("--no-pictures",), False)):
        output = run("batch", inputs / "half.csv", "--out", tmp_path / "out", *options).out
        assert ("tssgeom view" in output) == words
        page = (tmp_path / "out/report.html").read_text()
        assert ("recordings/half.rrd" in page) == words
        assert ("--no-pictures" in page) != words


def test_csv_has_the_same_tables(run, inputs, tmp_path):
    out = tmp_path / "out"
    run("batch", inputs, "--out", out, "--no-pictures", "--quiet")
    before = sorted(path.name for path in out.rglob("*.csv"))
    assert (before, run("batch", inputs, "--out", out, "--no-pictures", "--csv", "--quiet").status) == ([], 1)
    names = ["summary", *(f"{kind}/{name}" for kind in ("frames", "segments") for name in ("half", "pull"))]
    assert sorted(path.relative_to(out).as_posix() for path in out.rglob("*.csv")) == sorted(
        f"{name}.csv" for name in names
    )
    for name in names:
        table = papq.read_table(out / f"{name}.parquet").to_pylist()
        with (out / f"{name}.csv").open(newline="") as stream:
            rows = list(csv.DictReader(stream))
        assert [list(row) for row in rows] == [list(row) for row in table]
        lengths = [float(row["length_m"]) if row["length_m"] else None for row in rows]
        assert lengths == [row["length_m"] for row in table]
        texts = ["; ".join(row.get("warnings") or []) for row in table]
        assert [row.get("warnings") or "" for row in rows] == texts
    run("batch", inputs, "--out", out, "--no-pictures", "--fresh", "--quiet")
    assert list(out.rglob("*.csv")) == []


def test_json_gives_the_objects_of_analyse(run, inputs, tmp_path):
    by_batch = run("batch", inputs, "--out", tmp_path / "out", "--json").out
    by_analyse = run("analyse", inputs, "--json").out
    assert json.loads(by_batch) == json.loads(by_analyse)


def test_results_are_not_read_as_inputs(run, inputs):
    assert run("batch", inputs, "--out", inputs / "out", "--quiet").status == 1
    again = run("batch", inputs, "--out", inputs / "out2", "--json")
    assert [output["shape"] for output in json.loads(again.out)] == ["half", "pull"]


def test_inputs_of_one_name_keep_their_own_outputs(run, write_csv, tmp_path):
    write_csv("in/left/loop.csv", half_circle())
    write_csv("in/right/loop.csv", 2 * half_circle())
    assert run("batch", tmp_path / "in", "--out", tmp_path / "out", "--quiet").status == 0
    lengths = {
        name: papq.read_table(tmp_path / f"out/frames/{name}.parquet").to_pylist()[0]["length_m"]
        for name in ("left-loop", "right-loop")
    }
    assert lengths == pytest.approx({"left-loop": 0.5, "right-loop": 1.0}, rel=1e-4)


def test_a_link_is_an_input_by_its_own_name(run, write_csv, tmp_path):
    """As in a repository of git-annex, where each file is a link to one that is named by its content."""
    kept = write_csv("objects/MD5E-s41--7a.csv", half_circle())
    (tmp_path / "in").mkdir()
    (tmp_path / "in/trial_1.csv").symlink_to(kept)
    (tmp_path / "in/trial_2.csv").symlink_to(tmp_path / "nowhere/MD5E-s42--8b.csv")
    done = run("batch", tmp_path / "in", kept, "--out", tmp_path / "out", "--no-pictures")
    record = json.loads((tmp_path / "out/run.json").read_text("utf-8"))
    assert [entry["name"] for entry in record["inputs"]] == ["trial_1"]
    assert record["inputs"][0]["source"].endswith("in/trial_1.csv")
    (line,) = [line for line in done.out.splitlines() if line.startswith("rejected:")]
    assert line.startswith("rejected: trial_2.csv: cannot be read (No such file")


def test_nothing_done_is_status_2_and_writes_nothing(run, write_csv, tmp_path):
    bad = write_csv("in/bad.csv", half_circle()[:3])
    assert run("batch", bad, "--out", tmp_path / "out").status == 2
    assert not (tmp_path / "out").exists()


def test_tables_of_inputs_that_are_gone_are_removed_and_nothing_else(run, write_csv, tmp_path):
    out, folder = tmp_path / "out", tmp_path / "in"
    for name in ("stays", "gone", "breaks"):
        write_csv(f"in/{name}.csv", half_circle())
    assert run("batch", folder, "--out", out, "--quiet").status == 0
    (out / "mine.txt").touch()
    (folder / "gone.csv").unlink()
    (folder / "breaks.csv").write_text("broken")
    assert run("batch", folder, "--out", out, "--quiet").status == 1
    record = json.loads((out / "run.json").read_text())
    assert {*record["files"], "run.json", "mine.txt"} == set(files_in(out))
    assert not [name for name in files_in(out) if "gone" in name or "breaks" in name]


def test_a_bit_that_flips_in_a_table_is_named_by_verify_and_mended_by_the_next_batch(
    run, write_csv, tmp_path
):
    out, shape = tmp_path / "out", write_csv("half.csv", half_circle())
    assert run("batch", shape, "--out", out, "--quiet").status == 0
    assert run("verify", out).status == 0
    for name in ("frames/half.parquet", "segments/half.parquet", "summary.parquet"):
        whole = bytearray((out / name).read_bytes())
        damaged = whole.copy()
        damaged[len(whole) // 2] ^= 1
        (out / name).write_bytes(damaged)
        outcome = run("verify", out)
        assert outcome.status == 1
        assert name in outcome.errors[0]
        assert run("batch", shape, "--out", out, "--quiet").status == 0
        assert (out / name).read_bytes() == whole
    written = (out / "frames" / "half.parquet").stat().st_mtime_ns
    assert run("batch", shape, "--out", out, "--quiet").status == 0
    assert (out / "frames" / "half.parquet").stat().st_mtime_ns == written
    (out / "recordings" / "half.rrd").unlink()
    assert json.loads(run("verify", out, "--json").out)["changed"] == ["recordings/half.rrd"]
    assert run("verify", tmp_path).status == 2


def test_fresh_removes_what_an_earlier_batch_left_and_nothing_else(run, write_csv, tmp_path):
    out = tmp_path / "out"
    run("batch", write_csv("old.csv", half_circle()), "--out", out, "--quiet")
    (out / "mine.txt").touch()
    new = write_csv("new.csv", half_circle())
    assert run("batch", new, "--out", out, "--quiet").status == 0
    run("batch", write_csv("old.csv", half_circle()), "--out", out, "--quiet")
    assert run("batch", new, "--out", out, "--quiet", "--fresh").status == 0
    assert "mine.txt" in files_in(out)
    assert "frames/old.parquet" not in files_in(out)


def test_an_out_folder_that_cannot_be_written_is_one_line(run, inputs, tmp_path):
    (tmp_path / "out").touch()
    outcome = run("batch", inputs / "half.csv", "--out", tmp_path / "out", "--quiet")
    assert outcome.status in (1, 2)
    assert "cannot be written" in outcome.errors[0]


def test_an_interruption_leaves_whole_files_and_no_drafts(write_csv, tmp_path):
    for number in range(200):
        write_csv(f"in/s{number:03d}.csv", half_circle())
    # a shell shuts Ctrl-C off for what it starts with &, and the program would inherit that
    listening = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    code = listening + "from pipelines.cli import main; main()"
    command = [sys.executable, "-c", code, "batch", str(tmp_path / "in"), "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as batch:
        assert batch.stderr is not None
        progress = iter(batch.stderr.readline, "")
        assert any(line.startswith("[3/200]") for line in progress)  # two workers finish in any order
        batch.send_signal(signal.SIGINT)
        rest = batch.stderr.read()
    assert batch.returncode == 130
    *_, resumes, last = rest.splitlines()
    assert resumes == "tssgeom: stopped: the same command goes on with the inputs that are left"
    assert last == "tssgeom: interrupted: the files that were finished are whole"
    assert "Traceback" not in rest
    written = files_in(tmp_path / "out")
    assert "frames/s000.parquet" in written
    assert not any(Path(name).name.startswith(".") for name in written)
    for name in written:
        if name.endswith(".parquet"):
            assert papq.read_table(tmp_path / "out" / name).num_rows == 1


def test_locks_of_a_process_that_was_ended_are_removed_in_silence():
    """The watcher of signals ends a process without leaving its `with` blocks."""
    code = (
        "import multiprocessing, os; from pipelines.batch.workers import _start_tracker; _start_tracker(); "
        "lock = multiprocessing.get_context('spawn').Lock(); os._exit(1)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "")


def test_the_summary_has_the_clearance_where_there_is_a_lumen(run, half, write_csv, tmp_path):
    trimesh.creation.box((400.0, 400.0, 40.0)).export(tmp_path / "half_lumen.ply")
    other = write_csv("other.csv", half_circle())
    out = tmp_path / "out"
    assert run("batch", half, other, "--out", out, "--tube-mm", "10", "--no-pictures", "--quiet").status == 0
    rows = {row["name"]: row for row in papq.read_table(out / "summary.parquet").to_pylist()}
    assert rows["half"]["clearance_m"] == pytest.approx(0.015, abs=1e-6)
    assert (rows["half"]["contact_length_m"], rows["half"]["outside_length_m"]) == (0.0, 0.0)
    assert rows["other"]["clearance_m"] is None
    assert run("batch", half, other, "--out", out, "--tube-mm", "20", "--no-pictures", "--quiet").status == 0
    rows = {row["name"]: row for row in papq.read_table(out / "summary.parquet").to_pylist()}
    assert rows["half"]["clearance_m"] == pytest.approx(0.010, abs=1e-6)  # another tube is done anew


def test_a_map_that_no_file_of_a_batch_has_is_named(run, tmp_path):
    for name in ("a", "b"):
        rows = "".join(f"{k},{k * k / 9},0\n" for k in range(9))
        (tmp_path / f"{name}.csv").write_text(f"{name},y_mm,z_mm\n{rows}")
    said = ("--map", "a=x_mm", "--map", "b=x_mm", "--map", "c=x_mm")
    for _ in range(2):  # the second time the results stand
        outcome = run("batch", tmp_path / "a.csv", tmp_path / "b.csv", "--out", tmp_path / "out", *said)
        assert [line for line in outcome.errors if "no file that was read" in line] == [
            "tssgeom: warning: --map 'c': no file that was read has a column of this name"
        ]
