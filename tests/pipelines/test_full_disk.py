"""A full disk, or a limit of the size of files, is one line, and nothing is half-written."""

import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

SAMPLES = Path(__file__).parents[2] / "sample_shapes"
LOOP, CAMPAIGN = SAMPLES / "setup_a.csv", SAMPLES / "campaign_hidden_bend"
LARGEST = 3000  # B of a file; less than any result has


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST, LARGEST))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)


@pytest.mark.parametrize(
    "command",
    [
        ("analyse", LOOP),
        ("simulate", LOOP, "--drive", CAMPAIGN / "loop_slow.csv"),
        ("compensate", LOOP, "--target", CAMPAIGN / "loop_slow.csv"),
        ("batch", LOOP, "--workers", "1"),
        ("paper",),
    ],
    ids=lambda command: command[0],
)
def test_a_full_disk_is_one_line_and_nothing_is_half_written(tmp_path, command):
    out = tmp_path / "out"
    done = subprocess.run(
        [sys.executable, "-c", "from pipelines.cli import main; main()", *map(str, command), "--out", out],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limited,
        timeout=300,  # s; it used to wait for ever
    )
    lines = (line for line in done.stderr.splitlines() if not line.startswith("["))  # steps of the work
    errors = [line for line in lines if ": warning: " not in line]
    assert done.returncode in (1, 2), done.stderr
    assert len(errors) == 1
    assert "no room left (File too large): free space and run again" in errors[0]
    left = [path for path in out.rglob("*") if path.is_file() and ".batch" not in path.parts]
    assert all(path.stat().st_size < LARGEST for path in left)
    assert not [path for path in left if path.name.startswith(".") or path.suffix in (".rrd", ".parquet")]
