"""How far the distal end may be from where a command is to bring it: errors of route, rig and state.

Sources: docs/model.md (211) to (213).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.rig import Rig, with_values
from tssgeom.route.pieces import Arcs
from tssgeom.route.route_fit import NO_ERRORS, SharedErrors
from tssgeom.statistics import NORMAL_95
from tssgeom.tendon.capstan import Transmission, elongation_slopes
from tssgeom.tendon.state import UNCHANGED, TendonState, corners, pretensioned, step, transmit
from tssgeom.uncertain import Uncertain, deviations

_OF_ONE_TENDON = (
    "friction.",
    "tendon.",
    "load.",
    "effects[",
)  # begin the keys of numbers that one tendon has
MOST_OUTSIDE = 0.05
"""Probability of being out of tolerance from which a target is flagged [1]; stated: 95 %."""


class DistalErrors(NamedTuple):
    """Standard errors of the distal end after a command, by what the drive holds."""

    tension_out: float
    """Of the distal tension, where the drive goes to the position [N]."""
    displacement_out: float
    """Of the movement of the load, where the drive goes to the position [m]."""
    tension_out_by_tension: float
    """Of the distal tension, where the drive pulls with the tension [N]."""
    displacement_out_by_tension: float
    """Of the movement of the load, where the drive pulls with the tension [m]."""

    def beside(self, other: DistalErrors) -> DistalErrors:
        """Return the errors of two causes that do not depend on each other."""
        return DistalErrors(*map(math.hypot, self, other))


NO_DISTAL_ERRORS = DistalErrors(0.0, 0.0, 0.0, 0.0)


def route_errors(
    before: TendonState,
    now: TendonState,
    ends: Transmission,
    rig: Rig,
    shared: SharedErrors = NO_ERRORS,
    kept: DistalErrors | None = None,
) -> DistalErrors:
    """Return the errors that the route causes; docs/model.md (211).

    Parameters
    ----------
    before, now
        The tendon before and after the command.
    ends
        What the tendon transmits after it.
    rig
        Tendon, friction and load.
    shared
        Errors of the route beside those of its pieces.
    kept
        Errors of the distal end before the command, which stay where it does not move; by default that of the
        distal tension in `before`.
    """
    per_N, tension_out = _load_compliance(rig), ends.tension_out
    stays = before.route is not None and abs(tension_out - before.tension_out) <= UNCHANGED * tension_out
    if stays and kept is not None:
        return kept
    if stays and (error := before.tension_out_se) > 0.0:
        return DistalErrors(error, error * per_N, error, error * per_N)
    arcs = now.route
    if arcs is None:
        return NO_DISTAL_ERRORS
    slopes, by_angle = elongation_slopes(corners(now), arcs, rig)
    k, by_angle = len(arcs.length), by_angle * tension_out
    fed = _fed(ends, rig, arcs.total_length)
    direct = 1.0 - fed * per_N
    both = by_angle * float(slopes @ arcs.covariance[:, k:].sum(axis=1))
    by_tension = ends.tension_out_se**2
    by_position = direct**2 * by_tension - 2.0 * direct * fed * both + (fed * ends.elongation_se) ** 2
    if shared.length > 0.0:
        by_position += shared.length * (fed * float(slopes[:k] @ arcs.length) / arcs.total_length) ** 2
    if shared.angle > 0.0 and (total := arcs.total_angle) > 0.0:
        by_tension += shared.angle * by_angle**2
        stretched = float(slopes[k:] @ arcs.angle) / total
        by_position += shared.angle * (direct * by_angle - fed * stretched) ** 2
    position, pull = math.sqrt(max(by_position, 0.0)), math.sqrt(by_tension)
    return DistalErrors(position, position * per_N, pull, pull * per_N)


def _load_compliance(rig: Rig) -> float:
    """Return how far the load moves for 1 N [m/N]; 0 of a dead weight."""
    return 1.0 / rig.load.stiffness_N_per_m if rig.load.stiffness_N_per_m > 0.0 else 0.0


def _fed(ends: Transmission, rig: Rig, length: float) -> float:
    """Return the distal tension that is lost with each metre that the route takes of the drive [N/m]."""
    if ends.tension_in <= 0.0 or ends.tension_out <= 0.0:
        return 0.0
    ratio = ends.tension_out / ends.tension_in
    stretch = ends.elongation + rig.tendon.compliance_per_N * rig.tendon.pretension_N * length
    per_N_in = stretch / ends.tension_in + ratio * _load_compliance(rig)  # travel of the drive for 1 N
    return ratio / per_N_in if per_N_in > 0.0 else 0.0


def model_errors(ends: Transmission, rig: Rig, route: Arcs | None) -> DistalErrors:
    """Return the errors of a model that left something of measured runs unexplained; docs/model.md (354)."""
    left, per_N = rig.unexplained, _load_compliance(rig)
    fed = 0.0 if route is None else _fed(ends, rig, route.total_length)
    ratio = ends.tension_out / ends.tension_in if ends.tension_in > 0.0 else 0.0
    own = left.tension_out_N or rig.load.stiffness_N_per_m * left.displacement_out_m
    pull = math.hypot(own, ratio * left.tension_in_N)
    position = math.hypot(own, fed * left.elongation_m)
    return DistalErrors(position, position * per_N, pull, pull * per_N)


class Step(NamedTuple):
    """A step of the tendon, without its drive."""

    arcs: Arcs
    """The route after it."""
    time: float | None = None
    """[s]."""
    temperature: float | None = None
    """[°C]."""
    stands: bool | None = None
    """Whether the route is known to stand."""
    shared: SharedErrors = NO_ERRORS
    """Errors of the route that all frames share."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A rig as it may be, and the tendon that it would have after all commands so far."""

    rig: Rig
    weight: float
    """Of its squared deviation in the variance [1]; docs/model.md (212)."""
    located: TendonState
    """The tendon where drives go to positions."""
    pulled: TendonState
    """The tendon where drives pull with tensions."""
    angle_gain: float = 1.0
    """True over sensed angle of the route [1]."""

    def driven(self, at: Step, displacement_in: float | None, tension_in: float | None) -> Variant:
        """Return it after a drive to a position [m], in one history, and to a tension [N], in the other.

        Where one of them is None, the drive was measured as the other, and both histories take that.
        """
        by_tension = (tension_in, None) if tension_in is not None else (None, displacement_in)
        by_position = (None, displacement_in) if displacement_in is not None else by_tension
        located = self._stepped(self.located, at, *by_position)
        if by_position == by_tension and self.located is self.pulled:
            return replace(self, located=located, pulled=located)
        return replace(self, located=located, pulled=self._stepped(self.pulled, at, *by_tension))

    def _stepped(
        self, state: TendonState, at: Step, tension_in: float | None, displacement_in: float | None
    ) -> TendonState:
        return step(
            state,
            at.arcs.scaled(angle=self.angle_gain),
            self.rig,
            tension_in=tension_in,
            displacement_in=displacement_in,
            time=at.time,
            temperature=at.temperature,
            stands=at.stands,
        )


def variants_of(
    rig: Rig, uncertain: Sequence[Uncertain] = (), state: TendonState | None = None
) -> tuple[Variant, ...]:
    """Return two variants of a rig for each of its numbers with an error, and for its `angle_gain_sd`.

    Each has one number a standard deviation higher or lower, or several whose errors go together. All begin
    with `state`; without it each begins at its own pretension.

    Raises SettingsError where a number is out of bounds a standard deviation from its value.
    """
    of_tendon = [each for each in uncertain if each.stated and each.key.startswith(_OF_ONE_TENDON)]
    rigs = [(with_values(rig, values), 1.0) for values in deviations(of_tendon)]
    if (gain := rig.shape.angle_gain_sd) > 0.0:
        rigs += [(rig, max(1.0 - gain, 0.0)), (rig, 1.0 + gain)]
    begun = [(one, gain, pretensioned(one) if state is None else state) for one, gain in rigs]
    return tuple(Variant(one, 0.5, at, at, gain) for one, gain, at in begun)


def spread(variants: Sequence[Variant]) -> DistalErrors:
    """Return how far the distal ends of variants are apart; docs/model.md (212)."""
    if not variants:
        return NO_DISTAL_ERRORS
    ends = [
        (end.tension_out, end.displacement_out)
        for each in variants
        for end in (transmit(each.located, each.rig), transmit(each.pulled, each.rig))
    ]
    values = np.array(ends).reshape(len(variants), 4)
    return DistalErrors(*spread_of(values, np.array([each.weight for each in variants])).tolist())


def with_rig_errors(
    ends: Transmission, variants: Sequence[Variant], rig: Rig, route: Arcs | None, *, by_tension: bool
) -> Transmission:
    """Return what a tendon transmits with the errors of its rig beside those of its route; (212), (354).

    It is driven by a tension or by a position, which its variants have too.
    """
    of_model = model_errors(ends, rig, route)
    pull = of_model.tension_out_by_tension if by_tension else of_model.tension_out
    tension_out = elongation = 0.0
    if variants:
        each = [transmit(one.pulled if by_tension else one.located, one.rig) for one in variants]
        values = np.array([(one.tension_out, one.elongation) for one in each])
        tension_out, elongation = spread_of(values, np.array([one.weight for one in variants])).tolist()
    return ends._replace(
        tension_out_se=math.hypot(ends.tension_out_se, tension_out, pull),
        elongation_se=math.hypot(ends.elongation_se, elongation, rig.unexplained.elongation_m),
    )


def spread_of(values: Matrix, weight: Vector) -> Vector:
    """Return how far values [variants, k] are apart, by the weight of each; docs/model.md (212)."""
    apart = values - weight @ values / weight.sum()
    return np.sqrt(weight @ apart**2)


def outside(miss: float, error: float, tolerance: float) -> float:
    """Return the probability that the distal end misses its target by more than the tolerance.

    `miss` is by how much it is predicted to miss it [m], `error` its standard error [m]; docs/model.md (213).
    """
    if error <= 0.0:
        return float(abs(miss) > tolerance)
    root = math.sqrt(2.0) * error
    return 0.5 * (math.erfc((tolerance - miss) / root) + math.erfc((tolerance + miss) / root))


def is_near(miss: float, error: float, tolerance: float | None) -> bool:
    """Whether the distal end is as near to its target as its error or a tolerance asks for [m]; (215)."""
    if abs(miss) <= error:
        return True
    return tolerance is not None and outside(miss, error, tolerance) <= MOST_OUTSIDE


def bound(error: float) -> float:
    """Return the half width of the 95 % interval of a standard error."""
    return NORMAL_95 * error
