"""The chain in time, compiled from `march.c`: what Python hands over, and what it takes back."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.compiled import library_of
from tests.lumped.assembly import Chain

HERE = Path(__file__).parent
KINDS = {"frame": np.int64, "keep": np.uint8}  # all other arrays hold float64


@cache
def _compiled() -> tuple[Any, Any]:
    return library_of(HERE / "lumped.h", [HERE / f"{name}.c" for name in ("contact", "sweep", "step", "tendon", "march")])


def march(chain: Chain, spans, drive, warmth, frame, weight, growth, turns, keep, records) -> tuple[int, int]:
    """Run steps of `spans` [g] and write the kept ones into `records`; return how many steps and passes.

    A negative number of steps tells the grid point, counted from 1, where no balance was found.
    """
    ffi, library = _compiled()
    held = []  # arrays that C reads

    def struct(kind: str, fields: dict[str, Any]) -> Any:
        made = ffi.new(f"{kind} *")
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                held.append(np.ascontiguousarray(value, KINDS.get(name, np.float64)))
                value = ffi.cast(ffi.typeof(getattr(made, name)), ffi.from_buffer(held[-1]))
            setattr(made, name, value)
        return made

    sizes = {"nodes": len(chain.friction), "creeps": len(chain.creep_time)}
    imposed = {
        "times": len(spans),
        "frames": len(turns),
        "span": spans,
        "drive": drive,
        "warmth": warmth,
        "frame": frame,
        "weight": weight,
        "growth": growth,
        "turns": turns,
        "keep": keep,
    }
    assert growth.shape == (len(turns), sizes["nodes"] - 1)
    assert turns.shape[1] == sizes["nodes"] - 2
    assert all(each.flags.c_contiguous for each in records)  # they are written where they are
    kept = dict(zip(("tension", "position", "friction", "slip", "work"), records, strict=True))
    passes = ffi.new("int64_t *")
    steps = library.march(
        struct("Chain", chain._asdict() | sizes), struct("Imposed", imposed), struct("Records", kept), passes
    )
    return steps, passes[0]
