"""One campaign that a benchmark of discovery is to make."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tests import bristle, campaigns


@dataclass(frozen=True, slots=True)
class Case:
    """One campaign to be made."""

    group: str
    """clean, single, half, quarter, pair, outside, partial, other drive, machine, or a tie."""
    effects: tuple[str, ...]
    """Of the second generator the one cause, in its own words."""
    size: float
    plan: str
    seed: int
    split: str
    generator: str = "first"

    def made(self, folder: Path) -> dict[str, Any]:
        """Write the campaign into a folder and return its truth."""
        if self.generator == "first":
            first = self.effects or None
            return asdict(campaigns.make_campaign(folder, self.seed, first, self.size, self.plan, self.split))
        cause = self.effects[0] if self.effects else ""
        return asdict(bristle.make_campaign(folder, self.seed, cause, self.size, self.plan, self.split))
