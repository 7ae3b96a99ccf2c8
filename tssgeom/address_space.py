"""Address space for Rerun and OpenCV, which may end the process where the system refuses them some."""

import sys
from pathlib import Path

from tssgeom.errors import SettingsError

FIRST = 1 << 30
"""Address space that Rerun and the first recording take [B]; measured: 0.7 GiB, and more for long ones."""
EACH = 1 << 28
"""Address space that any other recording takes [B]; measured: 0.1 GiB, most of it stacks of threads."""
VIDEO = 1 << 28
"""Address space that a video takes while it is read [B]; measured: 0.16 GiB, most of it stacks of threads."""
CAMERAS = 3 << 27
"""Address space that a calibration of cameras takes [B]; measured: 0.29 GiB, most of it buffers of
linear algebra."""


def require_address_space(needed: int, what: str, instead: str = "") -> None:
    """Refuse to begin with a recording, a video or cameras where the system limits the address space.

    Parameters
    ----------
    needed
        What it takes [B].
    what
        What takes it, for the message.
    instead
        What may be done instead, for the message.

    Raises
    ------
    SettingsError
        Where less is left.
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
            f"a limit leaves {max(limit - held, 0) >> 20} MiB of address space, {what} takes "
            f"{needed >> 20} MiB: raise it (ulimit -v){instead}"
        )
