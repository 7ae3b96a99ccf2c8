"""What every result offers to a notebook: one line, a small table, a plot, tables of other libraries, files.

A result knows no table, text or picture. `tssgeom.api.presentation` knows those of each class, and is
imported when one is asked for: programs without a notebook do not load it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

_PRESENTATION, _FILES = "tssgeom.api.presentation", "tssgeom.api.files"


class Result:
    """A result that a notebook can show, plot, take as a table, and save."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Return one line: the main numbers with units, rounded to their standard errors."""
        return import_module(_PRESENTATION).line(self)

    def _repr_html_(self) -> str:
        """Return the same numbers as a small HTML table."""
        return import_module(_PRESENTATION).html_table(self)

    def plot(self, axes: Any = None, what: str | None = None) -> Any:
        """Draw the result with matplotlib.

        Parameters
        ----------
        axes
            `matplotlib.axes.Axes` to draw on; by default those of a new figure. Or the name of a plot.
        what
            What to draw; by default the first of `plots`.

        Returns
        -------
        matplotlib.axes.Axes
            The axes of the plot.

        Raises
        ------
        SettingsError
            Where the result has no plot of this name.
        """
        return import_module(_PRESENTATION).plot(self, axes, what)

    @property
    def plots(self) -> tuple[str, ...]:
        """Names of what `plot` can draw, the default first."""
        return import_module(_PRESENTATION).plots(self)

    def to_arrow(self) -> Any:
        """Return the result as a `pyarrow.Table`; each column has its unit and meaning as metadata."""
        return import_module(_PRESENTATION).table(self)

    def to_pandas(self) -> Any:
        """Return the result as a `pandas.DataFrame`.

        Raises
        ------
        SettingsError
            Where pandas is not installed.
        """
        return import_module(_FILES).to_pandas(self)

    def to_polars(self) -> Any:
        """Return the result as a `polars.DataFrame`.

        Raises
        ------
        SettingsError
            Where polars is not installed.
        """
        return import_module(_FILES).to_polars(self)

    def save(self, path: str | Path) -> Path:
        """Write the result to a file that is complete or absent, and return its path.

        Parameters
        ----------
        path
            The file. Its ending decides: `.csv`, `.parquet` or `.json` for the numbers, `.png`, `.pdf` or
            `.svg` for the plot.

        Raises
        ------
        SettingsError
            Where the ending is another one.
        SourceError
            Where the disk refuses.
        """
        return import_module(_FILES).save(self, Path(path))


def for_json(value: Any) -> Any:
    """Return plain objects for JSON, null instead of numbers that are not finite."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {key: for_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return for_json(value.tolist())
    if isinstance(value, (list, tuple)):
        return [for_json(item) for item in value]
    if isinstance(value, np.generic):
        return for_json(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value
