"""The result of the workflow, whole: report, figures and recording are made from this and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from tssgeom.arrays import Vector
from tssgeom.effects import AnyEffect
from tssgeom.identify.campaign import Campaign
from tssgeom.identify.proposal import Proposal
from tssgeom.result import Result
from tssgeom.rig import Rig
from tssgeom.uncertain import RigErrors, Unexplained

Verdict = Literal["none", "effect", "law", "tie", "partial", "unknown"]
"""`law`: a mechanism whose law is no formula of the library; `partial`: what helps, and something remains."""
PHASES = ("pull", "pull_to_release", "release", "release_to_pull", "hold")


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its 95 % interval."""

    value: float
    unit: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence for an effect, or against it."""

    delta_bic: float
    """How much the Bayesian information criterion falls with the effect [1]."""
    threshold: float
    """What `delta_bic` has to exceed: what the best of the library reaches on 1 % of clean campaigns [1]."""
    size_over_limit: float
    """Largest change of a channel by the effect over the detection limit of the sensors [1]."""
    heldout_ratio: float
    """Held-out misfit with the effect over that without [1]; NaN without held-out runs or misfit."""
    held_out_fall: float = 0.0
    """How much χ² of the held-out runs falls with the effect [1]; −inf where they contradict it."""

    @property
    def total(self) -> float:
        """What candidates are ordered by: ΔBIC, held-out runs included [1]."""
        return self.delta_bic + self.held_out_fall


class RigNumber(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A number of a rig that acts where the rig file has none, such as a play; its key names it."""

    key: str
    """Where it stands in the rig: `end.play_rad`."""


@dataclass(frozen=True, slots=True)
class LawCurve:
    """A law over what it depends on, with its 95 % band; friction as the coefficient itself."""

    over: str
    """Name and unit of x."""
    x: Vector
    """[k] In SI, over what was measured."""
    value: Vector
    """[k]"""
    low: Vector
    high: Vector
    unit: str
    nearest: tuple[tuple[str, float], ...] = ()
    """Formulae of the library for the same, and by how much 2 ln Z falls with each [1]."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One effect of the library or number of the rig, or a set of them, refitted through the model."""

    names: tuple[str, ...]
    """Of effects; of a law that of its mechanism."""
    effects: tuple[AnyEffect | RigNumber, ...]
    parameters: tuple[Mapping[str, Estimate], ...]
    """Of each effect."""
    evidence: Evidence
    why_not: str
    """One sentence: why it was passed over; empty for what was chosen."""
    law: LawCurve | None = None
    """Where it is a law that no formula has."""


@dataclass(frozen=True, slots=True)
class MisfitShare:
    """A cell of the heat map in which measured and simulated disagree."""

    channel: str
    """Channel, with its unit."""
    phase: str
    """`pull`, `pull_to_release`, `release`, `release_to_pull` or `hold`."""
    run: str
    """Run of the campaign."""
    tension_range_N: tuple[float, float]
    """Range of the proximal tension [N]."""
    route_range_m: tuple[float, float] | None
    """Stretch of the route that the misfit points at; null, or None, where it points at none [m]."""
    share: float
    """Share of all calibrated residual power [1]."""


@dataclass(frozen=True, slots=True)
class HeatMap:
    """Calibrated residual power: 1 is what the sensors explain."""

    rows: tuple[str, ...]
    """Channel and run."""
    columns: tuple[str, ...]
    """Phase and tension bin."""
    power: np.ndarray
    """[rows, columns] Mean square of residual over noise [1]; NaN where no sample falls."""


@dataclass(frozen=True, slots=True)
class RouteMisfit:
    """Fitted friction of a route beyond the model, along its length."""

    route: str
    """Route of the campaign."""
    s_m: Vector
    """Arc length [m]."""
    extra_angle_rad_per_m: Vector
    """Curve angle that is missing there [rad/m]."""
    se_rad_per_m: Vector
    """Its standard error [rad/m]."""


@dataclass(frozen=True, slots=True)
class Tie:
    """Effects that the data cannot separate."""

    names: tuple[str, ...]
    gauge: str
    """Its name in docs/model.md, or "profile" where only these data cannot separate them."""
    why: str


@dataclass(frozen=True, slots=True)
class Experiment:
    """What to measure next."""

    experiment: str
    """What to measure."""
    expected_delta_bic: float
    """Evidence that it is expected to give [1]."""
    separates: tuple[str, ...]
    """Effects that it separates."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """Root mean squares of measured less simulated, by channel [N, m]."""

    noise: Mapping[str, float]
    before: Mapping[str, Mapping[str, float]]
    """`fitted` and `held_out`, each by channel."""
    after: Mapping[str, Mapping[str, float]]
    by_phase: Mapping[str, Mapping[str, tuple[float, float]]]
    """Before and after by channel and phase, over the held-out runs, or all where none is held out."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One run, measured and simulated."""

    run: str
    route: str
    held_out: bool
    time: Vector
    """[n] Samples that were used [s]."""
    phase: np.ndarray
    """[n] Index into `PHASES`."""
    tension_in: Vector
    """[n] The model's, after [N]."""
    measured: Mapping[str, Vector]
    """[n] By channel; NaN where missing."""
    before: Mapping[str, Vector]
    """[n] Base model, refitted."""
    after: Mapping[str, Vector]
    """[n] Model with the chosen effects; the same as before where none was."""
    sigma: Mapping[str, Vector]
    """[n] Standard deviation of what the sensors may read off the truth, by channel."""
    tension: np.ndarray
    """[n, nodes of the route] Tension along the tendon, after [N]; no nodes for a machine."""
    drive: tuple[str, Vector] | None = None
    """Of a machine: the channel that drives, and its readings [n]."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What is missing where no name fits: friction over what it depends on."""

    over: str
    """Name and unit of `x`: tension_N, speed_m_per_s, curvature_per_m, s_m or cycle."""
    x: Vector
    """Where friction is evaluated, in SI."""
    friction: Vector
    """Fitted coefficient of friction there [1]."""
    se: Vector
    """Its standard error [1]."""
    explains: float
    """Share of the misfit that it explains [1]."""


@dataclass(frozen=True, slots=True, repr=False)
class Finding(Result):
    """The answer."""

    campaign: Campaign
    """What was given."""
    verdict: Verdict
    """Whether the model lacks something, and whether that has a name."""
    sentence: str
    """The verdict in words, with its numbers."""
    effects: tuple[Candidate, ...]
    """What was chosen, the strongest first; each a candidate of one effect, with the evidence it adds."""
    ties: tuple[Tie, ...]
    """Effects that the data cannot separate."""
    breaks_tie: tuple[Experiment, ...]
    """What to measure to separate them."""
    unobservable: Mapping[str, str]
    """Effects without signature in what was measured, and why."""
    where: tuple[MisfitShare, ...]
    """Cells of the heat map in which measured and simulated disagree most."""
    heat: HeatMap
    """Residual power by channel, run, phase and tension."""
    along: tuple[RouteMisfit, ...]
    """Fitted friction of each route beyond the model, along its length."""
    misfit: Misfit
    """Root mean squares of measured less simulated, before and after."""
    base: Mapping[str, Estimate]
    """`friction` and `compliance_per_N`, refitted, and zeros of channels by run."""
    nominal: Mapping[str, float]
    """`friction` and `compliance_per_N` as the rig file had them; not what is unknown there."""
    base_tie: str
    """What a refit of friction and compliance may stand for (G2, G3), in words; empty where they held."""
    ranking: tuple[Candidate, ...]
    """All candidates, the best first."""
    missing_shapes: tuple[Shape, ...]
    """Only where the verdict is unknown."""
    rig: Rig
    """With the chosen effects."""
    errors: RigErrors
    """Of its numbers that were fitted."""
    traces: tuple[Trace, ...]
    """Each run, measured and simulated."""
    notes: tuple[str, ...]
    """What to know of the data and the fit: dropouts, skew, saturation, which run was held out."""
    seconds: float
    """Time that the identification took [s]."""
    proposal: Proposal | None = None
    """Designed experiments, where they were asked for."""

    @property
    def unexplained(self) -> Unexplained:
        """What the updated rig leaves beyond the sensors' errors, of held-out runs where there are; (354)."""
        runs = self.misfit.after["held_out"] or self.misfit.after["fitted"]
        return Unexplained.beyond((name, rms, self.misfit.noise.get(name, 0.0)) for name, rms in runs.items())

    @property
    def is_machine(self) -> bool:
        """Whether it is of a machine, whose misfit has no map over phases and arc length."""
        return any(trace.drive is not None for trace in self.traces)
