"""A campaign: measured runs of one rig on its routes, and the nominal rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tssgeom.arrays import Points, Vector
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


@dataclass(frozen=True, slots=True)
class Route:
    """One sensed route of a campaign."""

    name: str
    arcs: Arcs
    position: Points
    """[n, 3] Nodes of the fitted curve, proximal to distal [m]."""
    s: Vector
    """[n] Arc length at the nodes [m]."""


@dataclass(frozen=True, slots=True)
class Run:
    """One measured run; columns by the names of the run files, in SI, NaN where a reading is missing."""

    name: str
    """Name of the run."""
    route: Route
    """The route on which it was measured."""
    columns: Mapping[str, Vector]
    """`time_s` [s] and any of `tension_in_N`, `tension_out_N` [N], `elongation_m`, `displacement_in_m`,
    `displacement_out_m` [m], `temperature_C` [°C]; each [n]."""
    held_out: bool = False
    """Kept from every fit, to judge by."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """What `discover` is given."""

    name: str
    """Name of the folder."""
    rig: Rig
    """The nominal rig."""
    runs: tuple[Run, ...]
    """The measured runs."""
    notes: tuple[str, ...] = ()
    """What the reader had to decide or noticed, each a sentence."""
    held_out_fixed: bool = False
    """Whether the runs that are held out are decided, even where none is."""
