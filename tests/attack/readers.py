"""The attack on readers, `python -m tests.attack.readers [--seconds S]`: each format, changed at random.

A reader gives frames of finite numbers, the same ones at each pass, or an error of one line that names the
file. Where one number of a text was replaced, no number may come of it that is not there. A case is repeated
by `--seed S --case N`.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import shutil
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeVar

import numpy as np

from tests.attack.mutations import CORPUS, NUMBER, WORDS, mutated, samples
from tests.attack.structures import rebuilt
from tests.attack.trial import LARGE
from tests.io.test_fuzz_settings import POINTS, READ
from tssgeom.engine import process
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.files import find_inputs, open_recording
from tssgeom.io.formats.recording import usable
from tssgeom.io.formats.states import read_state
from tssgeom.rig import read_rig
from tssgeom.stream import Frame, FrameResult, Rejected

Content = TypeVar("Content")
SLOW = 10
"""Time on a processor that a case may take [s]."""
_STUCK = 120.0  # s until a case that waits counts as one that does not end
_CASES = 1 << 60
_TEXTS = (".csv", ".tsv", ".txt", ".jsonl", ".fcsv", ".mrk.json", "ascii.vtp")
_ROUNDING = 1e-6  # between a number in mm and in m, of single precision


def case(folder: Path, seed: int, number: int) -> tuple[str, list[str]]:
    """Write one changed file, read it, and return its name and what must not be."""
    random = np.random.default_rng([seed, number])
    sample = samples()[number % len(samples())]
    raw, name = sample.read_bytes(), sample.name
    path, known = folder / sample.parent.name / name, None
    way = int(random.integers(4))
    if way == 0 and name.endswith(_TEXTS) and (numbers := list(NUMBER.finditer(raw))):
        one, word = numbers[int(random.integers(len(numbers)))], WORDS[int(random.integers(len(WORDS)))]
        raw = raw[: one.start()] + word + raw[one.end() :]
        if word and NUMBER.fullmatch(word):
            texts = [raw, raw.replace(b",", b".")]  # some write 0,5
            known = {float(each) for text in texts for each in NUMBER.findall(text)}
    else:
        raw = rebuilt(name, raw, random) if way < 3 else mutated(raw, random)
    path.write_bytes(raw)
    unit = (None, "mm", "m")[int(random.integers(3))]
    try:
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            if sample.parent.name == "settings":
                return name, [*_of_settings(path), *_heard(heard)]
            return name, [*_of_shapes(path, unit, known), *_heard(heard)]
    finally:
        path.unlink()
        if sample.parent.name == "settings":  # those of a campaign are its neighbours
            shutil.copy(sample, path)


def _heard(heard: list[warnings.WarningMessage]) -> list[str]:
    return [f"warning: {each.message} in {each.filename}:{each.lineno}" for each in heard[:1]]


def _attempted(read: Callable[[], Content], path: Path) -> tuple[Content | None, list[str]]:
    """Return what was read, None where it is refused as it has to be, and what is wrong."""
    try:
        return read(), []
    except TssgeomError as error:
        said = str(error)
        wrong = ["long error"] if len(said.splitlines()) != 1 or len(said) > 2000 else []
        return None, wrong + ([] if path.name in said or path.parent.name in said else [f"unnamed {said}"])
    except Exception as error:  # the very fault that is sought
        where = traceback.extract_tb(error.__traceback__)[-1]
        return None, [f"uncaught {error!r:.300} in {where.filename}:{where.lineno}"]


def _of_shapes(path: Path, unit: str | None, known: set[float] | None) -> Iterator[str]:
    parts, wrong = _attempted(lambda: find_inputs([path]), path)
    yield from wrong
    for part in parts or []:
        items, wrong = _attempted(
            lambda part=part: [list(open_recording(part, unit)) for _ in range(2)], path
        )
        yield from wrong
        if items is not None:
            first, second = items
            if list(map(repr, map(_numbers, first))) != list(map(repr, map(_numbers, second))):
                yield "wrong: another pass gives other frames"
            yield from _of_frames(first, known)


def _numbers(item: Frame | Rejected) -> object:
    return item if isinstance(item, Rejected) else (item.points.tolist(), item.time, item.tension_in, item.id)


def _of_frames(items: list[Frame | Rejected], known: set[float] | None) -> Iterator[str]:
    frames = [item for item in items if isinstance(item, Frame) and usable(item)]
    if not items:
        yield "wrong: no frame and no error"
    if any(len(item.reason.splitlines()) != 1 for item in items if isinstance(item, Rejected)):
        yield "long reason"
    if any(b.time <= a.time for a, b in pairwise(frames)):
        yield "wrong: times do not increase"
    for frame in frames:
        points = frame.points
        if points.ndim != 2 or points.shape[1] != 3 or points.dtype != np.float64 or np.isinf(points).any():
            yield f"wrong: points {points.shape} of {points.dtype}, {np.isinf(points).sum()} infinite"
        more = [
            frame.tension_in,
            frame.tension_out,
            frame.displacement_in,
            frame.elongation,
            frame.temperature,
        ]
        if any(one is not None and not np.isfinite(one) for one in more):
            yield f"wrong: a measurement is not finite: {more}"
        if known is not None:
            olds = np.abs(np.array([each * scale for each in known for scale in (1.0, 1e-2, 1e-3, 1e-6)]))
            new = np.abs(points[np.isfinite(points)])
            far = np.abs(new[:, None] - olds).min(axis=1, initial=np.inf) > _ROUNDING * np.maximum(new, 1e-9)
            if far.any():
                yield f"wrong: {new[far][:3]} is made up"


def _of_settings(path: Path) -> Iterator[str]:
    if not path.name.startswith("state"):
        read = READ.get(path.name, read_rig)
        yield from _attempted(lambda: read(path), path)[1]
        return
    state, wrong = _attempted(lambda: read_state(path), path)
    yield from wrong
    if state is not None:
        rig = CORPUS / "settings" / ("rig.toml" if "effects" in path.name else "rig_of_the_paper.toml")
        frames = [Frame(POINTS, 2.0, tension_in=9.0), Frame(POINTS, 3.0, displacement_in=1e-3)]
        results, wrong = _attempted(
            lambda: list(process(frames, read_rig(rig), tension_in=9.0, state=state)), path
        )
        yield from (each for each in wrong if not each.startswith("unnamed"))
        for item in results or []:
            if isinstance(item, FrameResult) and not np.isfinite(item.transmission.tension_out):
                yield "wrong: a state gives a tension that is not finite"


def work(said: Connection, seed: int, first: int, last: int) -> None:
    """Try cases and say what is wrong; one that takes too long ends this process."""
    with tempfile.TemporaryDirectory() as home:
        settings = Path(shutil.copytree(CORPUS / "settings", Path(home, "settings")))
        shutil.copy(CORPUS / "points.csv", settings)
        Path(home, CORPUS.name).mkdir()
        for number in range(first, last):
            said.send((number, None, []))
            signal.setitimer(signal.ITIMER_PROF, SLOW)
            name, wrong = case(Path(home), seed, number)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
            said.send((number, name, wrong + [f"memory {memory >> 20} MiB"] * (memory > LARGE)))
            if memory > LARGE:
                return


def attacked(seconds: float, seed: int, first: int = 0, last: int = _CASES) -> Iterator[tuple[int, str, str]]:
    """Yield the number, the file and the fault of each case that has one; "" for one without."""
    until, context = time.monotonic() + seconds, multiprocessing.get_context("fork")
    while first < last and time.monotonic() < until:
        here, there = context.Pipe(duplex=False)
        worker = context.Process(target=work, args=(there, seed, first, last))
        worker.start()
        there.close()
        number, name = first, ""
        try:
            while time.monotonic() < until:
                if not here.poll(_STUCK):
                    yield number, "", f"hang: waits for {_STUCK:.0f} s"
                    break
                number, name, wrong = here.recv()
                if name is not None:
                    yield from ((number, name, each) for each in wrong or [""])
        except EOFError:
            worker.join()
            if name is None:
                hangs = worker.exitcode == -signal.SIGPROF
                yield number, "", f"hang: {SLOW} s of a processor" if hangs else f"died ({worker.exitcode})"
        worker.kill()
        worker.join()
        first = number + 1


def main() -> int:
    """Run the attack, and return 1 where anything happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="this one alone")
    given = parser.parse_args()
    first, last = (0, _CASES) if given.case is None else (given.case, given.case + 1)
    count, faults, begun = 0, 0, time.monotonic()
    for number, name, fault in attacked(given.seconds, given.seed, first, last):
        count = number + 1
        if fault:
            faults += 1
            print(f"--seed {given.seed} --case {number} {name}: {fault}", flush=True)  # noqa: T201
    took = time.monotonic() - begun
    print(f"{count - first} cases in {took:.0f} s, {(count - first) / took:.0f}/s; {faults} faults")  # noqa: T201
    return int(bool(faults))


if __name__ == "__main__":
    raise SystemExit(main())
