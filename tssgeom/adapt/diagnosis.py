"""Which mechanism explains a disagreement best so far: each is followed through the last seconds; (207)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np

from tssgeom.adapt.followed import FollowedNumber
from tssgeom.adapt.rig_filter import CHANNELS, Readings, RigFilter, noise_variance
from tssgeom.effects.route import HiddenBend
from tssgeom.errors import TssgeomError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


class Moment(NamedTuple):
    """What came in at one time."""

    time: float
    arcs: Arcs
    readings: Readings
    warmth: float


class DiagnosisSettings(NamedTuple):
    """Numbers of the search for a mechanism."""

    most_moments: int = 150
    """Frames through which each mechanism is followed [1]. Chosen: a twentieth of a second of work."""
    slice: int = 8
    """Of them between two frames of a stream [1]. Chosen: 3 ms."""
    bends: int = 6
    """Positions at which a hidden bend is tried [1]. Chosen: neighbours can hardly be told apart."""
    length: float = 3e-3
    """Standard deviation of a length that the tendon gains [m]. Chosen: strands that break give some mm."""
    together: float = 4.0
    """Readings that count as one [1]. Chosen: errors of the model stay alike for so long."""
    clipped: float = 50.0
    """Square of a standardised innovation beyond which it counts as if it were there [1]; chosen."""
    fewest: int = 20
    """Readings that show that a sensor stands [1]; chosen."""
    still: float = 9.0
    """Noises within which all readings of a sensor that stands lie [1]; chosen: 1000 readings of noise lie in 7."""
    moved: float = 30.0
    """Noises by which the other sensor at the drive moves meanwhile [1]; chosen."""
    follows: float = 10.0
    """Change of what is tried, over its standard deviation, in an hour [1]. Chosen: faults take seconds to grow."""
    of_route: float = 0.02
    """Share of the sensed angle by which it changes where the sensor is at fault [1]; chosen."""


_SETTINGS = DiagnosisSettings()


@dataclass(frozen=True, slots=True)
class Explanation:
    """A mechanism, and what it makes of the last seconds."""

    mechanism: str
    """As in reports of `discover`: `friction_over_time`, `strain_over_time`, `route_angle`, `play_at_drive`,
    `sensor`, `sensed_angle`."""
    where: str
    """On what it acts, or which channel."""
    probability: float
    """Among those that were tried [1]."""
    sentence: str
    """In plain words, with its size."""
    filter: RigFilter
    """The rig with it, followed up to now; where a sensor is at fault, without its readings."""


@dataclass(frozen=True, slots=True)
class _Hypothesis:
    mechanism: str
    where: str
    numbers: tuple[FollowedNumber, ...]
    words: str
    """With `{}` for each value."""
    rig: Rig | None = None
    """With the effect whose number is followed."""
    log_prior: float = 0.0


def explained(
    start: RigFilter, moments: Sequence[Moment], since: float
) -> Iterator[tuple[Explanation, ...] | None]:
    """Yield None after each slice of work, and at last the explanations, the likeliest first.

    Parameters
    ----------
    start
        The filter as it was before the disagreement.
    moments
        What came in from then on.
    since
        When it began [s].
    """
    stopped = _stopped_sensor(start, moments, since)
    if stopped is not None:
        yield (stopped,)
        return
    sound = start.with_more(())
    for i, moment in enumerate(one for one in moments if one.time < since):
        sound.step(moment.arcs, moment.readings, moment.time, moment.warmth)
        if i % _SETTINGS.slice == _SETTINGS.slice - 1:
            yield None
    after = [one for one in moments if one.time >= since]
    step = -(-len(after) // _SETTINGS.most_moments)
    chosen = [*after[:-1:step], after[-1]]
    rated = list[tuple[float, _Hypothesis, RigFilter]]()
    for hypothesis in _hypotheses(sound, moments, since):
        followed = sound.with_more(
            [one for one in hypothesis.numbers if one.key not in sound.keys], hypothesis.rig
        )
        followed.outlier = math.inf
        followed.reopen(_wide(hypothesis, followed))
        total, lost = hypothesis.log_prior, False
        for i, moment in enumerate(chosen):
            try:
                known = followed.step(moment.arcs, moment.readings, moment.time, moment.warmth)
            except TssgeomError:
                lost = True
                break
            total += _log_likelihood(followed, known.off, known.off_sd) / _SETTINGS.together
            if i % _SETTINGS.slice == _SETTINGS.slice - 1:
                yield None
        followed.outlier = sound.outlier
        if not lost:
            rated.append((total, hypothesis, followed))
    rated.sort(key=lambda one: -one[0])
    if rated and rated[0][1].mechanism == "sensor":  # the rig goes on without that channel
        followed = sound.with_more(())
        followed.muted.add(rated[0][1].where)
        for i, moment in enumerate(chosen):
            followed.step(moment.arcs, moment.readings, moment.time, moment.warmth)
            if i % _SETTINGS.slice == _SETTINGS.slice - 1:
                yield None
        rated[0] = (*rated[0][:2], followed)
    weights = np.exp([total - rated[0][0] for total, _, _ in rated])
    yield tuple(
        _explanation(hypothesis, followed, float(weight / weights.sum()))
        for weight, (_, hypothesis, followed) in zip(weights, rated, strict=True)
    )


def _log_likelihood(followed: RigFilter, off: np.ndarray, sd: np.ndarray) -> float:
    noise = np.sqrt([max(noise_variance(followed.rig.sensors.get(name)), 1e-12) for name in CHANNELS])
    each = -0.5 * np.minimum((off / sd) ** 2, _SETTINGS.clipped) - np.log(sd / noise)
    return float(np.nansum(each))


def _explanation(one: _Hypothesis, followed: RigFilter, probability: float) -> Explanation:
    values = dict(zip(followed.keys, followed.values.tolist(), strict=True))
    words = one.words.format(*(values.get(number.key, math.nan) for number in one.numbers))
    return Explanation(one.mechanism, one.where, probability, words, followed)


def _wide(one: _Hypothesis, followed: RigFilter) -> np.ndarray:
    sds = {number.key: number.sd for number in one.numbers}
    return np.array([sds.get(key, 0.0) for key in followed.keys])


def _hypotheses(start: RigFilter, moments: Sequence[Moment], since: float) -> Iterator[_Hypothesis]:
    rig, now = start.rig, dict(zip(start.keys, start.values.tolist(), strict=True))

    def number(key: str, value: float, sd: float, lower: float = -math.inf) -> FollowedNumber:
        known = next((one for one in start.numbers if one.key == key), None)
        if known is not None:
            return replace(known, sd=sd)
        return FollowedNumber(key, value, sd, _SETTINGS.follows * sd, lower, math.inf)

    friction = now.get("friction.coefficient", rig.friction.coefficient)
    compliance = now.get("tendon.compliance_per_N", rig.tendon.compliance_per_N)
    length = start.cut.total_length
    yield _Hypothesis(
        "friction_over_time",
        "along the route",
        (number("friction.coefficient", friction, 0.5 * friction, 0.0),),
        f"friction went from {friction:.3g} to {{:.3g}}",
    )
    if _turned(moments, since):
        yield _Hypothesis(
            "sensed_angle",
            "shape",
            (number("route.angle_gain", rig.route.angle_gain, 0.3, 0.1),),
            "the sensed angle changed and the tendon did not feel it: true over sensed is {:.3g}",
            log_prior=math.log(10.0),  # chosen: that both change at one time is no chance
        )
    yield _Hypothesis(
        "strain_over_time",
        "along the tendon",
        (
            number("tendon.compliance_per_N", compliance, 0.5 * compliance, 1e-6),
            number("pretension_error.error_N", 0.0, _SETTINGS.length / (compliance * length)),
        ),
        f"the tendon went from {compliance:.3g} to {{:.3g}} 1/N and lost {{:.3g}} N of pretension",
    )
    if not any(isinstance(effect, HiddenBend) for effect in rig.effects):
        for i in range(_SETTINGS.bends):
            at = length * (i + 0.5) / _SETTINGS.bends
            bend = HiddenBend(at_m=at, angle_rad=0.0)
            yield _Hypothesis(
                "route_angle",
                f"{at:.3g} m from the proximal end",
                (number("hidden_bend.angle_rad", 0.0, 0.8, 0.0),),
                "a bend of {:.2g} rad that the shape does not show",
                msgspec.structs.replace(rig, effects=(*rig.effects, bend)),
                -math.log(_SETTINGS.bends),
            )
    yield _Hypothesis(
        "play_at_drive",
        "drive",
        (number("backlash.width_m", now.get("backlash.width_m", 0.0), 1e-3, 0.0),),
        "play of {:.3g} m at the drive",
    )
    for channel, end in (("tension_in_N", "tension_in"), ("tension_out_N", "tension_out")):
        if any(getattr(one.readings, end) is not None for one in moments) and channel not in start.muted:
            yield _Hypothesis(
                "sensor",
                channel,
                (
                    number(f"{end}_gain.gain_error", 0.0, 0.7, -1.0),
                    number(f"{end}_offset.offset_N", now.get(f"{end}_offset.offset_N", 0.0), 5.0),
                ),
                f"{channel} reads {{:+.2g}} of its value and {{:+.3g}} N too much",
            )


def _turned(moments: Sequence[Moment], since: float) -> bool:
    """Whether the sensed angle changed when the disagreement began."""
    before = [one.arcs.total_angle for one in moments if one.time < since]
    after = [one.arcs.total_angle for one in moments if one.time >= since]
    if not before or not after:
        return False
    first = float(np.median(before))
    return abs(float(np.median(after)) - first) > _SETTINGS.of_route * first


def _stopped_sensor(start: RigFilter, moments: Sequence[Moment], since: float) -> Explanation | None:
    """Return the fault of a sensor at the drive that stands while the other one there moves."""
    after = [one.readings for one in moments if one.time >= since]
    pairs = [(one.displacement_in, one.tension_in) for one in after]
    if len(pairs) < _SETTINGS.fewest or any(None in pair for pair in pairs):
        return None
    names, units = ("displacement_in_m", "tension_in_N"), ("m", "N")
    sensors = start.rig.sensors
    readings = np.array(pairs, dtype=np.float64)[1:].T
    moved = np.ptp(readings, axis=1)
    noise = np.array([math.sqrt(noise_variance(sensors.get(name))) for name in names])
    for which, other in ((0, 1), (1, 0)):
        if moved[which] <= _SETTINGS.still * noise[which] and moved[other] > _SETTINGS.moved * noise[other]:
            words = (
                f"{names[which]} stands at {readings[which, -1]:.4g} {units[which]} while {names[other]} moves by "
                f"{moved[other]:.3g} {units[other]}"
            )
            followed = start.with_more(())
            followed.muted.add(names[which])
            for moment in moments[:: -(-len(moments) // _SETTINGS.most_moments)]:
                given = moment.readings._replace(displacement_in=None) if which == 0 else moment.readings
                followed.step(moment.arcs, given, moment.time, moment.warmth)
            return Explanation("sensor", names[which], 1.0, words, followed)
    return None
