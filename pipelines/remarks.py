"""Remarks on runs in a terminal: those that differ only in the run, or in its numbers, are one line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

_NUMBER = re.compile(r"(?<![\w.−-])[−-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?!\w|\.\d)")
_RUN, _VALUE = "\0", "\1"
_Group = dict[str, list[str]]
"""By run, the numbers of its remark as they are written."""


def grouped(remarks: Iterable[str], runs: Sequence[str]) -> list[str]:
    """Return each remark once; of several runs in one line, with the range of numbers that differ.

    A remark is of a run where it begins with its name and a colon, or has it after "of".
    """
    groups: dict[tuple[str, int], _Group] = {}
    for remark in dict.fromkeys(remarks):
        run = next((name for name in sorted(runs, key=len, reverse=True) if _of(name).search(remark)), "")
        text = _of(run).sub(_RUN, remark, count=1) if run else remark
        pattern, numbers = (_NUMBER.sub(_VALUE, text), _NUMBER.findall(text)) if run else (text, [])
        again = 0  # two remarks of one run stay two lines
        while run in groups.get((pattern, again), {}):
            again += 1
        groups.setdefault((pattern, again), {})[run] = numbers
    return [_line(pattern, group) for (pattern, _), group in groups.items()]


def _of(run: str) -> re.Pattern[str]:
    name = re.escape(run)
    return re.compile(rf"^{name}(?=: )|(?<= of ){name}(?=[ ,:;]|$)")


def _line(pattern: str, group: _Group) -> str:
    ranges = iter(_ranges(list(group.values())))
    text = re.sub(_VALUE, lambda _: next(ranges), pattern)
    return text.replace(_RUN, ", ".join(group))


def _ranges(numbers: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield each number of a remark, least to greatest where runs differ in it."""
    for values in zip(*numbers, strict=True):
        least, most = (of(values, key=lambda each: float(each.replace("−", "-"))) for of in (min, max))
        yield least if len(set(values)) == 1 else f"{least} to {most}"
