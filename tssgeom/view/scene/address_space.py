"""Address space for Rerun, which ends the process where the system refuses it some."""

import sys
from pathlib import Path

from tssgeom.errors import SettingsError

FIRST = 1 << 30
"""Address space that Rerun and the first recording take [B]; measured: 0.7 GiB, and more for long ones."""
EACH = 1 << 28
"""Address space that any other recording takes [B]; measured: 0.1 GiB, most of it stacks of threads."""


def require_address_space(needed: int) -> None:
    """Refuse to begin a recording where the system limits the address space.

    Parameters
    ----------
    needed
        What it takes [B].

    Raises
    ------
    SettingsError
        Where less is left than a recording takes.
    """
    if sys.platform != "linux":
        return
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return
    held = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
    if limit - held < needed:
        raise SettingsError(
            f"a limit leaves {max(limit - held, 0) >> 20} MiB of address space, a recording takes "
            f"{needed >> 20} MiB: raise it (ulimit -v), or write no recordings"
        )
