"""Recorded frames whose points lie along another length than those before and after; docs/model.md (331)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import CHANCE, MEDIANS
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.route.observations import MIN_POINTS


@dataclass(frozen=True, slots=True)
class LengthLimits:
    """When a length is outlying."""

    beside: int = 3
    """Frames before, and as many after, whose medians a length is compared with [1]. Chosen: a bad one beside
    it is outvoted, and a route that begins to move is like those on one side."""
    around: int = 8
    """Frames before, and as many after, that show how much it varies there [1]. Chosen."""
    share: float = 0.005
    """Difference over the length below which nothing is said [1]. Chosen: markers that sit on a sheath which
    moves quickly differ by half of it."""


LENGTHS = LengthLimits()


def outlying_lengths(points: Mapping[int, Points]) -> dict[int, str]:
    """Say of which recorded frames the points lie along a length that is not that of their neighbours.

    Parameters
    ----------
    points
        Points [n, 3] [m] by the count of the frame, in the order of time. Frames that lack points, or have
        another number of them than the first one, are left out.
    """
    first = next(iter(points.values()), np.zeros((0, 3)))
    complete = [i for i, each in points.items() if each.shape == first.shape and np.isfinite(each).all()]
    if len(complete) < PLAUSIBLE.repeated_rows or len(first) < MIN_POINTS or first.shape[1] != 3:
        return {}
    chords, longer = _lengths(np.array([points[i] for i in complete]))
    length = chords + longer
    usual = _medians(length, LENGTHS.beside)
    off = np.abs(length - usual).min(axis=0)
    varies = np.maximum(np.median(off), np.median(_windows(off, LENGTHS.around), axis=1))
    unsure = np.abs(longer - _medians(longer, LENGTHS.beside)).max(axis=0)  # of sharp bends
    outlying = off > np.maximum(
        CHANCE.never * MEDIANS.sd_per_absolute * varies, LENGTHS.share * length + unsure
    )
    return {complete[i]: _said(length[i], float(usual[:, i].mean())) for i in np.flatnonzero(outlying)}


def _medians(values: Vector, count: int) -> np.ndarray:
    """Medians of so many values before each, and after it [2, n]; at an end those of the other side."""
    padded = np.pad(values, count, constant_values=np.nan)
    every = np.lib.stride_tricks.sliding_window_view(padded, count)
    before, after = every[: len(values)], every[count + 1 :]
    with_both = np.stack((before, after))
    full = np.isfinite(with_both).all(axis=2)
    medians = np.median(np.nan_to_num(with_both), axis=2)
    return np.where(full, medians, medians[::-1])


def _windows(values: Vector, count: int) -> np.ndarray:
    """So many values before each and after it, turned round at the ends [n, 2 count + 1]."""
    padded = np.pad(values, count, mode="reflect")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * count + 1)


def _lengths(points: np.ndarray) -> tuple[Vector, Vector]:
    """Chords of the points of frames [f, n, 3], in all, and what the arcs over them are longer [f] [m]."""
    chord = np.diff(points, axis=1)
    size = np.maximum(np.linalg.norm(chord, axis=2), np.finfo(np.float64).tiny)
    unit = chord / size[..., None]
    turn = np.arccos(np.clip(np.sum(unit[:, 1:] * unit[:, :-1], axis=2), -1.0, 1.0))
    return np.sum(size, axis=1), np.sum(turn**2 * (size[:, 1:] + size[:, :-1]), axis=1) / 48.0


def _said(length: float, usual: float) -> str:
    return (
        f"the points lie along {1e3 * length:.4g} mm, in the frames before and after along "
        f"{1e3 * usual:.4g} mm: check for points that are lost, exchanged, or taken for others"
    )
