"""Runs a module with a copy of the package whose core is built with AddressSanitizer and UBSan.

python -m tests.core.sanitized tests.core.fuzz --seconds 60
python -m tests.core.sanitized pytest -q -n0 tests/core
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tssgeom.core.build import HERE, build

ROOT = HERE.parent.parent
FLAGS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-g", "-O1"]


def run(module: str, *arguments: str) -> int:
    """Run a module of Python with the sanitized core; return its exit status."""
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name) / "tssgeom"
        shutil.copytree(HERE.parent, copy, ignore=shutil.ignore_patterns("__pycache__", "_core*"))
        build(copy / "core", flags=FLAGS)
        stamp = time.time() + 86400.0  # newer than the sources: it shall not be built again without the flags
        for path in (copy / "core").glob("_*"):
            os.utime(path, (stamp, stamp))
        asan = subprocess.run(
            ["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True
        )
        env = os.environ | {
            "PYTHONPATH": os.pathsep.join([name, str(ROOT)]),
            "LD_PRELOAD": asan.stdout.strip(),
            "ASAN_OPTIONS": "detect_leaks=0",  # Python leaves memory to the end of the process
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        command = [sys.executable, "-m", module, *(_absolute(each) for each in arguments)]
        return subprocess.run(command, env=env, check=False, cwd=name).returncode


def _absolute(argument: str) -> str:
    """Return the path of an argument that is one, as the module runs elsewhere."""
    return str(ROOT / argument) if "/" in argument and (ROOT / argument).exists() else argument


if __name__ == "__main__":
    sys.exit(run(*sys.argv[1:]))
