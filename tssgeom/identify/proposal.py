"""Experiments that are proposed: what report, figures and drive files are made from.

Source: docs/discovery.md, "Designed experiments".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import SettingsError
from tssgeom.route.pieces import Arcs


@dataclass(frozen=True, slots=True)
class Asked:
    """Settings of a proposal."""

    runs: int
    """How many."""
    limits: Mapping[str, float]
    """What is stated, by the keys of `run_limits.KEYS`, in their units."""

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise SettingsError(f"--propose {self.runs}: give 1 or more")


@dataclass(frozen=True, slots=True)
class ExpectedEvidence:
    """Expected evidence of the runs so far and of the proposed ones between two models."""

    true: str
    """Model that is assumed to be true."""
    other: str
    """Model that it is compared with."""
    delta_bic: float
    """By how much the other one is worse [1]."""


@dataclass(frozen=True, slots=True)
class NarrowedInterval:
    """A number whose 95 % interval the proposed runs are expected to narrow."""

    name: str
    """Name of the number."""
    value: float
    """Its estimate, in `unit`."""
    unit: str
    """Unit of the number."""
    half_width: float
    """Half of its 95 % interval now, in `unit`."""
    expected: float
    """Half of it after the runs, in `unit`."""


@dataclass(frozen=True, slots=True)
class ProposedRun:
    """One run that is proposed."""

    name: str
    route: str
    """Name of a route of the campaign; of another route, how to bend the sheath."""
    like: str
    """A run of the campaign on that route; of another route, on the one that it is made from."""
    new_route: Arcs | None
    """Pieces of another route; None on a route of the campaign."""
    drives: tuple[str, ...]
    """Their channels."""
    time: Vector
    """[n] [s]."""
    values: Matrix
    """[n, drives] [m], [N], [rad] or [N·m]."""
    corner_time: Vector
    """[k] Ends of legs and dwells [s]."""
    corners: Matrix
    """[k, drives] The drives there."""
    why: str
    outcomes: tuple[str, ...]
    """What each outcome would mean, a sentence each."""
    expected: tuple[ExpectedEvidence, ...]
    """After this run and those before it; empty where there is nothing to separate."""
    channels: Mapping[str, Mapping[str, Vector]]
    """[n] What each model predicts, by its name and channel [SI]."""
    differences: Mapping[str, Mapping[str, Vector]]
    """[n] The same less the first model refitted to it, by the names of the others [SI]."""
    sigma: Mapping[str, Vector]
    """[n] Standard deviation of what the sensors may read off the truth, by channel [SI]."""
    clearest: str
    """The channel in which the models differ most."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """The experiments that are worth most next."""

    sentence: str
    """What they are for, and what is expected of them."""
    candidates: tuple[str, ...]
    """Models that are left, the best first; one where there is nothing to separate."""
    limits: Mapping[str, float]
    """By key, in its unit."""
    stated: tuple[str, ...]
    """Limits that the user stated; the others are what the runs of the campaign reached."""
    runs: tuple[ProposedRun, ...]
    narrowed: NarrowedInterval | None
    """Where there is nothing to separate."""
    in_the_way: str
    """Which limit stands against more, a sentence; empty where none does."""
