"""Channels, phases, effects and numbers as people read them."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping

from tssgeom.effects import KINDS, Library, chosen
from tssgeom.identify.finding import Candidate, Estimate, Experiment, Finding, Misfit, MisfitShare, Tie
from tssgeom.identify.verdict import parameter, plain
from tssgeom.view.quantities import CHANNELS, Quantity

VERDICTS = {
    "none": "nothing is missing",
    "effect": "an effect is missing",
    "tie": "an effect is missing, and these data leave a choice",
    "unknown": "something is missing that has no name here",
}


_UNITS = {
    "m": ("mm", 1e3),
    "m/N": ("µm/N", 1e6),
    "1": ("", 1.0),
    "m/rad": ("mm/rad", 1e3),
    "m/s": ("mm/s", 1e3),
}


def channel(name: str) -> Quantity:
    """Return how a channel is shown."""
    return CHANNELS[name]


def renamed(label: str) -> str:
    """Write the channel at the beginning of a label as its symbol, and a phase as words."""
    for name, displayed in CHANNELS.items():
        if label.startswith(name):
            return f"{displayed.symbol}{label.removeprefix(name)}"
    return plain(label)


def parameters(effect: Library, estimates: Mapping[str, Estimate]) -> dict[str, str]:
    """Write the numbers of an effect by name, then what was chosen, such as the end at which it acts."""
    numbers = {parameter(key): displayed(each) for key, each in estimates.items()}
    return numbers | {plain(key): plain(choice) for key, choice in chosen(effect).items()}


def meaning(name: str) -> str:
    """Return in a clause what an effect is."""
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
    """Write the names of a candidate."""
    return " + ".join(plain(name) for name in each.names)


def effect_ties(finding: Finding) -> list[Tie]:
    """Return the ties between effects; those of friction and compliance stand with their refit."""
    return [tie for tie in finding.ties if all(name in KINDS for name in tie.names)]


def expected(each: Experiment) -> str:
    """Write what an experiment is expected to bring; a dash where that is unknown beforehand."""
    return f"{each.expected_delta_bic:.0f}" if each.expected_delta_bic >= 1.0 else "–"


def judged_runs(misfit: Misfit) -> str:
    """Tell which runs a misfit is judged by: those held out, else those fitted."""
    return "held_out" if misfit.before.get("held_out") else "fitted"


def beyond_noise(rms: Mapping[str, float], noise: Mapping[str, float]) -> float:
    """Return the misfit over channels: root mean of what is beyond the noise, in units of it [1]."""
    squares = [max((rms[name] / noise[name]) ** 2 - 1.0, 0.0) for name in rms if noise.get(name, 0.0) > 0.0]
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan
