"""The finding of a machine put together: effects, verdict, estimates, ranking and traces.

Source: docs/model.md (196)-(198).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.effects import AnyEffect
from tssgeom.identify.campaign import Campaign
from tssgeom.identify.finding import (
    Candidate,
    Estimate,
    Evidence,
    Experiment,
    Finding,
    HeatMap,
    LawCurve,
    Misfit,
    RigNumber,
    Tie,
    Trace,
    Verdict,
)
from tssgeom.identify.machine_estimates import MachineCalibration, calibration_of
from tssgeom.identify.machine_evidence import (
    FittedModel,
    changes,
    delta_bic,
    held_out_ratio,
    held_out_rises,
    noise_of,
    own_numbers,
)
from tssgeom.identify.machine_parts import Part, absent_parts
from tssgeom.identify.machine_prediction import finely_predicted
from tssgeom.identify.machine_problem import FIT
from tssgeom.identify.machine_refit import reordered, without_part
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.machine_selection import PartSelection
from tssgeom.identify.machine_steps import PartStep, TriedPart
from tssgeom.identify.misfit import beyond_noise
from tssgeom.identify.verdict import Judgement, remainder, sentence, times
from tssgeom.rig import Rig, with_values
from tssgeom.statistics import EVIDENCE_SCALE
from tssgeom.tendon.machine_simulation import drive_channels
from tssgeom.uncertain import Uncertain

_NAMES = {"friction.coefficient": "friction", "tendon.compliance_per_N": "compliance_per_N"}


@dataclass(frozen=True, slots=True)
class MachineCampaign:
    """What `discover` is given of a machine."""

    name: str
    rig: Rig
    """With the centre of what is assumed where a number is not certain."""
    uncertain: tuple[Uncertain, ...]
    runs: tuple[MachineRun, ...]
    held_out: tuple[str, ...] = ()
    """Names of runs that the user keeps from every fit."""
    notes: tuple[str, ...] = ()
    in_cycles: str = ""
    """The run of which every other cycle stays held out, where it was the only one before others came."""


@dataclass(frozen=True, slots=True)
class NamedZero:
    """The zero of a channel that is named."""

    channel: str
    evidence: Evidence


@dataclass(frozen=True, slots=True)
class MachineWork:
    """What the steps left."""

    campaign: MachineCampaign
    fitted: tuple[MachineRun, ...]
    kept: tuple[MachineRun, ...]
    base: FittedModel
    chosen: PartSelection
    zeros: tuple[NamedZero, ...]

    @property
    def nominal(self) -> dict[str, float]:
        """Friction and compliance as the rig file has them; not what is unknown there."""
        unknown = {each.key for each in self.campaign.uncertain if not each.stated}
        rig = self.campaign.rig
        values = (rig.friction.coefficient, rig.tendon.compliance_per_N)
        pairs = zip(_NAMES.items(), values, strict=True)
        return {name: value for (key, name), value in pairs if key not in unknown}

    @property
    def taken(self) -> list[PartStep]:
        """The steps whose part the model has in the end."""
        has = {part.label for part in self.chosen.model.parts}
        steps = ((step, step.chosen) for step in self.chosen.steps)
        return [step for step, best in steps if best is not None and best.part.label in has]

    def finding(self, notes: Sequence[str]) -> Finding:
        """Return the finding."""
        model = self.chosen.model
        noise = noise_of((self.base, model), self.campaign.rig)
        misfit = Misfit(
            noise,
            {"fitted": self.base.fitted, "held_out": self.base.held},
            {"fitted": model.fitted, "held_out": model.held},
            {},
        )
        after = calibration_of(model.problem, model.state)
        base = dict(_base_numbers(after, model))
        effects = (*self._parts(after), *self._named_zeros(after))
        effects = tuple(sorted(effects, key=lambda one: -one.evidence.total))
        close = [other.part for step in self.taken for other in step.tied]
        left = _left(misfit, "after")
        verdict = self._verdict(effects, close, left)
        text = sentence(verdict, effects, base, [part.label for part in close], misfit)
        if effects and left > CHANCE.clear:
            text = f"{text} {remainder(left)}"
        rig = self._rig(after, effects)
        return Finding(
            campaign=Campaign(self.campaign.name, self.campaign.rig, (), self.campaign.notes),
            verdict=verdict.verdict,
            sentence=text,
            effects=effects,
            ties=tuple(self._ties()),
            breaks_tie=tuple(_experiments(close, effects)),
            unobservable=absent_parts(self.campaign.rig, self.fitted),
            where=(),
            heat=HeatMap((), (), np.zeros((0, 0))),
            along=(),
            misfit=misfit,
            base=base,
            nominal=self.nominal,
            base_tie=" ".join(f"{each}." for each in after.tied),
            ranking=tuple(self._ranking()),
            missing_shapes=(),
            rig=rig,
            errors=after.errors,
            traces=tuple(self._traces(noise)),
            notes=(*notes, *_how_counted()),
            seconds=0.0,
        )

    def _verdict(self, effects: Sequence[Candidate], close: Sequence[Part], left: float) -> Judgement:
        learnt = any(one.law is not None for one in effects)
        remains = left > CHANCE.clear
        if effects:
            name: Verdict = "tie" if close else "law" if learnt else "partial" if remains else "effect"
            return Judgement(name, "", False)
        if not remains:
            return Judgement("none", "", False)
        refused = [one for one in self.chosen.steps[0].tried if one.evidence > EVIDENCE_SCALE.very_strong]
        why = f"; of {refused[0].part.label}: {refused[0].why_not.rstrip('.')}" if refused else ""
        reason = f"{times(left)} the noise of the channels is left, and no part that may act explains it{why}"
        return Judgement("unknown", reason, False)

    def _parts(self, after: MachineCalibration) -> Iterator[Candidate]:
        model = self.chosen.model
        effects = iter(model.rig.effects[len(self.campaign.rig.effects) :])  # laws are behind these
        for which, part in enumerate(model.parts):
            evidence = self._added(which)
            if part.laws:
                own = model.problem.law_effects(model.state.u)[part.name]
                curve = self._with_nearest(after.laws[part.name], part)
                yield Candidate((part.name.partition(":")[0],), (own,), ({},), evidence, "", curve)
                continue
            for effect, numbers in _by_effect(part, after, None if part.of_rig else next(effects)):
                yield Candidate((part.name,), (effect,), (numbers,), evidence, "")

    def _with_nearest(self, curve: LawCurve, part: Part) -> LawCurve:
        """Return a law with the formulae of its mechanism that were tried, and the evidence they lack."""
        tried = {one.part.label: one for step in self.chosen.steps for one in step.tried}
        formulae = [one for one in tried.values() if one.part.mechanism == part.name]
        own = tried[part.label].delta_bic
        return replace(curve, nearest=tuple((one.part.name, own - one.delta_bic) for one in formulae))

    def _added(self, which: int) -> Evidence:
        """Return the evidence that a part adds to the others."""
        model = self.chosen.model
        less = without_part(model, which, self.kept)
        if less is None:
            return Evidence(math.inf, EVIDENCE_SCALE.very_strong, math.inf, math.nan)
        whole = reordered(model, which)
        size = max(changes(less, whole).values())
        gain, ratio = delta_bic(less, whole), held_out_ratio(less, whole)
        fall = -sum(held_out_rises(less, whole).values())
        return Evidence(gain, EVIDENCE_SCALE.very_strong, size, ratio, fall)

    def _named_zeros(self, after: MachineCalibration) -> Iterator[Candidate]:
        for zero in self.zeros:
            numbers = {"zero": _zero_estimate(after, zero.channel)}
            key = RigNumber(key=f"sensors.{zero.channel}.zero")
            yield Candidate(("channel_zero",), (key,), (numbers,), zero.evidence, "")

    def _rig(self, after: MachineCalibration, effects: Sequence[Candidate]) -> Rig:
        """Return the rig with parts and named zeros."""
        zeros = {
            one.effects[0].key: one.parameters[0]["zero"].value
            for one in effects
            if one.names == ("channel_zero",) and isinstance(one.effects[0], RigNumber)
        }
        return with_values(after.rig, zeros)

    def _ties(self) -> Iterator[Tie]:
        for step in self.taken:
            best = step.chosen
            if best is not None and step.tied:
                names = (best.part.name, *(one.part.name for one in step.tied))
                yield Tie(names, "profile", "in these runs they do the same, held-out readings included.")

    def _ranking(self) -> Iterator[Candidate]:
        named = {part.label for part in self.chosen.model.parts}
        laws = (one for step in self.chosen.steps for one in step.tried if one.part.laws)
        tried = {one.part.label: one for one in (*self.chosen.steps[0].tried, *laws)}
        top = max((one.evidence for one in tried.values()), default=0.0)
        for one in sorted(tried.values(), key=lambda each: -each.evidence):
            yield _ranked(one, top, chosen=one.part.label in named)

    def _traces(self, noise: Mapping[str, float]) -> Iterator[Trace]:
        models = (self.base, self.chosen.model)
        for k, run in enumerate(self.fitted):
            numbers = [one.problem.of_run(one.state.u, k) for one in models]
            pairs = zip(models, numbers, strict=True)
            both = [finely_predicted(run, one.rig, own, one.problem.fine, FIT.bars) for one, own in pairs]
            if not run.held_out.any():
                yield _trace(run, both, noise, run.name, held=False)
                continue
            for held in (False, True):
                name = f"{run.name}, held-out cycles" if held else run.name
                yield _trace(run, both, noise, name, held=held)
        for run in self.kept:
            both = []
            for one in models:
                on = one.on_known_routes(run)
                own, there = own_numbers(on, one.rig, one.fixed, one.problem.fine)
                of_run = own.of_run(there.u, 0)
                both.append(finely_predicted(on, one.rig, of_run, own.fine, FIT.bars))
            yield _trace(replace(run, held_out=~run.held_out), both, noise, run.name, held=True)


def _trace(
    run: MachineRun,
    both: Sequence[Mapping[str, Vector]],
    noise: Mapping[str, float],
    name: str,
    *,
    held: bool,
) -> Trace:
    """Return one run as two models have it; readings that do not belong to it are missing."""
    count, drive = len(run.given["time_s"]), drive_channels(run.drive, run.tendons)[0]
    own = run.held_out == held
    return Trace(
        run=name,
        route="",
        held_out=held,
        time=run.given["time_s"],
        phase=np.zeros(count, dtype=int),
        tension_in=run.given[drive],
        measured={key: np.where(own, values, np.nan) for key, values in run.measured.items()},
        before=dict(both[0]),
        after=dict(both[1]),
        sigma={key: np.full(count, noise[key]) for key in run.measured},
        tension=np.zeros((count, 0)),
        drive=(drive, run.given[drive]),
    )


def _left(misfit: Misfit, when: str) -> float:
    """Return what is left beyond the noise, on held-out readings where there are any [1]."""
    rms = getattr(misfit, when)
    return beyond_noise(rms["held_out"] or rms["fitted"], misfit.noise)


def _by_effect(
    part: Part, after: MachineCalibration, effect: AnyEffect | None
) -> Iterator[tuple[AnyEffect | RigNumber, dict[str, Estimate]]]:
    """Yield an effect with its numbers, or each number of the rig that is the part's one number."""
    by_name = {each.name: each for each in after.estimates}
    made = dict[str, Estimate]()
    for number in part.numbers:
        each = by_name[f"{part.label}: {number.name}"]
        low, high = (min(max(value, number.lower), number.upper) for value in (each.low, each.high))
        made[number.name] = Estimate(each.value, each.unit, low, high)
    if effect is not None:
        yield effect, made
    for key in sorted(part.of_rig):
        yield RigNumber(key=key), made


def _zero_estimate(after: MachineCalibration, channel: str) -> Estimate:
    """Return the zero of a channel, a mean over runs."""
    name = f"zero of {channel}"
    those = [each for each in after.estimates if each.name == name or each.name.startswith(f"{name} of ")]
    value = float(np.mean([each.value for each in those]))
    half = float(np.mean([0.5 * (each.high - each.low) for each in those])) / math.sqrt(len(those))
    return Estimate(value, those[0].unit, value - half, value + half)


def _base_numbers(after: MachineCalibration, model: FittedModel) -> Iterator[tuple[str, Estimate]]:
    own = {f"{part.label}: {number.name}" for part in model.parts for number in part.numbers}
    stated = [each for each in after.estimates if each.key and each.name not in own]
    for each in sorted(stated, key=lambda one: one.key not in _NAMES):
        yield _NAMES.get(each.key, each.key), Estimate(each.value, each.unit, each.low, each.high)


def _ranked(one: TriedPart, top: float, *, chosen: bool) -> Candidate:
    after = calibration_of(one.model.problem, one.model.state, normal=True)  # profiles of all take long
    if one.part.laws:
        effects, numbers = (one.model.rig.effects[-1],), ({},)
    else:
        own = None if one.part.of_rig else one.model.rig.effects[-1]
        effects, numbers = zip(*_by_effect(one.part, after, own), strict=True)
    evidence = Evidence(one.delta_bic, EVIDENCE_SCALE.very_strong, one.size, one.held_ratio, -one.rise)
    less = f"its ΔBIC, held-out readings included, is {top - one.evidence:.0f} below the best."
    why = "" if chosen else one.why_not or less
    return Candidate((one.part.name,) * len(effects), effects, numbers, evidence, why)


def _experiments(close: Sequence[Part], effects: Sequence[Candidate]) -> Iterator[Experiment]:
    names = [one.names[0] for one in effects]
    for part in close:
        for tie in getattr(part.effect, "ties", ()):
            if set(tie.partners) & set(names):
                yield Experiment(tie.breaks, 0.0, (part.name, *set(tie.partners) & set(names)))


def _how_counted() -> tuple[str, ...]:
    return (
        "ΔBIC counts as many readings of each channel as are independent in what the better model leaves "
        "(1 + 2 Σ of its autocorrelation readings count as one).",
    )
