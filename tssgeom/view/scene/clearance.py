"""Where a tube is narrowest in its lumen, and where it touches, in the three-dimensional view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from tssgeom.arrays import Points
from tssgeom.lumen.clearance import Clearance
from tssgeom.view import colours
from tssgeom.view.scene.columns import Sender, segments_3d
from tssgeom.view.scene.run import Run


def send_clearance(sender: Sender, run: Run, found: Sequence[Clearance]) -> None:
    """Mark the wall where the tube touches it, and the narrowest place of each frame.

    Parameters
    ----------
    sender, run
        The recording and what it shows.
    found
        Clearance of each frame.
    """
    touching = [_touched(one) for one in found]
    style = rr.Points3D.from_fields(colors=colours.CONTACT, radii=rr.Radius.ui_points(4.0))
    sender.constant("lumen/contact", style)
    columns = rr.Points3D.columns(positions=np.concatenate(touching))
    sender.send("lumen/contact", columns, [len(one) for one in touching])
    _send_narrowest(sender, run, found)


def _touched(one: Clearance) -> Points:
    inside = [(region.begin <= one.s) & (one.s <= region.end) for region in (*one.contacts, *one.outside)]
    return one.place[np.any(inside, axis=0)] if inside else np.zeros((0, 3))


def _send_narrowest(sender: Sender, run: Run, found: Sequence[Clearance]) -> None:
    """Draw a line from the route to the wall where it is narrowest, with the clearance as its label."""
    known = [one.narrowest >= 0 for one in found]
    lines = [
        np.array([frame.at(one.s[[one.narrowest]])[0], one.place[one.narrowest]])
        for frame, one, seen in zip(run.frames, found, known, strict=True)
        if seen
    ]
    if not lines:
        return
    counts = [int(seen) for seen in known]
    style = rr.LineStrips3D.from_fields(colors=colours.CONTACT, radii=rr.Radius.ui_points(2.0))
    sender.constant("lumen/narrowest", style)
    sender.send("lumen/narrowest", rr.LineStrips3D.columns(strips=segments_3d(lines)), counts)
    label = rr.Points3D.from_fields(radii=0.0, colors=colours.CONTACT, show_labels=True)
    sender.constant("lumen/narrowest/label", label)
    texts = [_gap_words(one.least) for one in found if one.least is not None]
    columns = rr.Points3D.columns(positions=np.array([line[1] for line in lines]), labels=texts)
    sender.send("lumen/narrowest/label", columns, counts)


def clearance_words(one: Clearance) -> str:
    """Say in a paragraph how the tube lies in its lumen, as markdown."""
    if one.least is None:
        return "The route lies beyond the ends of the lumen mesh."
    tube = f"A tube of {2e3 * one.radius:.1f} mm" if one.radius else "The middle of the tube"
    at = f"at s = {1e3 * one.s[one.narrowest]:.0f} mm"
    said = f"{tube} is at its narrowest **{_gap_words(one.least)}** of the lumen, {at}."
    if one.contacts:
        length = sum(region.end - region.begin for region in one.contacts)
        said += f" It touches the wall on {1e3 * length:.0f} mm, within the error of its places."
    return " ".join([said, *(f"⚠ {warning}." for warning in one.warnings())])


def _gap_words(least: float) -> str:
    return f"{1e3 * abs(least):.1f} mm {'into' if least < 0 else 'from'} the wall"
