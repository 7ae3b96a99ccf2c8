"""Where each effect of the library is first tried: at a size, with scales and choices that differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace as changed

from tssgeom.effects import KINDS, Library, with_size
from tssgeom.identify.stack import Stack

_TRIAL = 0.5  # of the typical size
_SCALES: Mapping[str, tuple[float, ...]] = {
    "scale_N": (0.7, 2.0, 5.0),
    "time_s": (3.0, 15.0, 60.0),
    "travel_m": (0.01, 0.03, 0.1),
}
"""Starts of scales [N, s, m]."""
_PLACES = (np.arange(9) + 0.5) / 9.0  # of a hidden bend, over the length


@dataclass(frozen=True, slots=True)
class Variant:
    """An effect at a trial size."""

    name: str
    effect: Library
    amplitude: str
    """The parameter that switches it on."""
    free: tuple[str, ...]
    """What is fitted of it."""

    @property
    def positive(self) -> bool:
        """Whether its amplitude cannot be negative."""
        return self.effect.parameters[self.amplitude].lower == 0.0

    def sized(self, amplitude: float) -> Library:
        """Return the effect at another amplitude, within its bounds."""
        told = self.effect.parameters[self.amplitude]
        return changed(self.effect, **{self.amplitude: min(max(amplitude, told.lower), told.upper)})


def variants(stack: Stack) -> tuple[tuple[Variant, ...], dict[str, str]]:
    """Return all that can be tried on these readings, and why the rest cannot."""
    out, absent = list[Variant](), dict[str, str]()
    channels = {name for reading in stack.readings for name in reading.measured}
    drive = stack.readings[0].drive
    given = set.intersection(*(set(reading.given) for reading in stack.readings)) | channels
    for name, kind in KINDS.items():
        touched = kind.by_position if drive == "displacement_in_m" else kind.by_force
        lacking = [column for column in kind.needs if column not in given]
        if lacking:
            absent[name] = f"{', '.join(lacking)} was not measured"
        elif not channels & set(touched):
            absent[name] = f"it shows in {', '.join(touched)}, of which none was measured"
        else:
            out += list(_of(name, stack, channels))
    return tuple(out), absent


def _of(name: str, stack: Stack, channels: set[str]) -> Iterator[Variant]:
    effect = with_size(KINDS[name], _TRIAL)
    if name.startswith("end_fitting"):
        for key in effect.parameters:
            alone = {other: 0.0 for other in effect.parameters if other != key}
            yield Variant(name, changed(effect, **alone), key, (key,))
        return
    amplitude = next(key for key, told in effect.parameters.items() if told.switch)
    free = tuple(key for key, told in effect.parameters.items() if told.fitted)
    for told in _started(name, effect, stack, channels):
        yield Variant(name, told, amplitude, free)


def _started(name: str, effect: Library, stack: Stack, channels: set[str]) -> Iterator[Library]:
    if name == "hidden_bend":
        length = min(reading.route.arcs.total_length for reading in stack.readings)
        yield from (changed(effect, at_m=float(share * length)) for share in _PLACES)
    elif name == "channel_lag":
        answers = [channel for channel in channels if channel != stack.readings[0].drive]
        yield from (changed(effect, channel=channel) for channel in sorted(answers))
    elif name == "slack_take_up":
        for end in ("proximal", "distal"):
            yield from (changed(effect, scale_N=scale, end=end) for scale in _SCALES["scale_N"])
    else:
        scale = next((key for key in effect.parameters if key in _SCALES), None)
        yield from [effect] if scale is None else (changed(effect, **{scale: v}) for v in _SCALES[scale])
