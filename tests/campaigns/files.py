"""The files of a campaign, in plain text."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

Run = tuple[str, str, bool, Mapping[str, np.ndarray]]
"""Name, shape file, whether held out, columns."""
_DECIMALS = {"time_s": 6, "tension_in_N": 4, "tension_out_N": 4, "temperature_C": 3}


def write(
    folder: Path,
    texts: Mapping[str, str],
    runs: Sequence[Run],
    shapes: Mapping[str, tuple[np.ndarray, str, bool]],
) -> None:
    """Write texts, runs and shapes, and the `campaign.toml` that lists them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name, (points, unit, reported) in shapes.items():
        header = [f"{axis}_{unit}" for axis in ("xyzs" if reported else "xyz")]
        _table(folder / name, header, points.T, [4 if unit == "mm" else 7] * len(header))
    write_runs(folder, runs)
    (folder / "campaign.toml").write_text(_campaign(runs), encoding="utf-8")


def write_runs(folder: Path, runs: Sequence[Run]) -> None:
    """Write the data files of runs."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, _, _, columns in runs:
        decimals = [_DECIMALS.get(column, 7) for column in columns]
        _table(folder / f"{name}.csv", list(columns), np.array(list(columns.values())), decimals)


def _table(file: Path, header: Sequence[str], columns: np.ndarray, decimals: Sequence[int]) -> None:
    np.savetxt(
        file,
        columns.T,
        delimiter=",",
        header=",".join(header),
        comments="",
        fmt=[f"%.{digits}f" for digits in decimals],
        encoding="utf-8",
    )


def _campaign(runs: Sequence[Run]) -> str:
    parts = ['rig = "rig.toml"\n']
    parts += [
        f'\n[[run]]\nname = "{name}"\ndata = "{name}.csv"\nshape = "{shape}"\n'
        f"held_out = {str(held).lower()}\n"
        for name, shape, held, _ in runs
    ]
    return "".join(parts)
