"""Chains in time, compiled from C: what Python hands over, and what it takes back."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.compiled import library_of
from tests.lumped.assembly import Chain

HERE = Path(__file__).parent
SOURCES = ("contact", "sweep", "step", "tendon", "march")
KINDS = {"frame": np.int64, "keep": np.uint8}  # all other arrays hold float64
RECORDS = ("tension", "position", "friction", "slip", "work")


@cache
def _compiled() -> tuple[Any, Any]:
    return library_of(HERE / "lumped.h", [HERE / f"{name}.c" for name in SOURCES])


class _Handed:
    """What C reads of a run: structs, and the arrays that they point at."""

    def __init__(self, chain: Chain, imposed: dict[str, np.ndarray], records) -> None:
        self.ffi, self.library = _compiled()
        self._arrays: list[np.ndarray] = []
        nodes = len(chain.friction)
        assert imposed["growth"].shape == (len(imposed["turns"]), nodes - 1)
        assert imposed["turns"].shape[1] == nodes - 2
        assert all(each.flags.c_contiguous for each in records)  # they are written where they are
        sizes = {"nodes": nodes, "creeps": len(chain.creep_time)}
        counts = {"times": len(imposed["span"]), "frames": len(imposed["turns"])}
        self.chain = self._struct("Chain", chain._asdict() | sizes)
        self.imposed = self._struct("Imposed", imposed | counts)
        kept = {"ends_only": records[0].shape[1] == 2}
        self.records = self._struct("Records", dict(zip(RECORDS, records, strict=True)) | kept)

    def _struct(self, kind: str, fields: dict[str, Any]) -> Any:
        made = self.ffi.new(f"{kind} *")
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                self._arrays.append(np.ascontiguousarray(value, KINDS.get(name, np.float64)))
                pointer = self.ffi.typeof(getattr(made, name))
                value = self.ffi.cast(pointer, self.ffi.from_buffer(self._arrays[-1]))
            setattr(made, name, value)
        return made


def march(chain: Chain, imposed: dict[str, np.ndarray], records) -> tuple[int, int]:
    """Run the steps of `imposed` and write the kept ones into `records`; return how many steps and passes.

    A negative number of steps is that of the grid point, from 1, where the balance did not converge.
    """
    handed = _Handed(chain, imposed, records)
    passes = handed.ffi.new("int64_t *")
    steps = handed.library.march(handed.chain, handed.imposed, handed.records, passes)
    return steps, passes[0]


class Stepped:
    """One tendon that is stepped from outside: any number of trials, then one of them is kept."""

    def __init__(self, chain: Chain, imposed: dict[str, np.ndarray], records) -> None:
        self._handed = _Handed(chain, imposed, records)
        ffi, library = self._handed.ffi, self._handed.library
        made = library.tendon_new(self._handed.chain, self._handed.imposed)
        if made == ffi.NULL:
            raise MemoryError("no memory for a tendon")
        self._tendon = ffi.gc(made, library.tendon_free)
        self._ends = ffi.new("double[6]")
        self._rows = self.passes = 0

    def next(self, at: int) -> None:
        """Go on to what is imposed at a point of the grid."""
        self._handed.library.tendon_next(self._tendon, self._handed.imposed, at)

    def part(self, share: float) -> float:
        """Take that share of the way there, and return the drive [N or m]."""
        return self._handed.library.tendon_part(self._tendon, share)

    def attempt(self, drive: float, out: float, span: float) -> list[float] | None:
        """Balance it; return tension at drive and load, slopes of the first and of the second by both."""
        used = self._handed.library.tendon_try(self._tendon, drive, out, span)
        self.passes += abs(used)
        if used < 0:
            return None
        self._handed.library.tendon_ends(self._tendon, self._ends)
        return self._handed.ffi.unpack(self._ends, 6)

    def keep(self, span: float) -> None:
        """Make the last attempt the state."""
        self._handed.library.tendon_keep(self._tendon, span)

    def record(self) -> None:
        """Write the state into the next row of the records."""
        self._handed.library.tendon_record(self._tendon, self._handed.records, self._rows)
        self._rows += 1
