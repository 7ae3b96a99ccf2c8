"""The added curve of Theorem 3 as a design: what it scales down, what it costs, and what happens on release.

Sources: docs/model.md (15), (16), the remedy of Theorem 3; paper section II-D, eqs. (16)-(19).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.history import driven

_RELEASE_STEPS = 4
_STEP = math.radians(45.0)  # between the angles that are tried


@dataclass(frozen=True, slots=True)
class Perturbation:
    """Unknown bends: each at a random position, with an angle half of a normal distribution."""

    bends: int
    angle_sd: float
    """Of the normal distribution, of which the magnitude is taken [rad]."""
    width: float
    """Length of sheath over which each bend lies [m]."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """The load case: one pull from the pretension, and a release."""

    tension_in: float
    """Where the pull ends [N]."""
    release_to: float
    """Where the release ends [N]."""

    @property
    def tensions(self) -> Vector:
        """The pull in one step, then the release in small ones [N]."""
        back = np.linspace(self.tension_in, self.release_to, _RELEASE_STEPS + 1)[1:]
        return np.concatenate(([self.tension_in], back))


@dataclass(frozen=True, slots=True)
class Curve:
    """An added curve at the proximal end."""

    angle: float
    """β [rad]."""
    kappa: float
    """K [1/m]."""

    @property
    def length(self) -> float:
        """Sheath that it takes [m]."""
        return self.angle / self.kappa

    def before(self, arcs: Arcs) -> Arcs:
        """Return the route with the curve in front, as if all pieces were known."""
        if self.angle == 0.0:
            return arcs
        return Arcs.exact(np.append(self.length, arcs.length), np.append(self.angle, arcs.angle))


@dataclass(frozen=True, slots=True)
class Price:
    """What a route does with a curve in front, undisturbed."""

    tension_out: float
    """At the end of the pull [N]."""
    elongation: float
    """At the end of the pull [m]."""
    own_elongation: float
    """Of the added curve alone [m]."""
    pull_reaches_from: float
    """Proximal tension from which a first pull reaches the distal end [N]."""
    release_reaches_below: float
    """Proximal tension below which the release reaches the distal end [N]."""


@dataclass(frozen=True, slots=True)
class Disturbed:
    """Percentiles over the perturbations at each tension of a cycle, the end of the pull first."""

    tension: Vector
    """[n] |ΔT_out| [N]."""
    elongation: Vector
    """[n] |Δδ| [m]."""

    @property
    def pull(self) -> float:
        """|Δδ| at the end of the pull [m]."""
        return float(self.elongation[0])

    @property
    def worst(self) -> float:
        """|Δδ| at the worst moment of pull and release [m]."""
        return float(self.elongation.max())


def price(arcs: Arcs, rig: Rig, curve: Curve, cycle: Cycle) -> Price:
    """Return what the undisturbed route does with the curve in front."""
    route = curve.before(arcs)
    grown = math.exp(rig.friction.coefficient * route.total_angle)
    pulled = driven([cycle.tension_in], route, rig)
    out = float(pulled.tension_out[-1])
    own = 0.0
    if curve.angle > 0.0:
        alone = Arcs.exact(np.array([curve.length]), np.array([curve.angle]))
        own = float(driven([cycle.tension_in], alone, rig).elongation[-1])  # docs/model.md (16)
    return Price(
        tension_out=out,
        elongation=float(pulled.elongation[-1]),
        own_elongation=own,
        pull_reaches_from=rig.tendon.pretension_N * grown,
        release_reaches_below=out / grown,  # docs/model.md (6)
    )


def perturbed_routes(arcs: Arcs, perturbation: Perturbation, trials: int, seed: int) -> list[Arcs]:
    """Draw routes with bends that come on top of the angle that is there; the length stays.

    Raises SettingsError where the perturbation or the number of trials cannot be used.
    """
    for what, value in (("bends", perturbation.bends), ("trials", trials)):
        if value < 1:
            raise SettingsError(f"{what} is {value}: give 1 or more")
    if not (perturbation.angle_sd > 0 and math.isfinite(perturbation.angle_sd)):
        raise SettingsError(f"the angle of the bends is {perturbation.angle_sd:g} rad: give more than 0")
    rng = np.random.default_rng(seed)
    size = (trials, perturbation.bends)
    where = rng.uniform(0.0, arcs.total_length, size)
    angle = np.abs(rng.normal(0.0, perturbation.angle_sd, size))
    return [bent(arcs, s, a, perturbation.width) for s, a in zip(where, angle, strict=True)]


def bent(arcs: Arcs, where: Vector, angle: Vector, width: float) -> Arcs:
    """Return the route with bends of `angle` [b] [rad] about the arc lengths `where` [b], [m]."""
    joints = np.append(arcs.s_start, arcs.total_length)
    half = 0.5 * min(max(width, 1e-6 * arcs.total_length), arcs.total_length)
    low = np.clip(where - half, 0.0, arcs.total_length - 2 * half)
    edges = np.unique(np.concatenate([joints, low, low + 2 * half]))
    edges = edges[np.append(True, np.diff(edges) > 1e-12)]
    phi = np.interp(edges, joints, np.append(0.0, np.cumsum(arcs.angle)))
    for start, turn in zip(low, angle, strict=True):
        phi += turn * np.clip((edges - start) / (2 * half), 0.0, 1.0)
    return Arcs.exact(np.diff(edges), np.diff(phi))


def disturbed(
    arcs: Arcs, routes: Sequence[Arcs], rig: Rig, curve: Curve, tensions: Vector, percentile: float
) -> Disturbed:
    """Return how much perturbed routes differ from the one of the model, after each tension [N]."""
    calm = driven(tensions, curve.before(arcs), rig)
    runs = [driven(tensions, curve.before(route), rig) for route in routes]
    tension = np.abs([run.tension_out - calm.tension_out for run in runs])
    elongation = np.abs([run.elongation - calm.elongation for run in runs])
    return Disturbed(
        np.percentile(tension, percentile, axis=0), np.percentile(elongation, percentile, axis=0)
    )


def fully_releasing(routes: Sequence[Arcs], rig: Rig, curve: Curve, cycle: Cycle) -> float:
    """Return a proximal tension at which all routes release all along, with and without the curve [N]."""
    most = max(route.total_angle for route in routes) + curve.angle
    end = cycle.tension_in * math.exp(-2 * rig.friction.coefficient * most)  # docs/model.md (6)
    return min(0.9 * end, cycle.release_to)


@dataclass(frozen=True, slots=True)
class Tried:
    """One added curve that was tried."""

    curve: Curve
    price: Price
    disturbed: Disturbed


def sweep(
    arcs: Arcs,
    routes: Sequence[Arcs],
    rig: Rig,
    kappa: float,
    cycle: Cycle,
    percentile: float,
    *,
    most: float,
    report: Callable[[Curve], None] = lambda curve: None,
) -> list[Tried]:
    """Try curves of 0° to `most` [rad] in steps of 45°, all on the same perturbed routes.

    `report` is called after each.
    """
    tried = list[Tried]()
    for angle in angles(most):
        curve = Curve(angle, kappa)
        disturbance = disturbed(arcs, routes, rig, curve, cycle.tensions, percentile)
        tried.append(Tried(curve, price(arcs, rig, curve, cycle), disturbance))
        report(curve)
    return tried


def angles(most: float) -> list[float]:
    """Angles of the curves that are tried [rad]."""
    return [k * _STEP for k in range(round(most / _STEP) + 1)]


@dataclass(frozen=True, slots=True)
class Advice:
    """What the design tool recommends for a tolerance."""

    verdict: str
    """"none needed", "curve", "pull only" or "out of reach"."""
    tried: Tried | None
    """The recommended curve; for "pull only" the one that serves the pull alone."""


def advise(tried: Sequence[Tried], tolerance: float) -> Advice:
    """Choose the smallest curve that keeps |Δδ| below a tolerance [m], on pull and release if it can."""
    if tried[0].disturbed.worst <= tolerance:
        return Advice("none needed", None)
    for verdict, size in (
        ("curve", lambda each: each.disturbed.worst),
        ("pull only", lambda each: each.disturbed.pull),
    ):
        first = next((each for each in tried[1:] if size(each) <= tolerance), None)
        if first is not None:
            return Advice(verdict, first)
    return Advice("out of reach", None)


def same_output(cycle: Cycle, rig: Rig, curve: Curve) -> Cycle:
    """Return the cycle with which a full pull behind the curve has the distal tension of `cycle` without."""
    grown = math.exp(rig.friction.coefficient * curve.angle)
    return Cycle(cycle.tension_in * grown, cycle.release_to)
