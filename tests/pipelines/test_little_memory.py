"""A limited address space is one line for each input, and a library that it would kill is not started."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tssgeom.errors import lacks_memory

LOOP = Path(__file__).parents[2] / "sample_shapes" / "setup_a.csv"
SPACE = 1 << 30  # B; everything but a recording fits


def test_a_recording_that_does_not_fit_is_refused_in_one_line(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", "from pipelines.cli import main; main()", "analyse", LOOP, "--out", tmp_path],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (SPACE, SPACE)),
        timeout=120,
    )
    assert done.returncode in (1, 2)
    assert done.stderr.count("\n") == 1
    assert "MiB of address space, a recording takes 1024 MiB: raise it (ulimit -v)" in done.stderr
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]


@pytest.mark.parametrize(
    ("error", "lacks"),
    [
        (MemoryError(), True),
        (ImportError("libarrow.so: failed to map segment from shared object"), True),
        (RuntimeError("can't start new thread"), True),
        (RuntimeError("Failed to spawn background thread"), True),
        (Exception("std::bad_alloc"), True),
        (ValueError("a name of memory"), False),
    ],
)
def test_what_libraries_say_without_memory_is_recognised(error, lacks):
    assert lacks_memory(error) is lacks
    assert lacks_memory(_following(error)) is lacks


def _following(error: Exception) -> Exception:
    try:
        try:
            raise error
        finally:
            raise RuntimeError("cannot join thread before it is started")
    except RuntimeError as last:
        return last
