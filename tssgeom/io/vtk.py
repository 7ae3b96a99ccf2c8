"""VTK poly data, `.vtp`: each poly line a shape; needs the extra `[vtk]`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tssgeom.arrays import Points, read_only
from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.parts import chosen, split, stem
from tssgeom.io.recording import Recording
from tssgeom.io.units import PER_METRE, agreed_unit
from tssgeom.stream import Frame

UNIT = "unit"
"""Field array that states the unit of length; VTK itself knows none."""


def line_names(file: Path) -> list[str]:
    """Return the numbers of the poly lines in a file, from "1".

    Raises
    ------
    ShapeError, SourceError
        Where the file holds no poly line or cannot be read.
    """
    return [str(number) for number, _ in enumerate(_lines(file, _read(file)), start=1)]


def open_vtp(path: Path, unit: str | None) -> Recording:
    """Open one poly line of a file.

    Raises
    ------
    ShapeError
        Where there is no poly line, where there are several and none is named, or where no unit is stated.
    SourceError
        Where the file cannot be read, or the extra is not installed.
    """
    file, _ = split(path)
    data = _read(file)
    lines = _lines(file, data)
    agreed = agreed_unit(path, _stated_unit(data), unit, f"add a field array {UNIT!r} that says mm or m")
    names = [str(number) for number in range(1, len(lines) + 1)]
    points = lines[chosen(path, names)] / PER_METRE[agreed]
    points[np.isnan(points).any(axis=1)] = np.nan
    return Recording(stem(path), path, agreed, "vtk", False, 1, (Frame(read_only(points)),))


def _read(file: Path) -> Any:
    """Return the poly data of a file."""
    try:
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader
    except ImportError as error:
        raise SourceError(f"{file}: .vtp files need VTK: pip install 'tssgeom[vtk]'") from error
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(file))
    with _complaints() as complaints:
        reader.Update()
    if told := complaints():
        raise SourceError(f"{file}: cannot be read as poly data ({told}): write it with VTK anew")
    return reader.GetOutput()


@contextmanager
def _complaints() -> Iterator[Any]:
    """Catch what VTK would print; the value is a function that returns the first complaint."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    before, window = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    loud = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield lambda: _first_complaint(window.GetOutput())
    finally:
        vtkLogger.SetStderrVerbosity(loud)
        vtkOutputWindow.SetInstance(before)


def _first_complaint(text: str) -> str:
    """Return the first line with words of a message, without the place in VTK's own code."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    told = next((line for line in lines if not line.startswith(("ERROR: In", "Warning: In"))), "")
    return (told.partition("): ")[2] or told).rstrip(".")[:200] or " ".join(lines)[:200]


def _lines(file: Path, data: Any) -> list[Points]:
    """Return the points of each poly line [n, 3], in the unit of the file."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    cells = data.GetLines()
    if data.GetPoints() is None or not cells.GetNumberOfCells():
        raise ShapeError(f"{file}: no poly line in it: write the route as one line through its points")
    points = vtk_to_numpy(data.GetPoints().GetData()).astype(np.float64)
    ends = vtk_to_numpy(cells.GetOffsetsArray())
    through = vtk_to_numpy(cells.GetConnectivityArray())
    if through.size and not 0 <= through.min() <= through.max() < len(points):
        raise ShapeError(f"{file}: a line goes through point {through.max()} of {len(points)}: write it anew")
    lines = [points[through[a:b]] for a, b in pairwise(ends)]
    return [line for line in lines if len(line)] or [points[:0]]


def _stated_unit(data: Any) -> str | None:
    array = data.GetFieldData().GetAbstractArray(UNIT)
    if array is None or not array.GetNumberOfValues() or not array.IsA("vtkStringArray"):
        return None
    return str(array.GetValue(0))
