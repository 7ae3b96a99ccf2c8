"""Laws that a rig may have and its nominal model has not, and how they act in a chain.

Each is a plain function of one quantity. A law of friction is a factor of the Coulomb coefficient, 1 at its
reference; the chain takes it at every Gauss point, by the state there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tests.bristle.chain import Chain, Table

Array = np.ndarray
Law = Callable[[Array], Array]


class Step(NamedTuple):
    """How laws follow the state of a chain."""

    memory_s: float = 0.1
    """Time in which friction follows speed (chosen: with less, a tendon without inertia jumps)."""


STEP = Step()


@dataclass(slots=True)
class Acts:
    """What acts in a chain beside its build; each `over_…` is a factor of friction.

    `creep` holds pairs of a share of the elastic strain [1] and its time [s].
    """

    over_speed: Law | None = None
    over_tension: Law | None = None
    over_bend: Law | None = None
    over_s: Law | None = None
    over_travel: Law | None = None
    over_time: Law | None = None
    unequal: float = 0.0
    """Friction of pulling is 1 + this, that of releasing 1 − this."""
    creep: tuple[tuple[float, float], ...] = ()
    compliance: float = 0.0
    """Strain for tension [1/N], of which creep is a share."""
    _time: float = field(default=0.0, init=False)
    _next: float = field(default=0.0, init=False)
    _speed: Array | None = field(default=None, init=False)
    _strains: Array | None = field(default=None, init=False)
    _strains_next: Array | None = field(default=None, init=False)

    def renew(self, chain: Chain, dt: float) -> None:
        """Set factors and strains without force of a chain for a step of `dt` [s]."""
        factor = np.ones(len(chain.bend))
        for law, over in (
            (self.over_tension, chain.gauss_tension),
            (self.over_bend, chain.bend),
            (self.over_s, chain.middle_s),
            (self.over_travel, chain.travel),
        ):
            if law is not None:
                factor = factor * law(over)
        if self.over_time is not None:
            factor = factor * self.over_time(np.array(self._time + dt))
        if self.over_speed is not None:
            factor = factor * self.over_speed(self._speed_of(chain))
        chain.factor_pull = factor * (1.0 + self.unequal)
        chain.factor_release = factor * (1.0 - self.unequal)
        if self.creep:
            self._creep(chain, dt)
        self._next = self._time + dt

    def commit(self, chain: Chain, dt: float) -> None:
        """Take what the step has led to as the state."""
        self._time = self._next
        if self.over_speed is not None:
            kept = np.exp(-dt / STEP.memory_s)
            self._speed = kept * self._speed_of(chain) + (1.0 - kept) * np.abs(chain.slip_rate)
        if self.creep:
            self._strains = self._strains_next

    def _speed_of(self, chain: Chain) -> Array:
        return np.zeros(len(chain.bend)) if self._speed is None else self._speed

    def _creep(self, chain: Chain, dt: float) -> None:
        shares, times = (np.array(row)[:, None] for row in zip(*self.creep, strict=True))
        old = np.zeros((len(shares), len(chain.tension))) if self._strains is None else self._strains
        kept = np.exp(-dt / times)
        goal = self.compliance * shares * (chain.tension - chain.build.pretension)[None, :]
        self._strains_next = kept * old + (1.0 - kept) * goal
        chain.extra_strain[:] = self._strains_next.sum(axis=0)


def stribeck(peak: float, decay: float, rise: float, reference: float) -> Law:
    """Return friction that falls from its peak at rest within a speed [m/s], and rises by `rise` a m/s."""

    def law(speed: Array) -> Array:
        return 1.0 + peak * np.exp(-speed / decay) + rise * speed

    return lambda speed: law(speed) / law(np.array(reference))


def saturating(height: float, half: float, reference: float) -> Law:
    """Return friction that falls with tension to a floor: 1 + height half / (T + half), 1 at reference."""

    def law(tension: Array) -> Array:
        return 1.0 + height * half / (np.maximum(tension, 0.0) + half)

    return lambda tension: law(tension) / law(np.array(reference))


def quadratic(rise: float, reference: float) -> Law:
    """Return friction that grows with the square of curvature [1/m], by `rise` at the reference; 1 there."""
    return lambda bend: (1.0 + rise * (bend / reference) ** 2) / (1.0 + rise)


def stretches(parts: tuple[tuple[float, float, float], ...], edge: float) -> Law:
    """Return friction that differs on stretches: of each the middle, half the length [m], the change."""

    def law(s: Array) -> Array:
        factor = np.ones(np.shape(s))
        for middle, half, change in parts:
            inside = np.clip((half - np.abs(s - middle)) / edge + 0.5, 0.0, 1.0)
            factor = factor + change * inside**2 * (3.0 - 2.0 * inside)
        return factor

    return law


def worn(change: float, scale: float) -> Law:
    """Return friction that goes exponentially to 1 + change over a travel [m]."""
    return lambda travel: 1.0 - change * np.expm1(-travel / scale)


def run_in(height: float, scale: float) -> Law:
    """Return friction with a bump: 1 + height at a travel of `scale` [m], 1 before and long after."""
    return lambda travel: 1.0 + height * (travel / scale) * np.exp(1.0 - travel / scale)


def warming(change: float, scale: float) -> Law:
    """Return friction that goes to 1 + change over time, slowly first (exponent 1.5), within a time [s]."""
    return lambda t: 1.0 - change * np.expm1(-((t / scale) ** 1.5))


def power_strain(compliance: float, exponent: float, reference: float, most: float = 120.0) -> Table:
    """Return the strain law of a tendon that stiffens: rho T_r (T/T_r)^p; as `linear` at T_r."""
    tension = np.concatenate([[0.0], np.geomspace(0.02, most, 600)])
    return Table(compliance * reference * (tension / reference) ** exponent, tension)


def prony(exponent: float, height: float, first: float = 0.01, last: float = 2000.0) -> tuple:
    """Return Kelvin elements whose sum is height t^exponent, t in s, between two times.

    The spectrum of a power law is a power law: each element has the share between two edges of it. Fitted by
    least squares without negative shares.
    """
    from scipy.optimize import nnls

    times = np.geomspace(first, last, 18)
    t = np.geomspace(0.5 * first, 0.5 * last, 200)
    weight = t**-exponent
    shares, _ = nnls(weight[:, None] * -np.expm1(-t[:, None] / times), weight * height * t**exponent)
    return tuple((float(share), float(time)) for share, time in zip(shares, times, strict=True) if share > 0)


def crept(creep: tuple[tuple[float, float], ...]) -> Law:
    """Return strain over elastic strain, a time [s] after a step of tension."""
    return lambda t: sum(share * -np.expm1(-np.asarray(t) / time) for share, time in creep)


def dahl(breakaway: float, kinds: int = 10) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return breakaways [m] and shares of bristles whose sum rises like 1 − exp(−x/breakaway).

    A population of stick-slip springs rises so where their breakaways are spread like x e^{-x} (Iwan 1966).
    """
    from scipy.stats import gamma

    at = gamma(2.0).ppf((np.arange(kinds) + 0.5) / kinds) * breakaway
    return tuple(float(x) for x in at), (1.0 / kinds,) * kinds


def play(values: Array, width: float, open_: float = 0.0) -> Array:
    """Return what follows a movement with a play [m], of which `open_` [m] is to be taken up for pulling."""
    rows, at = [], values[0] + open_
    for value in values:
        at = min(max(at, value), value + width)
        rows.append(at)
    return np.array(rows)


def late(values: Array, time: Array, delay: float) -> Array:
    """Return readings of a sensor that follows within a time [s] (first order, straight between samples)."""
    rows, at = [values[0]], values[0]
    for k in range(1, len(values)):
        dt = time[k] - time[k - 1]
        slope = (values[k] - values[k - 1]) / dt
        kept = np.exp(-dt / delay)
        at = kept * at + (1.0 - kept) * values[k - 1] + slope * (dt - delay * (1.0 - kept))
        rows.append(at)
    return np.array(rows)
