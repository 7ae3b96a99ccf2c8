"""The recording of a shape or run: tension along the route, its pieces and numbers, moved by one time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from tssgeom.errors import SourceError
from tssgeom.lumen.clearance import Clearance
from tssgeom.stream import FrameResult
from tssgeom.view import wording as words
from tssgeom.view.scene.blueprint import blueprint, chart_boxes
from tssgeom.view.scene.charts import Sender, send_curvature_chart, send_slip_front, send_tension_chart
from tssgeom.view.scene.run import Run, run_of, send_series
from tssgeom.view.scene.space import clearance_words, send_clearance, send_space
from tssgeom.view.scene.writer import recording_file

if TYPE_CHECKING:
    import trimesh


def write_recording(
    path: Path,
    name: str,
    results: Sequence[FrameResult],
    *,
    timed: bool,
    lumen: trimesh.Trimesh | None = None,
    clearance: Callable[[FrameResult], Clearance] | None = None,
) -> None:
    """Write a Rerun recording of one shape or of one run; an older file gives way only when it is done.

    Parameters
    ----------
    path
        The `.rrd` file.
    name
        Name of the shape or run.
    results
        Results of the frames, in order of time; at least one.
    timed
        True: the frames are rows of the timeline `time` [s]. False: the last frame alone, without time.
    lumen
        Wall around the route [m].
    clearance
        Measures the clearance of a frame; the wall is marked where the tube touches it.

    Raises
    ------
    SourceError
        Where there is no result, or the file cannot be written.
    """
    if not results:
        raise SourceError(f"{path}: no frame of {name} could be used, so there is nothing to show")
    run = run_of(name, results if timed else results[-1:], timed)
    measured = [clearance(one) for one in run.results] if clearance else []
    top = max(run.ranges.tension, *(one.frame.tension_out or 0.0 for one in run.results))
    moving = len({one.arcs.total_angle for one in run.results}) > 1
    span = run.results[0].frame.time, run.results[-1].frame.time
    views = blueprint(name, run.camera, timed=timed, moving=moving, tension=top, span=span)
    with recording_file(path, name, views) as recording:
        sender = Sender(recording, _times(run))
        send_pictures(sender, run, lumen, measured)
        if timed:
            send_series(sender, run.results)


def _times(run: Run) -> NDArray[np.float64] | None:
    return np.array([result.frame.time for result in run.results]) if run.timed else None


def send_pictures(
    sender: Sender, run: Run, lumen: trimesh.Trimesh | None, measured: Sequence[Clearance] = ()
) -> None:
    """Send everything but the lines over time; `measured` is the clearance of each frame, or empty."""
    send_space(sender, run, lumen)
    if measured:
        send_clearance(sender, run, measured)
    _send_words(sender, run, measured)
    pieces = [result.arcs for result in run.results]
    boxes = chart_boxes(timed=run.timed)
    send_tension_chart(sender, run.frames, pieces, run.ranges, boxes.tension)
    send_curvature_chart(sender, run.frames, pieces, run.ranges, boxes.curvature)
    if run.timed:
        send_slip_front(sender, run.frames, run.fronts, run.ranges, boxes.tension)


def _send_words(sender: Sender, run: Run, measured: Sequence[Clearance]) -> None:
    pairs = zip(run.results, run.frames, strict=True)
    summaries = [words.summary(run.name, result, run.timed) for result in run.results]
    if measured:
        parts = zip(summaries, measured, strict=True)
        summaries = [f"{text}\n\n{clearance_words(one)}" for text, one in parts]
    tables = [words.piece_table(result.arcs, frame) for result, frame in pairs]
    for entity, texts in (("summary", summaries), ("table", tables)):
        sender.constant(entity, rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN))
        sender.send(entity, rr.TextDocument.columns(text=texts))
