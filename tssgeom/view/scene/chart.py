"""Charts inside a 2-D view: Rerun draws lines and labels, and this says where they go."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector

_LABEL_DROP = 0.6
"""Rerun writes a label below its point, by this part of a line of text."""


@dataclass(frozen=True, slots=True)
class Box:
    """Size of a chart of height 1, chosen so that it fills its view on a common screen."""

    width: float
    """Width over height."""
    text: float
    """Height of a line of text over the height of the box."""
    bare: bool = False
    """Whether the numbers stand without their unit, where there is little room and the title has it."""

    @property
    def x_range(self) -> list[float]:
        """What the view shows across, numbers and margins with it."""
        return [-3.1 * self.text, self.width + 2.0 * self.text]

    @property
    def y_range(self) -> list[float]:
        """What the view shows downwards, numbers and margins with it."""
        return [-0.8 * self.text, 1.0 + 1.7 * self.text]


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis from 0 to its top, with a unit."""

    top: float
    unit: str

    @property
    def ticks(self) -> Vector:
        """Four to eight plain numbers from 0 to the top."""
        rough = self.top / 5
        unit = 10.0 ** math.floor(math.log10(rough))
        step = next(m * unit for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * unit >= 0.85 * rough)
        return np.round(np.arange(0.0, self.top * (1 + 1e-9), step), 12)

    @property
    def labels(self) -> list[str]:
        """The numbers with their unit."""
        return [f"{value:g} {self.unit}" for value in self.ticks]


@dataclass(frozen=True, slots=True)
class Chart:
    """A box of a plane whose y axis points down, in which values from 0 upwards are drawn."""

    x: Axis
    y: Axis
    box: Box

    def place(self, x: Vector | float, y: Vector | float) -> Vector:
        """Places [n, 2] of values in the plane; values beyond an edge are held at it."""
        across = self.box.width * np.clip(np.asarray(x) / self.x.top, 0.0, 1.0)
        down = 1.0 - np.clip(np.asarray(y) / self.y.top, 0.0, 1.0)
        return np.column_stack(np.broadcast_arrays(across, down))

    def grid(self) -> list[Vector]:
        """Lines across the box at every tick, each [2, 2]."""
        upright = [self.place(x, np.array([0.0, self.y.top])) for x in self.x.ticks]
        level = [self.place(np.array([0.0, self.x.top]), y) for y in self.y.ticks]
        return [*upright, *level]

    def numbers(self) -> tuple[Vector, list[str]]:
        """Places [n, 2] and texts of the numbers along both axes."""
        text = self.box.text
        below = self.place(self.x.ticks, 0.0) + np.array([0.0, 0.35 * text])
        beside = self.place(0.0, self.y.ticks) - np.array([1.9 * text, _LABEL_DROP * text])
        texts = [*self.x.labels, *self.y.labels]
        return np.vstack([below, beside]), [text.split()[0] for text in texts] if self.box.bare else texts
