"""Settings of `tssgeom discover` for further experiments: limits, and folders of new runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tssgeom.identify.campaign import Campaign
    from tssgeom.identify.proposal import Asked
    from tssgeom.io.formats.laboratory.mapping import ColumnMap


def asked(runs: int | None, limits: Sequence[str]) -> Asked | None:
    """Return how many experiments are asked for, and within which limits; None where none is.

    Raises
    ------
    SettingsError
        Where a limit is no `key=value`, or no experiment is asked for.
    """
    from tssgeom.errors import SettingsError
    from tssgeom.identify.proposal import Asked

    words = [word for text in limits for word in text.replace(",", " ").split()]
    if runs is None:
        if words:
            raise SettingsError(f"--limits {words[0]}: it limits proposed runs: add --propose N")
        return None
    return Asked(runs, dict(_limit(word) for word in words))


def _limit(word: str) -> tuple[str, float]:
    from tssgeom.errors import SettingsError

    key, _, text = word.partition("=")
    try:
        return key, float(text)
    except ValueError as error:
        raise SettingsError(
            f'--limits {word}: give key=value, such as "tension_N=20 duration_s=60"'
        ) from error


def check_folders(out: Path, more: Sequence[Path], *, proposes: bool) -> None:
    """Refuse to write proposals over measured runs.

    Raises
    ------
    SettingsError
        Where a folder of new runs is the one that proposals are written to.
    """
    from tssgeom.errors import SettingsError
    from tssgeom.io.results.proposals import FOLDER

    for folder in more:
        if proposes and folder.resolve() == (out / FOLDER).resolve():
            raise SettingsError(
                f"--with {folder}: --propose would write over these runs: move them, or give another --out"
            )


def joined(
    campaign: Campaign, more: Sequence[Path], out: Path, unit: str | None, columns: ColumnMap
) -> Campaign:
    """Return a campaign with the new runs; `out` may hold the proposal that they follow.

    Raises
    ------
    SettingsError, ShapeError, SourceError
        Where a folder has no run, or one cannot be used.
    """
    from tssgeom.io.formats.joined_campaigns import PROPOSAL, with_runs
    from tssgeom.io.results.proposals import FOLDER

    for folder in more:
        campaign = with_runs(campaign, folder, unit, columns, (out / FOLDER / PROPOSAL,))
    return campaign
