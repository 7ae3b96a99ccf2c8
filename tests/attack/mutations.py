"""Sound files of every format, changed at random: bits, cuts, doubled parts, and words that hurt."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

CORPUS = Path(__file__).parent.parent / "io" / "corpus"
WORDS = (
    *(b"1e300", b"-1e300", b"1e999", b"nan", b"inf", b"-1", b"0", b"9" * 40, b"5e-324", b"true", b"null"),
    *(b"", b",", b";", b"\n", b"\x00", b"\x1b[31m", b"\x01", b"\xff\xfe", b'"', b"[" * 3000, b"{" * 3000),
    *(b"A" * 5000, b"\xe2\x80\xa8", b"\xed\xb3\xbf", b"../../x", b"# ", b"\r", b"%s%n", b"1,2,3\n" * 50),
)
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def samples() -> list[Path]:
    """Return a sound file of every format."""
    shapes = [path for path in sorted(CORPUS.iterdir()) if path.is_file() and path.suffix != ".md"]
    return [*shapes, *sorted((CORPUS / "settings").iterdir())]


def mutated(raw: bytes, random: np.random.Generator) -> bytes:
    """Change a file in one to three ways."""
    for _ in range(int(random.integers(1, 4))):
        raw = _changed(raw, random)
    return raw


def _changed(raw: bytes, random: np.random.Generator) -> bytes:
    begin, end = sorted(int(each) for each in random.integers(0, len(raw) + 1, 2))
    word = WORDS[int(random.integers(len(WORDS)))]
    match int(random.integers(7)):
        case 0:  # some bits turned
            array = np.frombuffer(raw, np.uint8).copy()
            for at in random.integers(0, max(len(array), 1), 4):
                array[at : at + 1] ^= np.uint8(1 << int(random.integers(8)))
            return array.tobytes()
        case 1:
            return raw[:begin]
        case 2:
            return raw[:begin] + raw[end:]
        case 3:
            return raw[:end] + raw[begin:end] + raw[end:]
        case 4:
            return raw[:begin] + word + raw[begin:]
        case 5:  # a number replaced
            numbers = list(NUMBER.finditer(raw))
            if not numbers:
                return raw[:begin] + word + raw[end:]
            one = numbers[int(random.integers(len(numbers)))]
            return raw[: one.start()] + word + raw[one.end() :]
        case _:
            return raw[:begin] + random.bytes(int(random.integers(1, 64))) + raw[end:]


def mutations(folder: Path, count: int, seed: int = 26) -> Iterator[tuple[str, list[str | Path]]]:
    """Yield the name and the command of each case, each time with the file as it is then in `folder`."""
    random = np.random.default_rng(seed)
    files = samples()
    for number in range(count):
        sample = files[number % len(files)]
        file = folder / sample.name
        if sample.parent.name == "settings" and not (folder / "points.csv").exists():
            shutil.copy(CORPUS / "points.csv", folder)
        file.write_bytes(mutated(sample.read_bytes(), random))
        yield f"{number} {sample.name}", _command(file, number // len(files))
        file.unlink(missing_ok=True)


def _command(file: Path, turn: int) -> list[str | Path]:
    sound = CORPUS / "points.csv"
    if file.name.startswith("rig"):
        return ["analyse", sound, "--rig", file, "--json"]
    if file.name.startswith("lumen"):
        return ["analyse", sound, "--lumen", file, "--json"]
    if file.name == "run.csv" and turn % 2:
        return ["simulate", sound, "--drive", file, "--out", file.parent / "out", "--quiet"]
    if file.name.startswith(("cameras", "campaign", "run")) or turn % 2:
        return ["check", file]
    return ["analyse", file, "--json", *(["--unit", "mm"] if turn % 4 else [])]
