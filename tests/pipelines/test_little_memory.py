"""A limited address space is one line for each input, and a library that it would kill is not started."""

import resource
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
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


def test_a_video_that_does_not_fit_is_refused_before_its_library_dies_of_it(tmp_path):
    film = cv2.VideoWriter(str(tmp_path / "cam.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (64, 48))
    film.write(np.zeros((48, 64, 3), np.uint8))
    film.release()
    program = (
        "import resource, sys; from pathlib import Path; from tssgeom.vision.footage import open_footage; "
    )
    program += "held = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize(); "
    program += "resource.setrlimit(resource.RLIMIT_AS, 2 * (held + (200 << 20),)); open_footage(sys.argv[1:])"
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "cam.avi"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "MiB of address space, a video takes 256 MiB: raise it (ulimit -v)" in done.stderr.splitlines()[-1]


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
