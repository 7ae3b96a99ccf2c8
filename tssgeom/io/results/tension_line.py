"""A route with the tension along it, as other programs are to have it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tssgeom.arrays import Points, Vector
from tssgeom.stream import FrameResult


@dataclass(frozen=True, slots=True)
class TensionLine:
    """Nodes of a route, proximal to distal, and what is known at each."""

    name: str
    unit: str
    """Unit of length to write in, where the format leaves a choice: "m" or "mm"."""
    s: Vector
    """Arc length at the nodes [m]."""
    position: Points
    """Places of the nodes [m]."""
    values: Mapping[str, Vector]
    """Further numbers at the nodes, by name with the unit."""
    totals: Mapping[str, float]
    """Numbers of the whole route, by name with the unit."""


def tension_line(name: str, unit: str, result: FrameResult, tension: Vector) -> TensionLine:
    """Gather what a frame's route and tendon are to tell other programs.

    Parameters
    ----------
    name
        Name of the shape.
    unit
        Unit of length of its source; what is neither m nor mm becomes mm.
    result
        The frame.
    tension
        Tension at the nodes of its route [N].
    """
    profile, moved = result.profile, result.transmission
    return TensionLine(
        name,
        "m" if unit == "m" else "mm",
        result.route.s,
        result.route.position,
        {
            "tension_N": tension,
            "kappa_per_m": profile.kappa,
            "kappa_se_per_m": profile.kappa_se,
            "angle_rad": profile.phi,
        },
        {
            "length_m": profile.length,
            "total_angle_rad": profile.total_angle,
            "tension_in_N": moved.tension_in,
            "tension_out_N": moved.tension_out,
            "elongation_m": moved.elongation,
        },
    )
