"""Numbers of a rig that are followed while it runs, with their bands, and alerts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tssgeom.adapt.alert import Alert
from tssgeom.statistics import NORMAL_95
from tssgeom.stream import FrameResult
from tssgeom.view import colours
from tssgeom.view.scene.columns import Sender

_ALERTS = "alerts"


def keys_of(results: Sequence[FrameResult]) -> tuple[str, ...]:
    """Return the numbers that all frames follow."""
    keys = {() if one.followed is None else one.followed.keys for one in results}
    return keys.pop() if len(keys) == 1 else ()


def send_followed(sender: Sender, results: Sequence[FrameResult]) -> None:
    """Send each followed number and both ends of its 95 % band as lines."""
    known = [one.followed for one in results if one.followed is not None]
    if not (keys := keys_of(results)):
        return
    values, errors = (np.array([getattr(one, name) for one in known]) for name in ("values", "se"))
    for i, key in enumerate(keys):
        value, reach = values[:, i], NORMAL_95 * errors[:, i]
        for name, line, width in (
            (key, value, 2.0),
            ("upper", value + reach, 1.0),
            ("lower", value - reach, 1.0),
        ):
            title = name if name == key else f"{name} end of the 95 % band"
            entity = f"followed/{key}/{'value' if name == key else name}"
            style = rr.SeriesLines(names=title, colors=[colours.MEASURED], widths=[width])
            sender.constant(entity, style)
            sender.send(entity, rr.Scalars.columns(scalars=line))


def send_alert(recording: rr.RecordingStream, alert: Alert) -> None:
    """Send an alert as a line of the log, at the recording's time."""
    recording.log(_ALERTS, rr.TextLog(alert.sentence, level=rr.TextLogLevel.WARN), strict=True)


def followed_views(keys: Sequence[str]) -> rrb.Container:
    """Return the views of followed numbers and of alerts."""
    plots = [
        rrb.TimeSeriesView(
            name=f"{key}, with its 95 % band, against time [s]",
            contents=[f"followed/{key}/**"],
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for key in keys
    ]
    return rrb.Vertical(*plots, rrb.TextLogView(origin=_ALERTS, name="Alerts"), name="Followed rig")
