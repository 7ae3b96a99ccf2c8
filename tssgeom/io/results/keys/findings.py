"""The object of `discover --json` and `report.json`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NotRequired, TypedDict

from tssgeom.identify.finding import Experiment, MisfitShare, RouteMisfit, Shape
from tssgeom.identify.proposal import ExpectedEvidence, NarrowedInterval


class Number(TypedDict):
    """A number with its 95 % interval."""

    value: float | None
    """Estimate, in `unit`."""
    unit: str
    """Unit of value and interval."""
    ci95: list[float | None]
    """95 % interval, in `unit`; null where it is not bounded."""


class BaseNumber(Number):
    """A number of the rig that is refitted."""

    nominal: NotRequired[float]
    """Value in the rig before, in `unit`."""


class EvidenceOf(TypedDict):
    """Evidence for an effect."""

    delta_bic: float | None
    """Fall of the Bayesian information criterion with the effect [1]."""
    held_out_fall: float | None
    """Fall of χ² of the held-out runs with the effect [1]; null where they contradict it."""
    threshold: float | None
    """Fall that the best of the library reaches on 1 % of campaigns without an effect [1]."""
    size_over_guard: float | None
    """Largest change of a channel by the effect over the detection limit of its sensor [1]."""
    heldout_ratio: float | None
    """Misfit on held-out runs with the effect over that without it [1]."""


class NearestFormula(TypedDict):
    """A formula of the library that is compared with a law."""

    formula: str
    """Name of the effect."""
    log_evidence: float | None
    """Log evidence less that of the law [1]."""


class Law(TypedDict):
    """A law over what it depends on."""

    over: str
    """Name and unit of `x`."""
    x: list[float]
    """Where the law is evaluated, in SI."""
    value: list[float | None]
    """The law there, in `unit`."""
    lo: list[float | None]
    """Lower end of the 95 % band, in `unit`."""
    hi: list[float | None]
    """Upper end of the 95 % band, in `unit`."""
    unit: str
    """Unit of the law."""
    nearest: list[NearestFormula]
    """Formulae of the library for the same mechanism."""


class EffectOf(TypedDict):
    """An effect or law with its numbers."""

    name: str
    """Effect of the library, or number of the rig."""
    mechanism: str
    """What acts, independent of the formula."""
    formula: str | None
    """Effect of the library whose formula it is; null for a law."""
    law: Law | None
    """The curve, where no formula of the library has it."""
    parameters: dict[str, Number]
    """Numbers of the effect, by name."""
    choices: dict[str, str]
    """What is chosen and no number, such as the end at which it acts."""


class SelectedEffect(EffectOf):
    """An effect that is selected."""

    evidence: EvidenceOf
    """Evidence for the whole selected set."""


class TieOf(TypedDict):
    """Why the data cannot separate effects."""

    gauge: str
    """Its name in docs/model.md; `profile` where only these data cannot separate them."""
    why: str
    """One sentence."""


class NewRoute(TypedDict):
    """Another route, as pieces of constant curvature."""

    length_m: list[float]
    """Length of each piece [m]."""
    angle_rad: list[float]
    """Curve angle of each piece [rad]."""


class Proposed(TypedDict):
    """One proposed run."""

    data: str
    """File of its drive, in `proposed/`."""
    route: str
    """Route of the campaign, or how to bend the sheath."""
    like: str
    """Run of the campaign that it resembles."""
    new_route: NewRoute | None
    """Pieces of another route; null on a route of the campaign."""
    drive: str | list[str]
    """Channel that drives, such as `displacement_in_m` or `tension_in_N`; a list where several do."""
    corner_time_s: list[float]
    """Times of the corners of the drive [s]."""
    corners: list[float | list[float]]
    """Drive at the corners, in m, N, rad or N·m; a list for each of several drives."""
    why: str
    """Why this run."""
    outcomes: list[str]
    """What each outcome would mean."""
    expected: Sequence[ExpectedEvidence]
    """Evidence for each pair of candidates."""


class ProposalObject(TypedDict):
    """Runs that are proposed, with `--propose`."""

    sentence: str
    """The proposal in one sentence."""
    candidates: list[str]
    """Models that the runs are to separate."""
    limits: dict[str, float]
    """Limits of the runs; each key states its unit."""
    stated_limits: list[str]
    """Limits that the user stated; the others are those of the campaign."""
    in_the_way: str
    """The limit that stands against more, in a sentence; empty where none does."""
    narrowed: NarrowedInterval | None
    """Number whose interval is to narrow; null where models are to be separated."""
    runs: list[Proposed]
    """The runs."""


class PhaseMisfit(TypedDict):
    """Misfit of a channel in a phase, in the unit of the channel."""

    before: float | None
    """With the rig as given."""
    after: float | None
    """With the updated rig."""


class MisfitOf(TypedDict):
    """Misfit (rms) by channel, in the unit of the channel."""

    noise: dict[str, float | None]
    """Noise of each channel."""
    before: dict[str, dict[str, float | None]]
    """With the rig as given: of runs that are `fitted` and `held_out`, by channel."""
    after: dict[str, dict[str, float | None]]
    """The same with the updated rig."""
    by_phase: dict[str, dict[str, PhaseMisfit]]
    """By channel and phase, over all runs."""


class RankedCandidate(TypedDict):
    """A candidate that was compared."""

    name: str
    """Its effects, joined by ` + `."""
    effects: list[EffectOf]
    """Each with its numbers."""
    evidence: EvidenceOf
    """Evidence for it."""
    why_not: str
    """Why it was passed over; empty for what was selected."""


class RunOf(TypedDict):
    """A run of the campaign."""

    name: str
    """Name of the run."""
    route: str
    """Name of its route."""
    held_out: bool
    """True where it is kept from the fit."""
    samples: int
    """Samples [1]."""


class Report(TypedDict):
    """What the campaign shows."""

    version: str
    """Version of tssgeom."""
    campaign: str
    """Name of the campaign."""
    verdict: str
    """`none`, `effect`, `law`, `tie`, `partial` or `unknown`."""
    sentence: str
    """The verdict in one sentence."""
    effects: list[SelectedEffect]
    """Effects that are selected."""
    tie: list[list[str]]
    """Effects that the data cannot separate."""
    tie_why: list[TieOf]
    """Why, in the order of `tie`."""
    breaks_tie: Sequence[Experiment]
    """Experiments that would separate them."""
    proposed: ProposalObject | None
    """Runs that are proposed; null without `--propose`."""
    unobservable: list[str]
    """Effects that these channels cannot show."""
    unobservable_why: dict[str, str]
    """Why, by effect."""
    where: Sequence[MisfitShare]
    """Where measured and simulated disagree, the largest share first."""
    along_route: Sequence[RouteMisfit]
    """Friction beyond the model, along each route."""
    gap: MisfitOf
    """Misfit before and after."""
    base: dict[str, BaseNumber]
    """Numbers of the rig that are refitted, by name."""
    base_tie: str
    """What a change of friction may stand for as well."""
    missing_shapes: Sequence[Shape]
    """Friction that is missing, where the verdict is `unknown`."""
    ranking: list[RankedCandidate]
    """All candidates, the best first."""
    rig: str
    """File of the updated rig."""
    runs: list[RunOf]
    """Runs of the campaign."""
    notes: list[str]
    """What is worth knowing about the data."""
    seconds: float
    """Computing time [s]."""
