"""Results of an analysis as plain objects for JSON and rows of tables: one for each shape or recording."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from tssgeom.channel_names import marked
from tssgeom.errors import printable
from tssgeom.io.results.keys.shapes import ClearanceOf, Contact, Segment
from tssgeom.lumen.clearance import Clearance, Region
from tssgeom.stream import FrameResult, Rejected
from tssgeom.summary import RANGED, RunningSummary

_MOST_WARNINGS = 5  # different texts in the object of a recording; chosen


@dataclass(frozen=True, slots=True)
class Analysis:
    """The analysis of one input, static shape or recording."""

    name: str
    """Name of its outputs, different for each input of a run."""
    source: str
    """The input, as a path relative to the working folder or an address."""
    unit: str
    """Unit of length in the source."""
    kind: str
    """Format of the source."""
    timed: bool
    summary: RunningSummary
    notes: tuple[str, ...] = ()
    """Warnings of the reader about the file as a whole."""

    @property
    def results(self) -> list[FrameResult]:
        """Usable frames: all of them, or a number of evenly spread ones and the last."""
        return self.summary.results

    @property
    def representative(self) -> FrameResult:
        """The frame that represents the input in summary, pictures and report."""
        return self.summary.representative

    @property
    def warnings(self) -> list[str]:
        """Warnings of the file, then those of its frames, the most frequent first."""
        return [*self.notes, *_shortened(self.summary.warnings, self.summary.used)]


_QUANTITY = re.compile(r"\d[\d.]*(?:e[+-]?\d+)?(?= ?(?:mm|°|m|N|s|%)(?!\w))")  # a number with its unit


def _shortened(counts: Counter[str], frames: int) -> list[str]:
    """Return the warnings with the number of frames they apply to; of many, the most frequent.

    Those that differ in their quantities alone are one, with those of the most frequent.
    """
    if frames == 1:
        return list(counts)
    groups = dict[str, list[tuple[str, int]]]()
    for text, count in counts.most_common():
        groups.setdefault(_QUANTITY.sub("#", text), []).append((text, count))
    alike = [(group[0][0], sum(n for _, n in group), len(group) > 1) for group in groups.values()]
    alike.sort(key=lambda one: -one[1])
    frequent = [
        f"{text} ({count} of {frames} frames{', quantities differ' * differ})"
        for text, count, differ in alike[:_MOST_WARNINGS]
    ]
    more = len(alike) - len(frequent)
    return [*frequent, f"{more} other warning{'s' * (more > 1)}"] if more > 0 else frequent


def shape_summary(name: str, result: FrameResult, notes: Iterable[str] = ()) -> dict[str, Any]:
    """Return the object that `analyse --json` prints for one shape, in SI.

    Segment lengths add up to `length_m`, segment angles to `total_angle_rad`.
    """
    resolution = {"resolution_m": result.fit.resolution} if result.fit.resolution else {}
    return {
        "shape": name,
        **_geometry(result),
        **resolution,
        "segments": msgspec.to_builtins(Segment.of(result.arcs)),
        **_tendon(result),
        **({} if result.machine is None else result.machine.numbers),
        **({"tension_in_assumed": True} if _assumed(result) else {}),
        "warnings": [*notes, *result.warnings],
    }


def _assumed(result: FrameResult) -> bool:
    """Whether the frame brings nothing that drives the tendon, so that T_in is that of the option."""
    return not (result.frame.drives_tendon if result.machine is None else result.machine.driven)


def _geometry(result: FrameResult) -> dict[str, Any]:
    arcs = result.arcs
    return {
        "points": len(result.shape.points),
        "length_m": arcs.total_length,
        "total_angle_rad": arcs.total_angle,
        "total_angle_se_rad": arcs.total_angle_se,
        "noise_m": float(result.fit.noise),
        "method": arcs.method,
    }


def analysis_object(analysis: Analysis) -> dict[str, Any]:
    """Return the object of one input: its shape or, for a recording, its last good frame and ranges.

    A recording has the keys of a shape for its last good frame, and `frames`, `rejected`, `time_s` of that
    frame, and `range` with the smallest and the largest value of each quantity over all good frames.
    """
    last, summary = analysis.results[-1], analysis.summary
    shape = shape_summary(analysis.name, last, analysis.notes)
    if not analysis.timed:
        return shape
    return shape | {
        "frames": summary.frames,
        "rejected": summary.refused,
        "time_s": last.frame.time,
        "range": {key: [summary.low[key], summary.high[key]] for key in RANGED},
        "warnings": analysis.warnings,
    }


def summary_row(analysis: Analysis) -> dict[str, Any]:
    """Return the row of one input in `summary.parquet`; see `tssgeom.io.results.tables.SUMMARY`.

    Its values are those of the representative frame, as in every picture.
    """
    chosen, summary = analysis.representative, analysis.summary
    row = (
        _geometry(chosen)
        | _tendon(chosen)
        | {
            "name": analysis.name,
            "source": analysis.source,
            "timed": analysis.timed,
            "frames": summary.frames,
            "rejected": summary.refused,
            "warned": summary.warned,
            "duration_s": analysis.results[-1].frame.time - summary.begin,
            "time_s": chosen.frame.time,
            "noise_rms_m": summary.noise,
            "pieces": len(chosen.arcs.length),
            "warnings": analysis.warnings,
            "tension_in_assumed": _assumed(chosen),
        }
    )
    for key in RANGED:
        row[marked(key, "min")], row[marked(key, "max")] = summary.low[key], summary.high[key]
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
    """Return the row of one frame in `frames/NAME.parquet`; see `tssgeom.io.results.tables.FRAMES`."""
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
        **_of_machine(item),
        "warnings": item.warnings,
    }


def _of_machine(result: FrameResult) -> dict[str, float]:
    """Return the columns of a machine, what was wanted of it, and what was measured."""
    if result.machine is None:
        return {}
    given = (result.frame.of_machine or {}).items()
    return result.machine.numbers | {
        name if "_target_" in name else f"measured_{name}": value for name, value in given
    }


def clearance_object(lumen: str, clearance: Clearance) -> ClearanceOf:
    """Return the object of `analyse --json` for the clearance of one frame to a mesh named `lumen`, in SI."""
    return {
        "lumen": lumen,
        "tube_radius_m": clearance.radius,
        "least_m": clearance.least,
        "least_at_m": _narrowest(clearance),
        "contacts": _regions(clearance.contacts),
        "outside": _regions(clearance.outside),
        "beyond_ends_m": clearance.beyond,
    }


def clearance_columns(clearance: Clearance) -> dict[str, float | None]:
    """Return the columns of `summary.parquet` for the clearance of one frame."""
    return {
        "clearance_m": clearance.least,
        "clearance_at_m": _narrowest(clearance),
        "contact_length_m": sum(one.end - one.begin for one in clearance.contacts),
        "outside_length_m": sum(one.end - one.begin for one in clearance.outside),
    }


def _narrowest(clearance: Clearance) -> float | None:
    """Return the arc length of the least clearance [m]."""
    return None if clearance.least is None else float(clearance.s[clearance.narrowest])


def _regions(regions: Sequence[Region]) -> list[Contact]:
    return [{"s_start_m": one.begin, "s_end_m": one.end, "least_m": one.least} for one in regions]


def relative(path: str | Path) -> str:
    """Return a path relative to the working folder, with forward slashes; an address as it is.

    What cannot be printed is written out: the text is for tables and reports, it opens no file.
    """
    if "://" in str(path):
        return printable(str(path))
    return printable(Path(os.path.relpath(path)).as_posix())
