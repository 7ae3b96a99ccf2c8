"""The verdict in a sentence, with its numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from tssgeom.identify.finding import Candidate, Estimate
from tssgeom.identify.verdict import Judged

_UNIT_AT_END = re.compile(r"(_(m|rad|N|Ns|s))?(_per_\w+)?$")
_PREFIXES = ((1e-6, "µ"), (1e-3, "m"), (1.0, ""), (1e3, "k"))


def sentence(
    judged: Judged, effects: Sequence[Candidate], base: Mapping[str, Estimate], tied: Sequence[str]
) -> str:
    """Return what was found in one sentence."""
    if judged.verdict == "none":
        return (
            "No effect is missing: friction "
            f"{number(base['friction'])} and compliance {number(base['compliance_per_N'])} leave no more "
            "than the sensors explain."
        )
    if judged.verdict == "unknown":
        return f"Something is missing that has no name here: {judged.reason}."
    parts = " and ".join(_effect(one) for one in effects)
    told = f"The model lacks {parts}"
    if judged.verdict == "tie":
        told += f", or {', '.join(tied)}, which these readings cannot tell apart"
    if not math.isnan(judged.held_ratio):
        told += f"; with it the gap on what was held out falls to {100.0 * judged.held_ratio:.0f} % of before"
    return told + "."


def plain(name: str) -> str:
    """Write a name of the library or of a phase as words."""
    return name.replace("_", " ")


def parameter(key: str) -> str:
    """Write the name of a parameter without the unit at its end."""
    return plain(_UNIT_AT_END.sub("", key))


def _effect(one: Candidate) -> str:
    told = ", ".join(f"{parameter(key)} {number(value)}" for key, value in one.parameters[0].items())
    choice = "".join(
        f", {key} {plain(getattr(one.effects[0], key))}"
        for key in ("channel", "end")
        if hasattr(one.effects[0], key)
    )
    return f"{one.names[0]} ({told}{choice})"


def number(told: Estimate) -> str:
    """Return an estimate with the half of its interval, in a unit that reads well."""
    half = 0.5 * (told.high - told.low)
    scale, prefix = 1.0, ""
    if told.unit in ("m", "s") and told.value:
        for factor, letter in _PREFIXES:
            if abs(told.value) >= factor:
                scale, prefix = factor, letter
    unit = "" if told.unit == "1" else f" {prefix}{told.unit}"
    digits = 1 - math.floor(math.log10(half / scale)) if half > 0.0 else 3
    if abs(told.value / scale) >= 1e-2 and 0 <= digits <= 6:
        return f"{told.value / scale:.{digits}f} ± {half / scale:.{digits}f}{unit}"
    return f"{told.value / scale:.3g} ± {half / scale:.1g}{unit}"


def why_not(one: Candidate, best: float, needed: float) -> str:
    """Return why a candidate was passed over."""
    told = one.evidence
    if told.delta_bic < needed:
        return f"its ΔBIC of {told.delta_bic:.1f} is below the {needed:.1f} that clean campaigns reach."
    if told.size_over_guard <= 1.0:
        return (
            f"it changes no channel by more than {told.size_over_guard:.2g} of what the sensors could fake."
        )
    return f"its ΔBIC is {best - told.delta_bic:.1f} below the best."
