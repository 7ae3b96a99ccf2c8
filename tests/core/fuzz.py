"""Calls every entry of the core with numbers that make no sense, and reports calls that do not end.

    python -m tests.core.fuzz --seconds 60                           # crashes and endless loops
    python -m tests.core.sanitized tests.core.fuzz --seconds 60      # reads and writes beyond an array too

Sizes agree, as the wrappers see to; everything else is at random: NaN, infinity, zeros, coincident stations,
indices beyond the ends. An entry may answer with numbers, NaN or an error, within the time stated below.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from itertools import count
from typing import Any

import numpy as np

from tssgeom import core
from tssgeom.core.build import HERE, Prototype, read_prototypes
from tssgeom.errors import TssgeomError

SLOWEST_S = 120.0
"""Most time of the processor of a call that counts as one that ends, with sanitizers; usual ones take
microseconds.

A tendon whose laws make no sense may go through all passes and sweeps of its equilibrium, and a machine
through that for each position that it tries: of 285 000 calls one took 18 s, without sanitizers.
"""
_ALLOWED = (TssgeomError, ValueError, TypeError, OverflowError, MemoryError)


def entries() -> dict[str, Prototype]:
    """Return the prototypes of all entries by name."""
    sources = [path.read_text(encoding="utf-8") for path in sorted(HERE.glob("*.c"))]
    return {each.name: each for source in sources for each in read_prototypes(source)}


def numbers(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Return numbers of one of many kinds."""
    kind = rng.integers(9)
    x = rng.normal(size=shape)
    if kind == 0:
        x = np.zeros(shape)
    elif kind == 1:
        x = np.cumsum(np.abs(x), axis=0)
    elif kind == 2:
        x = np.abs(x)
    elif kind == 3:
        x = np.ones(shape)
    elif kind == 4:
        x = x * 10.0 ** rng.uniform(-300, 300)
    elif kind == 5:
        x = np.round(x)
    if x.size and rng.integers(4) == 0:
        x = np.array(x)
        x.flat[rng.integers(x.size)] = rng.choice([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e300, 5e-324])
    return np.ascontiguousarray(x)


def arguments(rng: np.random.Generator, entry: Prototype) -> list[Any]:
    """Return arguments whose sizes agree."""
    sizes = {one.name: int(rng.integers(0, 14)) for one in entry.parameters if one.type == "int64_t"}
    given = []
    shapes = " ".join(part for one in entry.parameters for part in one.shape if one.role != "OUT")
    for one in entry.parameters:
        if one.role in ("OUT", "WORK"):
            continue
        if one.shape:
            shape = tuple(max(int(eval(part, {}, sizes)), 0) for part in one.shape)
            if one.role == "OPTIONAL" and rng.integers(2):
                given.append((one.name, None))
            elif one.type == "double":
                given.append((one.name, numbers(rng, shape)))
            elif one.type == "uint8_t":
                given.append((one.name, rng.integers(0, 2, shape).astype(bool)))
            else:
                index = rng.integers(-3, 16, shape)
                ordered = np.arange(*shape) if len(shape) == 1 and rng.integers(2) else np.sort(index)
                given.append((one.name, ordered if rng.integers(3) else index))
        elif one.type == "double":
            given.append((one.name, float(numbers(rng, (1,))[0])))
        elif one.name not in shapes:
            given.append((one.name, int(rng.integers(-2, 16))))
        else:
            given.append((one.name, sizes[one.name]))
    wanted = getattr(core, entry.name).__code__.co_varnames[: getattr(core, entry.name).__code__.co_argcount]
    return [value for name, value in given if name in wanted]


def fuzz(seconds: float, seed: int, only: str = "", call: int | None = None) -> int:
    """Make calls until the time is over, or the one of that number alone; return how many were made."""
    rng, every, calls = np.random.default_rng(seed), list(entries().values()), 0
    every = [each for each in every if only in each.name]
    end = time.monotonic() + seconds
    for number in count():
        entry = every[number % len(every)]
        values = arguments(rng, entry)
        if call is None or call == number:
            begun = time.process_time()
            with contextlib.suppress(*_ALLOWED):
                getattr(core, entry.name)(*values)
            took = time.process_time() - begun
            calls += 1
            if took > SLOWEST_S:
                raise SystemExit(f"{entry.name} took {took:.1f} s: --seed {seed} --call {number}")
        if number == call or (call is None and time.monotonic() >= end):
            return calls
    raise AssertionError


def main() -> None:
    """Fuzz with the options of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="entries whose name holds this")
    parser.add_argument("--call", type=int, help="the call of this number alone")
    given = parser.parse_args()
    calls = fuzz(given.seconds, given.seed, given.only, given.call)
    sys.stdout.write(f"{calls} calls of {len(entries())} entries\n")


if __name__ == "__main__":
    main()
