"""A campaign in one recording: run after run, the plane of each route turned to face the viewer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Points, Vector
from tssgeom.identify.campaign import Route
from tssgeom.identify.finding import Finding, LawCurve, RouteMisfit, Trace
from tssgeom.route.pieces import Arcs
from tssgeom.statistics import NORMAL_95
from tssgeom.view.samples import RouteSamples, evenly, round_up
from tssgeom.view.scene.charts import slid_up_to
from tssgeom.view.scene.labels import Camera, camera

MOST_ROWS = 240
"""Pictures of the route over the whole campaign."""
MOST_NODES = 64
"""Nodes of the route in each."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """One run in the recording."""

    trace: Trace
    arcs: Arcs
    first: int
    """Number of its first sample, counted over all runs."""
    position: Points
    """[m, 3] The nodes that are drawn, about the middle of the route, longest axis along x [m]."""
    s: Vector
    """[m] Their arc length [m]."""
    misfit: Vector
    """[m] Missing curve angle at the nodes [rad/m]; where friction along the sheath was learnt, that [1]."""
    misfit_se: Vector
    rows: NDArray[np.intp]
    """Samples at which the route is drawn."""
    nodes: NDArray[np.intp]
    """Which nodes of the route are drawn."""

    def frames(self) -> list[RouteSamples]:
        """Return what is drawn of the route at each row."""
        nothing = np.zeros(len(self.s))
        tension = self.trace.tension[:, self.nodes]
        return [
            RouteSamples(self.s, self.position, tension[row], nothing, nothing, nothing, nothing)
            for row in self.rows.tolist()
        ]

    def fronts(self) -> list[float]:
        """Return up to where the tendon slid at each row, since the sample before it [m]."""
        along = self.trace.tension[:, self.nodes]
        return np.array(slid_up_to(along, self.s))[self.rows].tolist()


@dataclass(frozen=True, slots=True)
class Replay:
    """All runs."""

    stretches: Sequence[Stretch]
    camera: Camera
    tension: float
    """Top of the scale of tension [N]."""
    misfit: float
    """Top of the scale of misfit, as in a `Stretch`."""
    length: float
    """Of the longest route [m]."""


def replay(finding: Finding) -> Replay:
    """Choose samples, nodes and scales that hold for the whole campaign."""
    routes = {run.route.name: run.route for run in finding.campaign.runs}
    law = friction_map(finding)
    along = {each.route: each for each in finding.along}
    each = max(2, MOST_ROWS // len(finding.traces))
    stretches, first = list[Stretch](), 0
    for trace in finding.traces:
        route = routes[trace.route]
        made = _stretch(trace, route, along.get(route.name), first, each)
        stretches.append(made if law is None else _with_law(made, law))
        first += len(trace.time)
    everywhere = np.concatenate([stretch.position for stretch in stretches])
    misfits = np.concatenate([stretch.misfit + stretch.misfit_se for stretch in stretches])
    return Replay(
        stretches,
        camera(everywhere, np.array([1.0, 0.0, 0.0])),
        round_up(max(float(trace.tension.max()) for trace in finding.traces)),
        round_up(max(float(misfits.max()), 1.0 if law is None else 0.0)),
        max(float(stretch.s[-1]) for stretch in stretches),
    )


def friction_map(finding: Finding) -> LawCurve | None:
    """Return the law of friction over the arc length, where one was learnt."""
    laws = [each.law for each in finding.effects if each.names[0] == "friction_over_arc_length"]
    return next((law for law in laws if law is not None), None)


def _with_law(stretch: Stretch, law: LawCurve) -> Stretch:
    """Return a run with the friction along its route, and a standard error of it, for what it misses."""
    friction = np.interp(stretch.s, law.x, law.value)
    error = np.interp(stretch.s, law.x, law.high - law.low) / (2.0 * NORMAL_95)
    return replace(stretch, misfit=friction, misfit_se=error)


def _stretch(trace: Trace, route: Route, along: RouteMisfit | None, first: int, rows: int) -> Stretch:
    nodes = evenly(len(route.s), MOST_NODES)
    s = route.s[nodes]
    misfit, error = np.zeros(len(s)), np.zeros(len(s))
    if along is not None:
        misfit = np.interp(s, along.s_m, along.extra_angle_rad_per_m)
        error = np.interp(s, along.s_m, along.se_rad_per_m)
    position = _square_on(route.position[nodes])
    return Stretch(trace, route.arcs, first, position, s, misfit, error, evenly(len(trace.time), rows), nodes)


def _square_on(position: Points) -> Points:
    """Turn a route so that the plane in which it spreads most is the screen."""
    observed = camera(position, position[-1] - position[0])
    return (position - observed.target) @ observed.axes.T
