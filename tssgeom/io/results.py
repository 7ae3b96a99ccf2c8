"""What an analysis found, as plain objects for JSON: one for each shape or recording."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tssgeom.shape.arcs import Arcs
from tssgeom.stream import FrameResult, Rejected

_MOST_WARNINGS = 5


@dataclass(frozen=True, slots=True)
class Analysis:
    """What became of one input, static shape or recording."""

    name: str
    """Name of its outputs, different for each input of a run."""
    source: Path
    unit: str
    """Unit of length in the source."""
    kind: str
    """Format of the source."""
    timed: bool
    items: Sequence[FrameResult | Rejected]
    """One for each frame, in order."""
    notes: tuple[str, ...] = ()
    """Warnings of the reader about the file as a whole."""

    @property
    def results(self) -> list[FrameResult]:
        """The frames that could be used."""
        return [item for item in self.items if isinstance(item, FrameResult)]

    @property
    def rejected(self) -> list[Rejected]:
        """The frames that could not be used."""
        return [item for item in self.items if isinstance(item, Rejected)]

    @property
    def warnings(self) -> list[str]:
        """Warnings of the file, then those of its frames, the most frequent first."""
        counts = Counter(warning for result in self.results for warning in result.warnings)
        return [*self.notes, *_shortened(counts, len(self.results))]


def _shortened(counts: Counter[str], frames: int) -> list[str]:
    """Return the warnings with the number of frames they apply to; of many, the most frequent."""
    if frames == 1:
        return list(counts)
    shown = [f"{text} ({count} of {frames} frames)" for text, count in counts.most_common(_MOST_WARNINGS)]
    more = len(counts) - len(shown)
    return [*shown, f"{more} other warnings"] if more > 0 else shown


def shape_summary(name: str, result: FrameResult, notes: Iterable[str] = ()) -> dict[str, Any]:
    """Return the object that `analyse --json` prints for one shape, in SI.

    Segment lengths add up to `length_m`, segment angles to `total_angle_rad`.
    """
    transmission = result.transmission
    return {
        "shape": name,
        "points": len(result.shape.points),
        "length_m": result.arcs.total_length,
        "total_angle_rad": result.arcs.total_angle,
        "total_angle_se_rad": result.arcs.total_angle_se,
        "noise_m": float(result.route.noise),
        "method": result.arcs.method,
        "segments": segments(result.arcs),
        "tension_in_N": transmission.tension_in,
        "tension_out_N": transmission.tension_out,
        "elongation_m": transmission.elongation,
        "elongation_se_m": transmission.elongation_se,
        "warnings": [*notes, *result.warnings],
    }


def segments(arcs: Arcs) -> list[dict[str, float]]:
    """Return the constant-curvature pieces of a route as plain objects, proximal to distal."""
    columns = (arcs.length, arcs.kappa, arcs.angle, arcs.s_start)
    names = ("length_m", "kappa_per_m", "angle_rad", "s_start_m")
    return [dict(zip(names, map(float, row), strict=True)) for row in zip(*columns, strict=True)]


def analysis_object(analysis: Analysis) -> dict[str, Any]:
    """Return the object of one input: its shape or, for a recording, the last good frame and the ranges.

    A recording has the keys of a shape, and `frames`, `rejected`, `time_s` of the last good frame, and
    `range` with the smallest and the largest value of each quantity over all good frames.
    """
    results = analysis.results
    summary = shape_summary(analysis.name, results[-1], analysis.notes)
    if not analysis.timed:
        return summary
    return summary | {
        "frames": len(analysis.items),
        "rejected": len(analysis.rejected),
        "time_s": results[-1].frame.time,
        "range": {key: list(_range(results, pick)) for key, pick in RANGED.items()},
        "warnings": analysis.warnings,
    }


RANGED: dict[str, Callable[[FrameResult], float]] = {
    "length_m": lambda result: result.arcs.total_length,
    "total_angle_rad": lambda result: result.arcs.total_angle,
    "tension_in_N": lambda result: result.transmission.tension_in,
    "tension_out_N": lambda result: result.transmission.tension_out,
    "elongation_m": lambda result: result.transmission.elongation,
}
"""Quantities that are told as a range over a recording."""


def _range(results: Sequence[FrameResult], pick: Callable[[FrameResult], float]) -> tuple[float, float]:
    values = [pick(result) for result in results]
    return min(values), max(values)


def summary_row(analysis: Analysis) -> dict[str, Any]:
    """Return the row of one input in `summary.parquet`; see `tssgeom.io.result_tables.SUMMARY`."""
    results = analysis.results
    row = shape_summary(analysis.name, results[-1]) | {
        "name": analysis.name,
        "source": relative(analysis.source),
        "timed": analysis.timed,
        "frames": len(analysis.items),
        "rejected": len(analysis.rejected),
        "duration_s": results[-1].frame.time - results[0].frame.time,
        "pieces": len(results[-1].arcs.length),
        "tension_out_se_N": results[-1].transmission.tension_out_se,
        "warnings": analysis.warnings,
    }
    for key, pick in RANGED.items():
        quantity, _, unit = key.rpartition("_")
        row[f"{quantity}_min_{unit}"], row[f"{quantity}_max_{unit}"] = _range(results, pick)
    return row


def frame_row(item: FrameResult | Rejected) -> dict[str, Any]:
    """Return the row of one frame in `frames/NAME.parquet`; see `tssgeom.io.result_tables.FRAMES`."""
    if isinstance(item, Rejected):
        return {"seq": item.seq, "time_s": item.time, "id": str(item.id), "rejected": item.reason}
    frame, transmission = item.frame, item.transmission
    return shape_summary("", item) | {
        "seq": item.seq,
        "time_s": frame.time,
        "id": str(frame.id),
        "pieces": len(item.arcs.length),
        "tension_out_se_N": transmission.tension_out_se,
        "direction_index": transmission.direction_index,
        "dead_zone": transmission.dead_zone,
        "dead_zone_width_N": transmission.dead_zone_width,
        "measured_tension_out_N": frame.tension_out,
        "measured_displacement_in_m": frame.displacement_in,
        "measured_elongation_m": frame.elongation,
    }


def relative(path: Path) -> str:
    """Return a path as seen from the working folder, with forward slashes."""
    return Path(os.path.relpath(path)).as_posix()
