"""C beside a Python module, compiled once for each state of its sources."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cffi import FFI

FLAGS = ("-std=c11", "-O3", "-fPIC", "-shared", "-Wall", "-Wextra", "-ffp-contract=off", "-fno-math-errno")


def compiler() -> list[str]:
    """Return the command of a C compiler: that of the system, or else zig's."""
    if chosen := os.environ.get("CC"):
        return shlex.split(chosen)
    path = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    return [path] if path else [sys.executable, "-m", "ziglang", "cc"]


def library_of(header: Path, sources: Sequence[Path]) -> tuple[FFI, Any]:
    """Compile some sources and open the functions that a header without directives declares."""
    content = b"\0".join(path.read_bytes() for path in (header, *sources))
    digest = hashlib.sha256(content + repr((FLAGS, compiler())).encode()).hexdigest()[:16]
    library = header.parent / "__pycache__" / f"{header.stem}-{digest}.so"
    if not library.exists():
        library.parent.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            made = Path(folder) / library.name
            command = [*compiler(), *FLAGS, *map(str, sources), "-o", str(made), "-lm"]
            subprocess.run(command, check=True)
            os.replace(made, library)  # in one step, since other processes may do the same
    ffi = FFI()
    ffi.cdef(header.read_text(encoding="utf-8"))
    return ffi, ffi.dlopen(str(library))
