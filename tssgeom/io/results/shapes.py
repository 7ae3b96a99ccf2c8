"""What an analysis found, as plain objects for JSON: one for each shape or recording."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tssgeom.route.pieces import Arcs
from tssgeom.stream import FrameResult, Rejected
from tssgeom.summary import RANGED, Account

_MOST_WARNINGS = 5


@dataclass(frozen=True, slots=True)
class Analysis:
    """What became of one input, static shape or recording."""

    name: str
    """Name of its outputs, different for each input of a run."""
    source: str
    """Where it was read, as a path seen from the working folder, or an address."""
    unit: str
    """Unit of length in the source."""
    kind: str
    """Format of the source."""
    timed: bool
    account: Account
    notes: tuple[str, ...] = ()
    """Warnings of the reader about the file as a whole."""

    @property
    def results(self) -> list[FrameResult]:
        """Frames that could be used: all of them, or so many evenly spread ones and the last."""
        return self.account.results

    @property
    def told(self) -> FrameResult:
        """The frame that stands for the input."""
        return self.account.told

    @property
    def warnings(self) -> list[str]:
        """Warnings of the file, then those of its frames, the most frequent first."""
        return [*self.notes, *_shortened(self.account.warnings, self.account.used)]


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
        **_geometry(result),
        "segments": segments(result.arcs),
        "tension_in_N": transmission.tension_in,
        "tension_out_N": transmission.tension_out,
        "elongation_m": transmission.elongation,
        "elongation_se_m": transmission.elongation_se,
        "warnings": [*notes, *result.warnings],
    }


def _geometry(result: FrameResult) -> dict[str, Any]:
    arcs = result.arcs
    return {
        "points": len(result.shape.points),
        "length_m": arcs.total_length,
        "total_angle_rad": arcs.total_angle,
        "total_angle_se_rad": arcs.total_angle_se,
        "noise_m": float(result.tracked.fit.noise),
        "method": arcs.method,
    }


def segments(arcs: Arcs) -> list[dict[str, float]]:
    """Return the constant-curvature pieces of a route as plain objects, proximal to distal."""
    columns = (arcs.length, arcs.kappa, arcs.angle, arcs.s_start)
    names = ("length_m", "kappa_per_m", "angle_rad", "s_start_m")
    return [dict(zip(names, map(float, row), strict=True)) for row in zip(*columns, strict=True)]


def analysis_object(analysis: Analysis) -> dict[str, Any]:
    """Return the object of one input: its shape or, for a recording, how it ended, and ranges.

    A recording has the keys of a shape for its last good frame, and `frames`, `rejected`, `time_s` of that
    frame, and `range` with the smallest and the largest value of each quantity over all good frames.
    """
    last, account = analysis.results[-1], analysis.account
    summary = shape_summary(analysis.name, last, analysis.notes)
    if not analysis.timed:
        return summary
    return summary | {
        "frames": account.frames,
        "rejected": account.refused,
        "time_s": last.frame.time,
        "range": {key: [account.low[key], account.high[key]] for key in RANGED},
        "warnings": analysis.warnings,
    }


def summary_row(analysis: Analysis) -> dict[str, Any]:
    """Return the row of one input in `summary.parquet`; see `tssgeom.io.results.result_tables.SUMMARY`.

    It tells the frame that stands for the input, the same as every picture.
    """
    told, account = analysis.told, analysis.account
    row = (
        _geometry(told)
        | _tendon(told)
        | {
            "name": analysis.name,
            "source": analysis.source,
            "timed": analysis.timed,
            "frames": account.frames,
            "rejected": account.refused,
            "warned": account.warned,
            "duration_s": analysis.results[-1].frame.time - account.begin,
            "time_s": told.frame.time,
            "noise_rms_m": account.noise,
            "pieces": len(told.arcs.length),
            "warnings": analysis.warnings,
        }
    )
    for key in RANGED:
        quantity, _, unit = key.rpartition("_")
        row[f"{quantity}_min_{unit}"], row[f"{quantity}_max_{unit}"] = account.low[key], account.high[key]
    return row


def _tendon(result: FrameResult) -> dict[str, Any]:
    transmission = result.transmission
    return {
        "tension_in_N": transmission.tension_in,
        "tension_out_N": transmission.tension_out,
        "tension_out_se_N": transmission.tension_out_se,
        "elongation_m": transmission.elongation,
        "elongation_se_m": transmission.elongation_se,
    }


def frame_row(item: FrameResult | Rejected) -> dict[str, Any]:
    """Return the row of one frame in `frames/NAME.parquet`; see `tssgeom.io.results.result_tables.FRAMES`."""
    if isinstance(item, Rejected):
        return {"seq": item.seq, "time_s": item.time, "id": str(item.id), "rejected": item.reason}
    frame, transmission = item.frame, item.transmission
    return {
        "seq": item.seq,
        "time_s": frame.time,
        "id": str(frame.id),
        **_geometry(item),
        "pieces": len(item.arcs.length),
        **_tendon(item),
        "direction_index": transmission.direction_index,
        "dead_zone": transmission.dead_zone,
        "dead_zone_width_N": transmission.dead_zone_width,
        "measured_tension_out_N": frame.tension_out,
        "measured_displacement_in_m": frame.displacement_in,
        "measured_elongation_m": frame.elongation,
        "warnings": item.warnings,
    }


def relative(path: str | Path) -> str:
    """Return a path as seen from the working folder, with forward slashes; an address as it is."""
    if "://" in str(path):
        return str(path)
    return Path(os.path.relpath(path)).as_posix()
