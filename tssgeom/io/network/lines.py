"""Lines out of a stream of bytes that arrives in pieces."""

from __future__ import annotations

from dataclasses import dataclass, field

from tssgeom.errors import ShapeError
from tssgeom.io.formats.jsonl import LONGEST_LINE

LOOKED_AT = 16
"""Of the lines that arrive at once, so many of the last are looked at; the others are dropped."""


@dataclass(slots=True)
class Lines:
    """The lines that came in, without their ends."""

    rest: bytes = b""
    """A line that has not ended yet."""
    overlong: bool = field(default=False)
    """Whether it has been longer than a line may be."""

    def fed(self, data: bytes, most: int | None = None) -> tuple[list[bytes], int]:
        """Take in bytes; return the last `most` lines that are whole, and the number of those before.

        Raises
        ------
        ShapeError
            Where a line is too long; what remains of it is passed over.
        """
        end = data.rfind(b"\n")
        if end < 0:
            self._keep(self.rest + data)
            return [], 0
        whole, rest = data[:end], data[end + 1 :]
        if self.overlong:  # its end has come
            whole = whole.partition(b"\n")[2]
            self.overlong = False
        elif self.rest:
            whole = self.rest + whole
        self.rest = b""
        self._keep(rest)
        if most is None:
            return [line for line in whole.split(b"\n") if line.strip()], 0
        lines = whole.rsplit(b"\n", most)
        before = lines.pop(0) if len(lines) > most else b""
        skipped = before.count(b"\n") + 1 if before.strip() else 0
        return [line for line in lines if line.strip()], skipped

    def _keep(self, rest: bytes) -> None:
        if self.overlong or len(rest) > LONGEST_LINE:
            told, self.overlong, self.rest = self.overlong, True, b""
            if not told:
                raise ShapeError(f"the line is longer than {LONGEST_LINE} bytes (1 MiB): send fewer points")
        else:
            self.rest = rest
