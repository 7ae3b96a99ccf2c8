"""Shapes out of OpenIGTLink sensors: one message for each, or one that lists them all."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tssgeom.arrays import Points
from tssgeom.errors import ShapeError
from tssgeom.io.network.igtl import Message
from tssgeom.io.network.mailbox import LIMITS


@dataclass(slots=True)
class Rounds:
    """Shapes out of sensors that send their positions one after the other.

    A shape is complete when every sensor has sent its position, or when one of them sends again; a sensor
    that has not is a point that was not observed. Its metadata are those of all its messages, the newest of
    each name.
    """

    names: Sequence[str]
    """The sensors, proximal to distal; by default all that send, in the order of their names."""
    learning: bool
    _received: dict[str, Message] = field(default_factory=dict)

    def shape(self, message: Message) -> tuple[Message, Points] | None:
        """Add one position; return a shape if one is complete [n, 3], and its last message with all metadata.

        Raises ShapeError where more sensors than points of a frame have sent since one sent again; they begin
        anew.
        """
        whole, device = None, message.header.device
        if not self.learning and device not in self.names:
            return None
        if device in self._received:
            whole = self._ended()
        if self.learning and max(len(self._received) + 1, len(self.names)) > LIMITS.points:
            raise self._many(device)
        self._received[device] = message
        complete = len(self._received) == len(self.names) and set(self.names) == set(self._received)
        return self._ended() if complete else whole

    def listed(self, message: Message) -> Points:
        """Return the shape of one message that lists sensors by name [n, 3].

        Raises ShapeError where two of them have one name, or where they are more than the points of a frame.
        """
        rows = dict(zip(message.sensors, message.positions, strict=True))
        if len(rows) < len(message.sensors):
            kind, names = message.header.kind, message.sensors
            twice = next(name for k, name in enumerate(names) if name in names[:k])
            raise ShapeError(f"{kind}: two sensors are named {twice!r}: give each a name of its own")
        if self.learning:
            if len(rows.keys() | self.names) > LIMITS.points:
                raise self._many(message.sensors[-1])
            self._learn(rows)
        unknown = np.full(3, np.nan)
        return np.array([rows.get(name, unknown) for name in self.names]).reshape(-1, 3)

    def _many(self, last: str) -> ShapeError:
        self._received.clear()
        self.names = ()
        many = f"more than {LIMITS.points} sensors, the last is {last!r}"
        return ShapeError(f"{many}: name them in the address, ?sensors=A,B")

    def _learn(self, names: Collection[str]) -> None:
        if not set(names) <= set(self.names):
            self.names = sorted({*self.names, *names}, key=_natural)

    def _ended(self) -> tuple[Message, Points]:
        metadata = {name: text for each in self._received.values() for name, text in each.metadata.items()}
        last = replace(next(reversed(self._received.values())), metadata=metadata)
        if self.learning:
            self._learn(self._received)
        unknown = np.full((1, 3), np.nan)
        rows = [self._received[name].positions if name in self._received else unknown for name in self.names]
        self._received.clear()
        return last, np.concatenate(rows)


def _natural(name: str) -> list[tuple[int, int | str]]:
    """Order numbers inside names as numbers."""
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in re.split(r"(\d+)", name) if part]
