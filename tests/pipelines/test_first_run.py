"""The first run reports on a terminal why it takes so long."""

import os
import pty
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

ASK = "from pipelines.inputs import announce_compiling; announce_compiling()"


def terminal_text(cache: Path) -> str:
    """What a terminal shows where compiled code is in `cache`."""
    ours, theirs = pty.openpty()
    env = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    subprocess.run([sys.executable, "-c", ASK], env=env, stderr=theirs, check=True)
    os.close(theirs)
    text = b""
    with suppress(OSError):  # no process holds the other end any more
        while chunk := os.read(ours, 4096):
            text += chunk
    os.close(ours)
    return text.decode()


def test_it_is_reported_on_a_terminal_while_nothing_is_compiled(tmp_path):
    assert "compiling takes a minute or two" in terminal_text(tmp_path)
    (folder,) = tmp_path.glob("bars_*")
    (folder / "march.march-1.py311.nbi").touch()
    assert terminal_text(tmp_path) == ""


def test_nothing_is_reported_into_a_file(tmp_path):
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", ASK], env=env, capture_output=True, text=True, check=True)
    assert done.stderr == ""
