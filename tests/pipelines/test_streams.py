"""Full, closed and poor standard streams: no traceback, a status that fits, and no file is lost."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

SHAPE = Path(__file__).parents[2] / "sample_shapes/half_circle.csv"
TSSGEOM = f"{shlex.quote(sys.executable)} -c 'from pipelines.cli import main; main()'"


def shell(command: str, **environment: str) -> tuple[int, str, str]:
    """Run a line of a shell in which `tssgeom` is the program; return status, output and errors."""
    line = command.replace("tssgeom", TSSGEOM).replace("SHAPE", shlex.quote(str(SHAPE)))
    done = subprocess.run(
        ["bash", "-c", line], capture_output=True, check=False, env={**os.environ, **environment}
    )
    return done.returncode, done.stdout.decode("latin-1"), done.stderr.decode("latin-1")


@pytest.mark.parametrize("command", ["analyse SHAPE", "analyse SHAPE --json", "check SHAPE", "--help"])
def test_a_full_output_is_one_line_and_status_2(command):
    status, _, errors = shell(f"tssgeom {command} > /dev/full")
    assert (status, errors.count("\n")) == (2, 1)
    assert "No space left on device" in errors


@pytest.mark.parametrize("command", ["analyse SHAPE", "analyse SHAPE --json", "--help"])
def test_a_closed_output_goes_nowhere(command):
    assert shell(f"tssgeom {command} >&- <&-")[::2] == (0, "")


@pytest.mark.parametrize("errors", ["/dev/full", "&-"])
def test_errors_that_cannot_be_printed_leave_their_status(errors):
    assert shell(f"tssgeom check nothing.csv 2>{errors}") == (2, "", "")


@pytest.mark.parametrize("command", ["analyse SHAPE", "analyse SHAPE --json", "--help"])
def test_a_reader_that_leaves_early_is_no_failure(command):
    assert shell(f"tssgeom {command} | true; exit ${{PIPESTATUS[0]}}") == (0, "", "")


def test_a_batch_whose_reader_leaves_is_done_to_the_end(tmp_path):
    inputs = "".join(f" {name}.csv" for name in "abcd")
    copies = f"cd {tmp_path} && for name in{inputs}; do cp SHAPE $name; done; "
    batch = f"tssgeom batch{inputs} --out out --no-pictures --workers 1 2>&1"
    assert shell(f"{copies}{batch} | head -1; exit ${{PIPESTATUS[0]}}")[0] == 0
    assert len(json.loads((tmp_path / "out/run.json").read_text("utf-8"))["inputs"]) == 4


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_what_an_output_cannot_write_is_written_out(encoding):
    status, table, errors = shell("tssgeom analyse SHAPE", PYTHONIOENCODING=encoding)
    assert (status, errors) == (0, "")
    assert r"\u03a6" in table
    status, text, _ = shell("tssgeom analyse SHAPE --json", PYTHONIOENCODING=encoding)
    assert (status, json.loads(text)["shape"]) == (0, "half_circle")
