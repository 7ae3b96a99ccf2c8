"""Names and outputs that are not what they should be: control characters in a name, no μ, no room."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.live.peers import frame

COMMAND = [sys.executable, "-c", "from pipelines.cli import main; main()"]


def ended(*arguments: str | Path, **options) -> subprocess.CompletedProcess[bytes]:
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, check=False, timeout=120, stderr=subprocess.PIPE, **options)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_an_output_that_lacks_a_letter_is_no_traceback(half, encoding):
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    table = ended("analyse", half, env=environment, stdout=subprocess.PIPE)
    assert (table.returncode, b"Traceback" in table.stderr) == (0, False)
    as_json = ended("analyse", half, "--json", env=environment, stdout=subprocess.PIPE)
    assert json.loads(as_json.stdout.decode(encoding))["shape"] == "half"


def test_no_control_character_of_a_name_reaches_the_terminal(half, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for name in ("red\x1b[31m.csv", "one\x01.csv"):
        (folder / name).write_bytes(half.read_bytes())
        (folder / f"bad{name}").write_text("x")
    done = ended("batch", folder, "--out", tmp_path / "out", "--no-pictures", stdout=subprocess.PIPE)
    assert done.returncode == 1
    for text in (done.stdout, done.stderr):
        assert b"\x1b" not in text
        assert b"\x01" not in text
        assert b"\\x1b[31m" in text


def test_a_line_break_in_a_name_begins_no_line_of_its_own(half, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "a\ntssgeom: all well.csv").write_bytes(half.read_bytes())
    (folder / "b\ntssgeom: all well.csv").write_text("x")
    done = ended("batch", folder, "--out", tmp_path / "out", "--no-pictures", stdout=subprocess.PIPE)
    assert done.returncode == 1
    assert b"all well" in done.stderr
    assert not [line for line in done.stderr.splitlines() if line.startswith(b"tssgeom: all well")]


def locale_of_latin_1() -> str | None:
    program = shutil.which("locale")
    names = subprocess.run([program, "-a"], capture_output=True, check=True).stdout if program else b""
    return next((name for name in names.decode().split() if name.lower().endswith("iso88591")), None)


@pytest.mark.skipif(locale_of_latin_1() is None, reason="this machine has no locale of Latin-1")
def test_a_locale_of_one_byte_a_letter_writes_into_a_folder_with_an_umlaut(half, tmp_path):
    out = tmp_path / "Übung" / "out"
    environment = {**os.environ, "LC_ALL": str(locale_of_latin_1())}
    done = ended("batch", half, "--out", out, "--csv", "--no-pictures", env=environment)
    assert (done.returncode, (out / "summary.parquet").is_file()) == (0, True), done.stderr


def test_answers_that_find_no_room_are_an_error():
    with Path("/dev/full").open("wb") as full:
        done = ended("live", input=frame(0.0), stdout=full)
    assert done.returncode == 1
    assert b"--sink -: answers cannot be written (No space left on device)" in done.stderr
