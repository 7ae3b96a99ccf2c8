"""How good a calibration is: residuals beside noise, whether they are white, and the test of a rig."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.statistics import EVIDENCE_SCALE, robust_sd
from tssgeom.uncertain import Unexplained


@dataclass(frozen=True, slots=True)
class FitTest:
    """Chosen: on the runs of tests/campaigns with each effect, and on measured ones."""

    most_of_range: float = 0.1
    """Measured: an effect of tests/campaigns that the model lacks leaves at most 0.046 (friction of straight
    parts); twice that. Rms of residuals over the range of a channel from which the fit fails, where it is
    also beyond `most_of_noise` [1]."""
    most_of_noise: float = 5.0
    """Chosen: five standard deviations. Rms of residuals over the noise of the readings [1]."""

    @property
    def sound(self) -> float:
        """Half of what fails, beyond the 2.2 that sound runs of `benchmarks.calibration` leave [1]."""
        return 0.5 * self.most_of_noise


FIT_TEST = FitTest()


@dataclass(frozen=True, slots=True)
class RobustFit:
    """How calibration weighs readings. Chosen on the runs of `benchmarks.calibration` and `machines`."""

    first_sigma: float = 0.02
    """Of the range of a channel: its standard deviation in the first round [1]; chosen."""
    rounds: int = 2
    """Rounds after the first, in which weights and estimates converge [1]; chosen."""


ROBUST = RobustFit()


@dataclass(frozen=True, slots=True)
class ChannelFit:
    """How one measured channel is met."""

    name: str
    unit: str
    rms: float
    """Of what is left [unit]."""
    count: int
    effective_count: float
    """Readings that are worth as much, were they independent [1]."""
    noise: float
    """White noise of the readings, digits included, and what that of a position that drives adds [unit]."""
    span: float
    """Range of the readings [unit]."""
    whiteness_p: float
    """Probability of residuals as correlated as these, were they white: Ljung and Box [1]."""

    @property
    def over_noise(self) -> float:
        """Rms of the residuals over the noise [1]."""
        return self.rms / self.noise if self.noise > 0.0 else np.inf

    @property
    def over_range(self) -> float:
        """Rms of the residuals over the range [1]."""
        return self.rms / self.span if self.span > 0.0 else np.inf

    @property
    def passes(self) -> bool:
        """Whether the residuals are small, beside the range or beside the noise."""
        return self.over_range <= FIT_TEST.most_of_range or self.over_noise <= FIT_TEST.most_of_noise

    @property
    def is_white(self) -> bool:
        """Whether the residuals may be white."""
        return self.whiteness_p >= EVIDENCE_SCALE.false_alarms

    @property
    def lacks_an_effect(self) -> bool:
        """Whether the residuals are well above the noise and last, as those of a model that lacks an effect.

        Small ones last where a sensor's scale is bent, or the drive turns between two readings.
        """
        return self.over_noise > FIT_TEST.sound and not self.is_white

    @property
    def channel(self) -> str:
        """The channel in SI, without the run that it is of: `tension_out_N`."""
        name, ending = self.name.partition(" of ")[0], f"_{self.unit}"
        return f"{name.removesuffix(ending)}{ending}"


def unexplained(fits: Iterable[ChannelFit]) -> Unexplained:
    """Return what a fit leaves of channels that lack an effect, beyond their noise; docs/model.md (354)."""
    return Unexplained.beyond((fit.channel, fit.rms, fit.noise) for fit in fits if fit.lacks_an_effect)


def whiteness(left: Vector) -> float:
    """Return the probability of residuals [n] at least as correlated as these, if they were white.

    Notes
    -----
    Source: Ljung and Box, Biometrika 65 (1978) 297: Q = n (n + 2) Σ r_k² / (n - k) over the lags k is χ²;
    20 lags, of five readings each at least: Box, Jenkins and Reinsel, Time series analysis (1994).
    """
    n = len(left)
    lags = min(20, n // 5)
    off = left - left.mean() if n else left
    power = float(off @ off)
    if lags < 1 or power <= 0.0:
        return 1.0
    square = sum(float(off[k:] @ off[:-k]) ** 2 / (n - k) for k in range(1, lags + 1))
    return float(chdtrc(lags, n * (n + 2) * square / power**2))


def is_identified(sd: float, assumed: float = 1.0) -> bool:
    """Whether readings have halved the standard deviation that was assumed of a number."""
    return bool(sd < 0.5 * assumed)


def failures(
    friction: float | None,
    channels: Sequence[ChannelFit],
    at_bounds: Sequence[str],
    predicted: Mapping[str, Vector],
) -> Iterator[str]:
    """Yield why a calibration is not to be used, a sentence each; none where it passes its test."""
    limit = FIT_TEST
    for each in channels:
        if not each.passes:
            yield (
                f"{each.name} is met within {each.over_range:.1%} of its range and {each.over_noise:.3g} × "
                f"its noise; at most {limit.most_of_range:.0%} or {limit.most_of_noise:g} × are accepted"
            )
    if friction is not None and friction > (most := PLAUSIBLE.most_rig_friction):
        yield f"the friction coefficient is {friction:.3g}; at most {most:g} is accepted"
    for name in at_bounds:
        yield f"{name} is at its bound"
    if not all(np.isfinite(values).all() for values in predicted.values()):
        yield "the fitted model is not finite"


def misfits(channels: Sequence[ChannelFit]) -> Iterator[str]:
    """Yield a warning for each channel whose residuals show that the model lacks an effect."""
    for each in channels:
        if each.lacks_an_effect:
            yield (
                f"{each.name} is met within {each.rms:.3g} {each.unit}, {each.over_noise:.3g} × its noise, "
                "and what is left is not white: the model lacks an effect, and the intervals do not count "
                "what it changes; `tssgeom discover` tries to identify it"
            )


def squares(left_over: Vector, counts: list[int], parameters: int, inflation: Vector) -> Vector:
    """Squares of residuals over the variance that the fit assumed; 1 for what the prior adds."""
    worth = np.repeat(inflation, counts)
    free = max(1.0 - parameters / max(float(np.sum(counts / inflation)), 1.0), 0.1)
    return np.concatenate([left_over**2 * worth / free, np.ones(parameters)])


def spread(left: Vector) -> float:
    """Return the standard deviation of residuals with a few that are far off."""
    robust = robust_sd(left - np.median(left))
    clipped = np.clip(left, -3 * robust, 3 * robust) if robust > 0 else left
    return max(float(np.sqrt(np.mean(clipped**2))), 1e-12)


def first_weights(measured: Sequence[Vector]) -> list[Vector]:
    """Return the weight of every reading of each block before anything is known of its error [1/SI]."""
    sigmas = [max(ROBUST.first_sigma * float(np.ptp(values)), 1e-9) for values in measured]
    return [np.full(len(values), 1.0 / sigma) for values, sigma in zip(measured, sigmas, strict=True)]


def weights_of(left: Sequence[Vector], least: Iterable[float] | None = None) -> tuple[list[Vector], Vector]:
    """Return the weight of every reading of each block [1/SI], and how many are worth one [1].

    A weight follows from what is left, less for those that are far off; docs/model.md (72), (181). `least`
    is what rounding leaves of each block, since a fit of as many numbers as readings leaves nothing.
    """
    weights, inflations = [], []
    for each, floor in zip(left, [0.0] * len(left) if least is None else least, strict=True):
        sigma = max(spread(each), floor)
        inflation = inflation_of(each / sigma)
        far = np.maximum(np.abs(each) / sigma, 1e-12)
        weights.append(np.sqrt(np.minimum(1.0, CHANCE.clear / far) / inflation) / sigma)
        inflations.append(inflation)
    return weights, np.array(inflations)


def inflation_of(left: Vector) -> float:
    """Return readings over effective ones, 1 + 2 Σ autocorrelation while positive; docs/model.md (73)."""
    clipped = np.clip(left, -CHANCE.clear, CHANCE.clear)
    size = len(clipped)
    padded = np.fft.rfft(clipped - clipped.mean(), 2 * size)
    power = np.fft.irfft(np.abs(padded) ** 2)[: size // 2]
    if power[0] <= 0.0:
        return 1.0
    correlation = power / power[0]
    pairs = correlation[:-1:2] + correlation[1::2][: len(correlation[:-1:2])]
    ends = np.flatnonzero(pairs <= 0.0)
    total = 2.0 * float(np.sum(pairs[: ends[0] if len(ends) else len(pairs)])) - 1.0
    return float(np.clip(total, 1.0, size / 3))
