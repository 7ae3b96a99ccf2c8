"""Limits of the filter of points in time; docs/model.md (156), (159)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FilterLimits:
    """When a filter begins anew, and which points it leaves out."""

    least_step: float = 0.1
    """Time that passes at least between two frames, and one over that after which the filter begins anew
    [usual steps]. Chosen: frames may come in bursts."""
    most_over_spatial: float = 4.0
    """Variance in time over that in one frame, which shows all noise of single points [1]. Chosen."""
    patience: int = 5
    """Frames in a row after which a point that leapt alone, or comes back, is used [1]. Chosen."""
    constant_share: float = 0.2
    """Least share of a stated variance that counts as constant in time [1]. Chosen: what changes is known to
    some 10 % after a few frames."""


FILTER = FilterLimits()
