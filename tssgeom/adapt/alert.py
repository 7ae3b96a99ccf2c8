"""What is known of a disagreement between readings and model, small enough to be sent on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Cause(NamedTuple):
    """A mechanism that may explain a disagreement."""

    mechanism: str
    """As of `tssgeom.adapt.diagnosis.Explanation`, and so are the others."""
    where: str
    probability: float
    sentence: str


@dataclass(frozen=True, slots=True)
class Alert:
    """A disagreement between readings and model, and what is known of it so far."""

    channel: str
    since: float
    """[s]"""
    phase: str
    """What the drive did when it began: `pulling`, `releasing` or `hold`."""
    explanations: tuple[Cause, ...] = ()
    """The likeliest first; none as long as they are not compared."""

    @property
    def mechanism(self) -> str:
        """The likeliest mechanism; empty as long as none is known."""
        return self.explanations[0].mechanism if self.explanations else ""

    @property
    def sentence(self) -> str:
        """It in words, with the likeliest mechanism where one is known."""
        begun = f"{self.channel} disagrees with the model since {self.since:.2f} s ({self.phase})"
        if not self.explanations:
            return begun
        first = self.explanations[0]
        said = f"{first.mechanism} ({first.where}), probability {first.probability:.2f}"
        return f"{begun}: {said}: {first.sentence}"
