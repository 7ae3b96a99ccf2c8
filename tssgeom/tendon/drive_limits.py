"""Commands that stay within the force, the travel and the speed of the drive; docs/model.md (214)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tssgeom.core.constants import ROUNDING
from tssgeom.errors import SettingsError
from tssgeom.mechanism import NO_LIMITS
from tssgeom.rig import Rig
from tssgeom.tendon.state import TendonState, transmit

PULL = "tension_N"
"""Key of the limit of the pull; the drive that lets go is at its other end, 0 N."""


@dataclass(frozen=True, slots=True)
class DriveNow:
    """Where the drive is before a command."""

    position: float
    """[m]."""
    elapsed: float | None
    """Time since it was there [s]; None where it is not known."""


def drive_now(state: TendonState, rig: Rig, position: float | None, elapsed: float | None) -> DriveNow | None:
    """Return where the drive is, as stated or else by the model; None for a rig without limits."""
    if rig.drive.limits == NO_LIMITS:
        return None
    if position is None:
        position = 0.0 if state.route is None else transmit(state, rig).displacement_in
    return DriveNow(position, elapsed)


def cut_to_limits(
    wanted: TendonState,
    rig: Rig,
    now: DriveNow,
    pulled: Callable[[float], TendonState],
    located: Callable[[float], TendonState],
) -> tuple[TendonState, str]:
    """Return the tendon after the command that keeps to the limits, and the names of those that cut it.

    Parameters
    ----------
    wanted
        The tendon after the command without limits.
    rig, now
        The rig with its limits, and where the drive is.
    pulled, located
        Return the tendon after the drive is brought to a tension [N] or a position [m].

    Raises
    ------
    SettingsError
        Where the speed is limited and the time is not known.

    Notes
    -----
    Where limits contradict each other, travel counts more than tension and speed more than both, since a
    drive cannot be faster than it is.
    """
    limits, cut = rig.drive.limits, list[str]()
    most = limits.tension_N
    if most is not None and wanted.tension_in > most * (1.0 + ROUNDING.relative):
        wanted = pulled(most)
        cut.append(PULL)
    position = at = transmit(wanted, rig).displacement_in
    if limits.displacement_m is not None:
        position = within(position, *limits.displacement_m, "displacement_m", cut)
    if limits.speed_m_per_s is not None:
        if now.elapsed is None:
            raise SettingsError(
                "drive.limits.speed_m_per_s needs the time since the last command: give elapsed [s]"
            )
        reach = limits.speed_m_per_s * now.elapsed
        position = within(position, now.position - reach, now.position + reach, "speed_m_per_s", cut)
    if position != at:
        wanted = located(position)
        if most is not None and PULL not in cut and wanted.tension_in > most * (1.0 + ROUNDING.relative):
            cut.append(PULL)
    return wanted, ", ".join(cut)


def within(value: float, low: float, high: float, name: str, cut: list[str]) -> float:
    """Return a position between two [m]; append the name of the limit where it was not."""
    if low - ROUNDING.relative <= value <= high + ROUNDING.relative:
        return value
    cut.append(name)
    return min(max(value, low), high)
