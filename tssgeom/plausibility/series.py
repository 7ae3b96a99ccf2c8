"""A measured run ready for its tests, and tests of its channels: signs, units, sizes by rig and route."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.rules import remark
from tssgeom.rig import Rig, Sensor
from tssgeom.statistics import reading_noise, turns

TIME = "time_s"
DRIVES = ("tension_in_N", "displacement_in_m")


@dataclass(frozen=True, slots=True)
class SeriesSizes:
    """Chosen: so that the tests of a long run take a fraction of a second."""

    means: int = 400
    """Chosen: fine beside a leg of the drive. Means of rows that a long run is reduced to [1]."""
    noisy_rows: int = 4000
    """Chosen: the noise is within 3 %. Readings from whose middle the noise is taken [1]."""
    noisy_share: float = 1e-4
    """Chosen: digits of computed runs are finer. Noise over range from which readings have noise [1]."""
    rest: int = 3
    """Chosen: as many as any run has at rest. Readings whose median is the reading at rest [1]."""


SIZES = SeriesSizes()


@dataclass(frozen=True)
class Series:
    """One run: columns in SI with `time_s`, NaN where a reading is missing, and what is known beside them."""

    columns: Mapping[str, Vector]
    rig: Rig | None = None
    """None: no rig was given, and nothing is tested against one."""
    length: float | None = None
    """Length of the route [m]; None where it is not known."""
    angle: float | None = None
    """Total angle of the route [rad]; None where it is not known."""

    @cached_property
    def channels(self) -> dict[str, Vector]:
        """The measured columns with a reading."""
        return {
            name: values
            for name, values in self.columns.items()
            if name != TIME and np.isfinite(values).any()
        }

    @property
    def time(self) -> Vector:
        """[n] [s]."""
        return self.columns[TIME]

    @cached_property
    def drive(self) -> str | None:
        """The channel that shows best when the drive turns: the position before the tension."""
        return next((name for name in reversed(DRIVES) if name in self.channels), None)

    @cached_property
    def noise(self) -> dict[str, float]:
        """White noise of each channel, digits included."""
        return {name: _noise(values) for name, values in self.channels.items()}

    def tensions(self) -> Iterator[tuple[str, Vector]]:
        """Yield the channels in newtons."""
        yield from ((name, values) for name, values in self.channels.items() if name.endswith("_N"))

    def span(self, name: str) -> float:
        """Return the range of a channel."""
        return float(np.nanmax(self.channels[name]) - np.nanmin(self.channels[name]))

    def most(self, name: str) -> float:
        """Return the greatest absolute reading of a channel."""
        return float(np.nanmax(np.abs(self.channels[name])))

    @property
    def rows_a_mean(self) -> int:
        """Rows that one mean is taken over."""
        return -(-len(self.time) // SIZES.means)

    @cached_property
    def means(self) -> dict[str, Vector]:
        """Means of consecutive rows of time and channels; NaN where none of them has a reading."""
        return {
            name: _means(values, self.rows_a_mean)
            for name, values in ({TIME: self.time} | self.channels).items()
        }

    def error(self, name: str) -> float:
        """Return the noise of a mean."""
        return self.noise[name] / float(np.sqrt(self.rows_a_mean))

    def moves(self, name: str) -> bool:
        """Whether a channel moves by more than its noise."""
        means = self.means[name]
        return float(np.nanmax(means) - np.nanmin(means)) > 2.0 * CHANCE.never * max(self.error(name), 1e-300)

    def noisy(self) -> list[str]:
        """Return the channels whose readings differ by noise, which never repeats."""
        return [name for name in self.channels if self.noise[name] > SIZES.noisy_share * self.span(name)]

    def at_rest(self, name: str) -> float:
        """Return the first readings of a channel, by their median."""
        values = self.channels[name]
        return float(np.median(values[np.isfinite(values)][: SIZES.rest]))

    @cached_property
    def edges(self) -> NDArray[np.intp]:
        """Means at which the drive begins, turns and ends; [0] where there is no drive."""
        if self.drive is None:
            return np.zeros(1, dtype=np.intp)
        least = max(LIMITS.turn_share * self.span(self.drive), CHANCE.never * self.error(self.drive))
        return turns(filled(self.means[self.drive]), least)


def filled(values: Vector) -> Vector:
    """Return a column with straight lines over missing readings."""
    there = np.isfinite(values)
    return values if there.all() else np.interp(np.arange(len(values)), np.flatnonzero(there), values[there])


def _means(values: Vector, rows: int) -> Vector:
    if rows == 1:
        return values
    padded = np.full(-(-len(values) // rows) * rows, np.nan)
    padded[: len(values)] = values
    blocks = padded.reshape(-1, rows)
    count = np.isfinite(blocks).sum(axis=1)
    with np.errstate(invalid="ignore"):
        return np.nansum(blocks, axis=1) / np.where(count, count, np.nan)


def _noise(values: Vector) -> float:
    there = values[np.isfinite(values)]
    first = max(0, (len(there) - SIZES.noisy_rows) // 2)
    return reading_noise(there[first : first + SIZES.noisy_rows])


def correlation(one: Vector, other: Vector) -> float:
    """Return the correlation of two columns; 0 where too few rows have both."""
    there = np.isfinite(one) & np.isfinite(other)
    a, b = one[there], other[there]
    if len(a) < LIMITS.repeated_rows:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else 0.0


DISPLACEMENTS = ("displacement_in_m", "displacement_out_m")


def value_remarks(run: Series) -> Iterator[Remark]:
    """Yield what is wrong with single channels, and with their sizes beside rig and route."""
    yield from _tensions(run)
    yield from _temperature(run)
    yield from _strokes(run)
    yield from _stretch(run)
    yield from missing_remarks(run.columns)


def _tensions(run: Series) -> Iterator[Remark]:
    for name, values in run.tensions():
        least, most = float(np.nanmin(values)), run.most(name)
        if least < 0.0 and np.nanmedian(values) < 0.0 and -least > np.nanmax(values):
            yield remark("inverted_cell", "run", f"{name} falls to {least:g} N")
        elif least < -max(LIMITS.negative * run.span(name), CHANCE.never * run.noise[name]):
            yield remark("negative_tension", "run", f"{name} falls to {least:.3g} N")
        if run.rig is None:
            if most > LIMITS.strongest_N:
                yield remark("tension_unit", "run", f"{name} reaches {most:g} N")
        else:
            yield from _beside_rig(run, name, most)
        if run.moves(name) and run.span(name) < LIMITS.weakest_N:
            yield remark("tension_unit", "run", f"{name} varies by {run.span(name):.2g} N only")


def _beside_rig(run: Series, name: str, most: float) -> Iterator[Remark]:
    assert run.rig is not None
    strain, scale = run.rig.tendon.compliance_per_N * most, run.rig.sensors.get(name, Sensor()).full_scale
    if strain > LIMITS.usual_strain:
        rule = "strain" if strain > LIMITS.largest_strain else "high_strain"
        yield remark(
            rule, "run", f"{name} reaches {most:g} N, which would stretch the tendon by {strain:.0%}"
        )
    if scale and most > scale:
        rule = "full_scale" if most > LIMITS.gross * scale else "beyond_scale"
        yield remark(rule, "run", f"{name} reaches {most:g} N and its full scale is {scale:g} N")


def _temperature(run: Series) -> Iterator[Remark]:
    for name, values in run.channels.items():
        if not name.startswith("temperature"):
            continue
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if high > LIMITS.hottest_C or low < -LIMITS.warmest_C:
            far = high if high > LIMITS.hottest_C else low
            yield remark("temperature", "run", f"{name} reaches {far:g} °C")
        elif high > LIMITS.warmest_C:
            yield remark("warm", "run", f"{name} reaches {high:g} °C")


def _strokes(run: Series) -> Iterator[Remark]:
    for name in DISPLACEMENTS:
        if (
            run.length is not None
            and name in run.channels
            and run.span(name) > LIMITS.largest_stroke * run.length
        ):
            yield remark(
                "stroke", "run", f"{name} moves by {run.span(name):g} m on a route of {run.length:.3g} m"
            )


def _stretch(run: Series) -> Iterator[Remark]:
    """Compare the measured stretch with the route, and with what compliance and tension give at most."""
    if run.length is None:
        return
    if (
        "elongation_m" in run.channels
        and (most := run.most("elongation_m")) > LIMITS.largest_strain * run.length
    ):
        reached = f"elongation_m reaches {most:g} m on a route of {run.length:.3g} m"
        yield remark("stretch_unit", "run", reached)
        return
    stretch, name = stretch_of(run)
    pulls = [run.span(name) for name in ("tension_in_N", "tension_out_N") if name in run.channels]
    if stretch is None or not pulls or run.rig is None:
        return
    given = run.rig.tendon.compliance_per_N * max(pulls) * run.length
    span = float(np.nanmax(stretch) - np.nanmin(stretch))
    if given <= 0.0 or span <= 0.0 or 1.0 / LIMITS.usual_stretch <= span / given <= LIMITS.usual_stretch:
        return
    changes = (
        f"{name} changes by {1e3 * span:.3g} mm where compliance and tension give up to {1e3 * given:.3g} mm"
    )
    yield remark("stretch_unit" if span > LIMITS.stretch_ratio * given else "stretch_size", "run", changes)


def stretch_of(run: Series) -> tuple[np.ndarray | None, str]:
    """Return the elongation as measured, or by both displacements, and its name; docs/model.md (44)."""
    if "elongation_m" in run.channels:
        return run.channels["elongation_m"], "elongation_m"
    if set(DISPLACEMENTS) <= run.channels.keys():
        stretch = run.channels["displacement_in_m"] - run.channels["displacement_out_m"]
        if np.isfinite(stretch).any():
            return stretch, "displacement_in_m less displacement_out_m"
    return None, ""


def missing_remarks(columns: Mapping[str, Vector]) -> Iterator[Remark]:
    """Yield a remark for each column of a run in which readings are missing."""
    for name, values in columns.items():
        missing = int(np.count_nonzero(~np.isfinite(values)))
        if missing:
            yield remark("missing", "run", f"{name} is missing in {missing} of {len(values)} rows")


def apparent_friction(tension_in: float, tension_out: float, angle: float) -> float:
    """Return the friction coefficient that two tensions mean, if end fittings take what they may [1]."""
    left = (1.0 - LIMITS.fitting_share) * tension_in
    return math.log(left / tension_out) / angle if tension_out > 0.0 and angle > 0.0 else math.inf
