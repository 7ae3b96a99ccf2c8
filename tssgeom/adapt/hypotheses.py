"""Mechanisms that may explain a disagreement, each with the numbers that are sought; docs/model.md (207)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np

from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.followed import FollowedNumber, with_values_of
from tssgeom.adapt.readings import Moment
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.effects.laws import FrictionLaw
from tssgeom.effects.route import HiddenBend
from tssgeom.rig import Rig


class HypothesisSettings(NamedTuple):
    """Sizes and odds of mechanisms."""

    bends: int = 6
    """Positions at which a hidden bend is tried [1]. Chosen: neighbours do nearly the same."""
    parts: int = 4
    """Parts of the route on which friction may change by itself [1]; chosen: the sentence names them."""
    length: float = 1e-3
    """Standard deviation of a length that the tendon gains [m]. Chosen: strands that break give tenths of a
    mm."""
    of_route: float = 0.02
    """Share of the sensed angle by which it changes where the sensor is at fault [1]; chosen."""
    shape_first: float = 7.0
    """Logarithm of the odds for the shape where it changes at that time [1]. Chosen: 1000; friction does
    the same."""
    imitators_last: float = -6.0
    """Logarithm of the odds for what fits other mechanisms as well [1]: friction that changes part by part,
    and a sensor that errs in gain and zero. Chosen: sensors fail wholly, or their zero drifts."""
    zero: float = 1.0
    """Standard deviation of a zero that moved, and of its further change in an hour [N]. Chosen: some per
    cent of what cells of 20 to 50 N span."""
    zero_noises: float = 30.0
    """The same of a channel of a machine, over its noise [1]. Chosen: 1 N of a cell with a noise of 30 mN."""
    turn: float = 1.0
    """Time within which a sensed angle changes where the sensor is at fault [s]; chosen: routes move
    slower."""


TRIED = HypothesisSettings()


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A mechanism with the numbers that are sought."""

    mechanism: str
    where: str
    numbers: tuple[FollowedNumber, ...]
    words: str
    """With `{}` for each value."""
    rig: Rig
    """With the effect whose number is sought."""
    log_prior: float = 0.0
    length: float = 0.0
    """Of the route where its numbers are factors of friction on the parts of it [m]; else 0."""
    mutes: bool = False
    """Whether a sensor of which this is true is not used any more."""

    def rig_with(self, values: Sequence[float]) -> Rig:
        """Return the rig with these values of the numbers."""
        if self.length == 0.0:
            return with_values_of(self.rig, self.numbers, values)
        x = self.length * (np.arange(len(values)) + 0.5) / len(values)
        law = FrictionLaw(
            over="arc_length", x=tuple(x.tolist()), factor=tuple(max(one, 0.01) for one in values)
        )
        return msgspec.structs.replace(self.rig, effects=(*self.rig.effects, law))


Numbering = Callable[..., FollowedNumber]
"""Makes a number of a hypothesis: key, value where it is not followed yet, sd, lower bound, drift an hour."""


def numbering(sound: Ensemble) -> Numbering:
    """Return what makes the numbers of hypotheses: one that a filter follows begins where it stands."""
    known = dict(zip(sound.keys, sound.values.tolist(), strict=True))

    def number(
        key: str, value: float, sd: float, lower: float = -math.inf, hourly: float = 0.0
    ) -> FollowedNumber:
        return FollowedNumber(key, known.get(key, value), sd, hourly, lower, math.inf)

    return number


def followed_so_far(sound: Ensemble, but: str) -> Iterator[FollowedNumber]:
    """Yield what a filter follows, to be sought anew: a fault that grows, or one before, was taken for drift.

    Parameters
    ----------
    sound
        The filter.
    but
        A number that is sought itself.
    """
    for one, value in zip(sound.numbers, sound.values.tolist(), strict=True):
        if one.key != but:
            yield replace(one, value=value)


def friction_changed(rig: Rig, number: Numbering) -> Hypothesis:
    """Return that friction is another one along the whole route."""
    friction = rig.friction.coefficient
    return Hypothesis(
        "friction_over_time",
        "along the route",
        (number("friction.coefficient", friction, 0.5 * friction, 0.0),),
        f"friction went from {friction:.3g} to {{:.3g}}",
        rig,
    )


def sensed_angle_changed(rig: Rig, number: Numbering, tendons: str) -> Hypothesis:
    """Return that the sensor of the shape is off since it saw a turn."""
    return Hypothesis(
        "sensed_angle",
        "shape",
        (number("route.angle_gain", rig.route.angle_gain, 0.3, 0.1),),
        f"the sensed angle changed and the {tendons} did not feel it: true over sensed is {{:.3g}}",
        rig,
        TRIED.shape_first,
    )


def hidden_bends(rig: Rig, number: Numbering, length: float) -> Iterator[Hypothesis]:
    """Yield bends along a route of a length [m] that the shape does not show; none where the rig has one."""
    if any(isinstance(effect, HiddenBend) for effect in rig.effects):
        return
    for i in range(TRIED.bends):
        at = length * (i + 0.5) / TRIED.bends
        yield Hypothesis(
            "route_angle",
            f"{at:.2f} m from the proximal end",
            (number("hidden_bend.angle_rad", 0.0, 0.8, 0.0),),
            "a bend of {:.2g} rad that the shape does not show",
            msgspec.structs.replace(rig, effects=(*rig.effects, HiddenBend(at_m=at, angle_rad=0.0))),
            -math.log(TRIED.bends),
        )


def hypotheses(sound: RigFilter, moments: Sequence[Moment], since: float) -> Iterator[Hypothesis]:
    """Yield the mechanisms that are tried on a filter that was sound until then."""
    rig, number = sound.rig_now(), numbering(sound)
    compliance, length = rig.tendon.compliance_per_N, sound.cut.total_length
    friction = friction_changed(rig, number)
    yield friction
    if others := tuple(followed_so_far(sound, "friction.coefficient")):  # else it is the same once more
        yield replace(friction, numbers=(*friction.numbers, *others))
    if not any(isinstance(effect, FrictionLaw) for effect in rig.effects):
        parts = tuple(FollowedNumber(f"part {i}", 1.0, 0.5, 0.0, 0.0, 10.0) for i in range(TRIED.parts))
        yield Hypothesis(
            "friction_over_time",
            "on a part of the route",
            parts,
            "friction on its quarters is {:.2g}, {:.2g}, {:.2g}, {:.2g} of what it was",
            rig,
            TRIED.imitators_last,
            length,
        )
    if turned(moments, since):
        yield sensed_angle_changed(rig, number, "tendon")
    yield Hypothesis(
        "strain_over_time",
        "along the tendon",
        (
            number("tendon.compliance_per_N", compliance, 0.5 * compliance, 1e-6),
            number("pretension_error.error_N", 0.0, TRIED.length / (compliance * length)),
        ),
        f"1/EA went from {compliance:.3g} to {{:.3g}} 1/N, the pretension by {{:+.3g}} N",
        rig,
    )
    yield from hidden_bends(rig, number, length)
    yield Hypothesis(
        "play_at_drive",
        "drive",
        (number("backlash.width_m", 0.0, 1e-3, 0.0), *followed_so_far(sound, "backlash.width_m")),
        "play of {:.2g} m at the drive",
        rig,
    )
    for channel, end in (("tension_in_N", "tension_in"), ("tension_out_N", "tension_out")):
        if any(getattr(one.readings, end) is not None for one in moments) and channel not in sound.muted:
            yield Hypothesis(
                "sensor",
                channel,
                (number(f"{end}_offset.offset_N", 0.0, TRIED.zero, hourly=TRIED.zero),),
                f"the zero of {channel} is {{:+.3g}} N",
                rig,
            )
            yield Hypothesis(
                "sensor",
                channel,
                (
                    number(f"{end}_gain.gain_error", 0.0, 0.5, -0.5),
                    number(f"{end}_offset.offset_N", 0.0, 5.0),
                ),
                f"{channel} reads {{:+.2g}} of its value and {{:+.3g}} N too much",
                rig,
                TRIED.imitators_last,
                mutes=True,
            )


def turned(moments: Sequence[Moment], since: float) -> bool:
    """Whether the sensed angle jumped before or when the disagreement began."""
    near = [one for one in moments if one.time < since + TRIED.turn]
    if not near:  # it began before the first moment that is kept
        return False
    times = np.array([one.time for one in near])
    angles = np.array([one.arcs.total_angle for one in near])
    later = np.minimum(np.searchsorted(times, times + TRIED.turn), len(times) - 1)
    return bool(np.abs(angles[later] - angles).max() > TRIED.of_route * angles[0])
