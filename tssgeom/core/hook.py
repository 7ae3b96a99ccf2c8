"""How pip builds the core into a wheel or an editable installation; not in a wheel itself."""

from __future__ import annotations

import os
import runpy
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import (  # pyright: ignore[reportMissingImports]
    BuildHookInterface,
)

HERE = Path(__file__).resolve().parent
_BUILD = runpy.run_path(str(HERE / "build.py"))  # no import: the package needs what is built here
_PLATFORMS = {
    "x86_64-linux-gnu.2.17": "manylinux_2_17_x86_64",
    "aarch64-linux-gnu.2.17": "manylinux_2_17_aarch64",
    "x86_64-macos": "macosx_11_0_x86_64",
    "aarch64-macos": "macosx_11_0_arm64",
    "x86_64-windows-gnu": "win_amd64",
}
"""Targets of zig, which `TSSGEOM_TARGET` may name, and the tag of their wheels."""


class CoreBuildHook(BuildHookInterface):
    """Builds the core where pip makes a wheel or an editable installation."""

    def dependencies(self) -> list[str]:
        """Ask for a compiler from PyPI where the system has none."""
        alone = _BUILD["system_compiler"]() is None or os.environ.get("TSSGEOM_TARGET")
        return ["cffi>=1.17", *(["ziglang>=0.13"] if alone else [])]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build into the tree for an editable installation, else into the wheel only."""
        if version == "editable":
            _BUILD["build"](HERE)
            return
        target = os.environ.get("TSSGEOM_TARGET")
        self._made = tempfile.TemporaryDirectory()
        for path in _BUILD["build"](Path(self._made.name), target=target):
            build_data["force_include"][str(path)] = f"tssgeom/core/{path.name}"
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{_platform(target)}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was built once the wheel has it."""
        if version != "editable":
            self._made.cleanup()


def _platform(target: str | None) -> str:
    """Return the platform tag of a wheel."""
    if target is not None:
        return _PLATFORMS[target]
    return sysconfig.get_platform().replace("-", "_").replace(".", "_")
