"""Shapes on disk, and the command line in this process."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from pipelines.cli import main


class Outcome(NamedTuple):
    status: int
    out: str
    errors: list[str]
    """Lines on stderr that are errors, not progress."""


Run = Callable[..., Outcome]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Run the program as the console script does."""

    def run_command(*arguments: str | Path) -> Outcome:
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        errors = [line for line in captured.err.splitlines() if line.startswith("tssgeom: ")]
        return Outcome(int(ended.value.code or 0), captured.out, errors)

    return run_command


def half_circle(length: float = 500.0, count: int = 40) -> np.ndarray:
    """Points on a half circle, in the unit of `length`."""
    angle = np.linspace(0.0, math.pi, count)
    return length / math.pi * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


WriteCsv = Callable[..., Path]


@pytest.fixture
def write_csv(tmp_path: Path) -> WriteCsv:
    """Write points, or points with further columns, as CSV."""

    def write(name: str, points: np.ndarray, header: str = "x_mm,y_mm,z_mm") -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, points, delimiter=",", header=header, comments="", fmt="%.17g")
        return path

    return write


@pytest.fixture
def half(write_csv: WriteCsv) -> Path:
    """A half circle of 500 mm."""
    return write_csv("half.csv", half_circle())


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Five frames of a half circle, pulled to 15 N and released to 10 N; the third line is broken."""
    lines = []
    for time, tension in enumerate((0.0, 7.5, 15.0, 12.0, 10.0)):
        points = [[round(x, 6) for x in point] for point in half_circle(count=12).tolist()]
        lines.append(f'{{"t": {time}, "points": {points}, "unit": "mm", "tension_in_N": {tension}}}')
    lines.insert(2, '{"t": 1.5, "points": [[1,2')
    path = tmp_path / "pull.jsonl"
    path.write_text("\n".join(lines) + "\n")
    return path
