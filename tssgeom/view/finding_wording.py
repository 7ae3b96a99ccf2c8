"""Channels, phases, effects and numbers as people read them."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping

from tssgeom.core.constants import CHANCE
from tssgeom.effects import KINDS, AnyEffect, chosen
from tssgeom.identify.finding import (
    Candidate,
    Estimate,
    Evidence,
    Experiment,
    Finding,
    Misfit,
    MisfitShare,
    RigNumber,
    Tie,
)
from tssgeom.identify.machine_parts import MEANINGS
from tssgeom.identify.misfit import (
    UNINFORMATIVE,
    beyond_noise,
    held_out_change,
    shows_held_out_alone,
)
from tssgeom.identify.verdict import parameter, plain, times
from tssgeom.view.quantities import CHANNELS, Quantity, quantity

VERDICTS = {
    "none": "nothing is missing",
    "effect": "an effect is missing",
    "tie": "an effect is missing, and these data leave a choice",
    "law": "a law of its own is missing",
    "partial": "a part of what is missing has a name, something remains",
    "unknown": "something is missing that has no name here",
}


TOTAL = "ΔBIC, held-out runs included"
"""What candidates are ordered by, in tables and figures."""
_UNITS = {
    "m": ("mm", 1e3),
    "m/N": ("µm/N", 1e6),
    "1": ("", 1.0),
    "m/rad": ("mm/rad", 1e3),
    "m/s": ("mm/s", 1e3),
}


def channel(name: str) -> Quantity:
    """Return how a channel is displayed."""
    return quantity(name)


def renamed(label: str) -> str:
    """Write the channel at the beginning of a label as its symbol, and a phase as words."""
    for name, displayed in CHANNELS.items():
        if label.startswith(name):
            return f"{displayed.symbol}{label.removeprefix(name)}"
    phase, space, tensions = label.partition(" ")
    return f"{plain(phase)}{space}{tensions}"


def parameters(effect: AnyEffect | RigNumber, estimates: Mapping[str, Estimate]) -> dict[str, str]:
    """Write the numbers of an effect by name, then what was chosen, such as the end at which it acts."""
    numbers = {parameter(key): displayed(each) for key, each in estimates.items()}
    return numbers | {plain(key): plain(choice) for key, choice in chosen(effect).items()}


def meaning(name: str) -> str:
    """Return in a clause what an effect is."""
    if name in MEANINGS:
        return MEANINGS[name]
    if name not in KINDS:
        return f"a law of its own: {plain(name)}"
    first = (inspect.getdoc(KINDS[name]) or "").split("\n")[0]
    return first.partition("; docs/")[0].rstrip(".")


def displayed(each: Estimate) -> str:
    """Write a number with its 95 % interval and unit; one that was held is marked so."""
    unit, factor = _UNITS.get(each.unit, (each.unit, 1.0))
    value = number(factor * each.value, factor * (each.high - each.low))
    if not (math.isfinite(each.low) and math.isfinite(each.high)) or each.low == each.high:
        return f"{value} {unit}".rstrip() + " (held)"
    spread = factor * (each.high - each.low)
    return (
        f"{value} [{number(factor * each.low, spread)}, {number(factor * each.high, spread)}] {unit}".rstrip()
    )


def number(value: float, spread: float = math.nan) -> str:
    """Write a number with as many digits as its spread allows; of an unknown spread three."""
    if not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    if not math.isfinite(spread) or spread <= 0.0:
        return f"{value:.3g}"
    if abs(value) < 1e-2:
        return f"{value:.3g}"
    digits = max(0, min(6, 1 - math.floor(math.log10(spread))))
    return f"{value:.{digits}f}"


def significant(value: float, digits: int) -> str:
    """Write a number with so many significant digits, its last ones too where they are 0."""
    return f"{value:#.{digits}g}".rstrip(".")


def ratio(value: float) -> str:
    """Write a ratio; a dash where there is none."""
    return f"{value:.2f}" if math.isfinite(value) else "–"


def misfit_cell(misfit: MisfitShare) -> str:
    """Write in a line where measured and simulated disagree."""
    low, high = misfit.tension_range_N
    text = (
        f"{100 * misfit.share:.0f} % in {channel(misfit.channel).symbol} of {misfit.run}, "
        f"{plain(misfit.phase)}, {low:.1f} to {high:.1f} N"
    )
    if misfit.route_range_m is None:
        return text
    start, end = (1e3 * s for s in misfit.route_range_m)
    return f"{text}; points at {start:.0f} to {end:.0f} mm along the route"


def candidate(each: Candidate) -> str:
    """Write the names of a candidate; one of a channel with its channel."""
    pairs = [
        (plain(name), _channel_of(effect)) for name, effect in zip(each.names, each.effects, strict=True)
    ]
    return " + ".join(f"{name} of {quantity(channel).words}" if channel else name for name, channel in pairs)


def is_selected(finding: Finding, each: Candidate) -> bool:
    """Whether all of a candidate was selected; two numbers of one name differ by their channels."""
    selected = {
        (name, _channel_of(effect))
        for part in finding.effects
        for name, effect in zip(part.names, part.effects, strict=True)
    }
    own = {(name, _channel_of(effect)) for name, effect in zip(each.names, each.effects, strict=True)}
    return bool(selected) and selected >= own


def _channel_of(effect: AnyEffect | RigNumber) -> str:
    key = effect.key if isinstance(effect, RigNumber) else ""
    return key.split(".")[1] if key.startswith("sensors.") else ""


def effect_ties(finding: Finding) -> list[Tie]:
    """Return the ties between effects; those of friction and compliance stand with their refit."""
    return [tie for tie in finding.ties if all(name in KINDS or name in MEANINGS for name in tie.names)]


def next_steps(finding: Finding) -> list[str]:
    """Write what to measure next, a sentence each, by what was identified and where the misfit is."""
    steps = [_separating(each) for each in finding.breaks_tie if KINDS.keys() >= set(each.separates)]
    if finding.verdict == "unknown":
        steps += _toward_a_name(finding)
    before, after = held_out_change(finding.misfit)
    held = [trace for trace in finding.traces if trace.held_out]
    if not held and not finding.is_machine:
        steps.append(
            "Measure one more run, best on another route, with held_out = true: none was held out, so "
            "nothing yet shows that the result carries over."
        )
    elif finding.verdict != "unknown" and after > UNINFORMATIVE and after >= before:
        names = ", ".join(trace.run for trace in held)
        if finding.is_machine:
            return [*steps, f"Repeat {names}, and drive it otherwise: the misfit there stays."]
        steps.append(
            f"Repeat {names}, and add a fitted run on route {held[0].route}: the misfit there stays."
        )
    steps += _remainder(finding)
    if finding.verdict in ("unknown", "partial"):
        steps.append(
            "To use the rig meanwhile, take that of --with-errors, whose error bars hold what is left."
        )
    if not steps and finding.verdict == "tie" and (tied := effect_ties(finding)):
        names = " from ".join(plain(name) for name in tied[0].names[:2])
        designed = "--propose designs it" if finding.proposal is None else "the proposed runs are for that"
        steps.append(f"Measure a run that separates {names}: {designed}.")
    if not steps and finding.verdict == "law":
        asks = not finding.is_machine and finding.proposal is None
        more = "; --propose designs the next run" if asks else ""
        steps.append(f"Use the new rig within what the law was learnt from{more}.")
    if not steps and finding.effects and before <= UNINFORMATIVE:
        steps.append(
            "It is small: the runs that were not fitted are explained without it too. Measure a run that "
            "shows it, or keep the rig as it is."
        )
    return steps or [
        "Measure nothing more for this finding: the refitted model explains these runs."
        if finding.verdict == "none"
        else "These runs separate the effect from the others of the library: use the new rig."
    ]


def _remainder(finding: Finding) -> list[str]:
    """Write what the chosen effects leave, and where most is, where that is clearly beyond the noise."""
    misfit, group = finding.misfit, judged_runs(finding.misfit)
    rms = {name: each for name, each in misfit.after[group].items() if misfit.noise[name] > 0.0}
    before, after = (beyond_noise(side[group], misfit.noise) for side in (misfit.before, misfit.after))
    least = UNINFORMATIVE if group == "held_out" else CHANCE.clear
    if not finding.effects or not least < after < before:
        return []
    worst = max(rms, key=lambda name: rms[name] / misfit.noise[name])
    phases = misfit.by_phase.get(worst, {})
    where = channel(worst).symbol
    if phases:
        where += f" in the phase {plain(max(phases, key=lambda name: phases[name][1]))}"
    runs = "runs that were not fitted" if group == "held_out" else "the fitted runs"
    return [
        f"The new rig helps, but something remains: {times(after)} the noise on {runs}, most of it in "
        f"{where}. Vary one thing alone (tension, rate, route, cycles), and see whether that grows."
    ]


def total(evidence: Evidence) -> str:
    """Write the evidence for a candidate, held-out runs included [1]."""
    return f"{evidence.total:.0f}" if math.isfinite(evidence.total) else "contradicted"


def _separating(each: Experiment) -> str:
    text = f"{each.experiment[:1].upper()}{each.experiment[1:]}"
    return f"{text}: it separates {', '.join(map(plain, each.separates))} (expected ΔBIC {expected(each)})."


def proposed_steps(finding: Finding) -> list[str]:
    """Write what was designed, a sentence each; none where nothing was designed."""
    proposal = finding.proposal
    if proposal is None:
        return []
    steps = [proposal.sentence, *([proposal.in_the_way] if proposal.in_the_way else [])]
    for run in proposal.runs:
        steps.append(f"{run.name}, {run.route}: it {run.why}; proposed/{run.name}.csv.")
        steps += [f"{run.name}: {words}." for words in run.outcomes]
    return steps


_VARIED = {
    "tension_N": "the tension (half and twice the stroke)",
    "speed_m_per_s": "the rate (ten times slower and faster)",
    "curvature_per_m": "the radius of the bends at the same angle",
    "s_m": "the course of the route at the same angle",
    "cycle": "the number of cycles (five times as many)",
}


_WORTH_A_RUN = 0.1  # share of the misfit; chosen


def _toward_a_name(finding: Finding) -> list[str]:
    """Write what to vary, and where most of the misfit lies, where the verdict has no name."""
    steps = []
    if shows_held_out_alone(finding.misfit):
        names = ", ".join(trace.run for trace in finding.traces if trace.held_out)
        steps.append(
            f"Fit {names} too (held_out = false), and hold out another run: what no fitted run shows has "
            "no name."
        )
    best = max(finding.missing_shapes, key=lambda shape: shape.explains, default=None)
    if best is not None and best.explains > _WORTH_A_RUN:
        steps.append(
            f"Vary {_VARIED[best.over]} and nothing else: friction that depends on it explains "
            f"{100 * best.explains:.0f} % of the misfit."
        )
    if finding.where:
        steps.append(f"Examine the largest part of the misfit: {misfit_cell(finding.where[0])}.")
    return steps or ["Vary one thing alone (tension, rate, route, cycles), and compare the misfit."]


def expected(each: Experiment) -> str:
    """Write what an experiment is expected to bring; a dash where that is unknown beforehand."""
    return f"{each.expected_delta_bic:.0f}" if each.expected_delta_bic >= 1.0 else "–"


def judged_runs(misfit: Misfit) -> str:
    """Return which runs a misfit is judged by: those held out, else those fitted."""
    return "held_out" if misfit.before.get("held_out") else "fitted"
