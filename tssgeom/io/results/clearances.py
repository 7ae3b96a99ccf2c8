"""Clearance to a lumen as plain objects for JSON, and as columns of the summary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tssgeom.lumen.clearance import Clearance, Region


def clearance_object(lumen: str, found: Clearance) -> dict[str, Any]:
    """Return what `analyse --json` tells of the clearance of one shape, in SI.

    Parameters
    ----------
    lumen
        Name of the mesh.
    found
        The clearance of the frame that is told.
    """
    at = None if found.least is None else float(found.s[found.narrowest])
    return {
        "lumen": lumen,
        "tube_radius_m": found.radius,
        "least_m": found.least,
        "least_at_m": at,
        "contacts": _regions(found.contacts),
        "outside": _regions(found.outside),
        "beyond_ends_m": found.beyond,
    }


def clearance_columns(found: Clearance) -> dict[str, float | None]:
    """Return the columns of `summary.parquet` that tell the clearance."""
    return {
        "clearance_m": found.least,
        "clearance_at_m": None if found.least is None else float(found.s[found.narrowest]),
        "contact_length_m": sum(one.end - one.begin for one in found.contacts),
        "outside_length_m": sum(one.end - one.begin for one in found.outside),
    }


def _regions(regions: Sequence[Region]) -> list[dict[str, float]]:
    return [{"s_start_m": one.begin, "s_end_m": one.end, "least_m": one.least} for one in regions]
