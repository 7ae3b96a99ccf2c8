"""Hostile files end in one line, take no memory, and cost no other input its result."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.attack.bombs import BOMBS, SOUND, make_special
from tests.attack.names import make_named

COMMAND = [sys.executable, "-c", "from pipelines.cli import main; main()"]


def ended(*arguments: str | Path) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([*COMMAND, *map(str, arguments)], check=False, capture_output=True, timeout=120)


def test_every_hostile_name_keeps_its_result(tmp_path):
    made = make_named(tmp_path / "in")
    done = ended("batch", *made, "--out", tmp_path / "out", "--no-pictures", "--workers", "1")
    assert (done.returncode, done.stderr.count(b"Traceback")) == (0, 0)
    assert len(json.loads((tmp_path / "out/run.json").read_text("utf-8"))["inputs"]) == len(made)
    assert ended("verify", tmp_path / "out").returncode == 0


def test_special_files_in_a_folder_leave_the_other_results(tmp_path):
    make_special(tmp_path)
    shutil.copy(SOUND, tmp_path / "sound.csv")
    done = ended("batch", tmp_path, "--out", tmp_path / "out", "--no-pictures", "--workers", "1")
    assert done.returncode == 1
    assert done.stderr.count(b"a pipe or a device") >= 4
    assert (tmp_path / "out/frames/sound.parquet").is_file()


@pytest.mark.parametrize("name", ["one_frame.npz", "time.npz", "points.vtp", "packed.mat", "packed.csv.gz"])
def test_what_unpacks_to_too_much_is_refused_by_the_limit(tmp_path, name):
    BOMBS[name](tmp_path / name)
    done = ended("analyse", tmp_path / name, "--unit", "mm")
    assert done.returncode == 2
    assert b"the limit is 64 MiB: divide the file, or set TSSGEOM_MOST_MIB=" in done.stderr


@pytest.mark.parametrize("command", [("simulate", "--drive"), ("compensate", "--target")])
def test_a_run_that_fails_leaves_no_table_and_keeps_an_earlier_one(tmp_path, command):
    name, option = command
    broken = tmp_path / "broken.csv"
    broken.write_text("time_s,tension_in_N\n0,nan\n")
    table = tmp_path / f"{name}.parquet"
    assert ended(name, SOUND, option, broken, "--out", tmp_path).returncode == 2
    assert not table.exists()
    table.write_text("of an earlier run")
    assert ended(name, SOUND, option, broken, "--out", tmp_path).returncode == 2
    assert table.read_text() == "of an earlier run"


def test_a_rejected_input_loses_its_earlier_result(tmp_path):
    for shape in ("a.csv", "b.csv"):
        shutil.copy(SOUND, tmp_path / shape)
    out = tmp_path / "out"
    arguments = (
        "batch",
        tmp_path / "a.csv",
        tmp_path / "b.csv",
        "--out",
        out,
        "--no-pictures",
        "--workers",
        "1",
    )
    assert ended(*arguments).returncode == 0
    (tmp_path / "b.csv").write_text("x_mm,y_mm,z_mm\n")
    assert ended(*arguments).returncode == 1
    assert sorted(path.name for path in (out / "frames").iterdir()) == ["a.parquet"]
    assert ended("verify", out).returncode == 0
