"""Objects of JSON against docs/reference/json.md: no key that it lacks, no key of it that is not written."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))

from json_keys import OUTPUTS, below, entries, innermost, is_object

KINDS = {output.title: output.kind for output in OUTPUTS}


def described(title: str, value: Any) -> set[str]:
    """Require each key to be in the reference, of its type, and none to lack; return the optional keys."""
    kind = KINDS[title]
    msgspec.convert(value, kind, dec_hook=_numbers)  # types, and keys that are not optional
    written, unknown = set[str](), set[str]()
    for path, known in _walked(value, kind, ""):
        (written if known else unknown).add(path)
    assert not unknown, f"{title}: not in docs/reference/json.md: {unknown}"
    return written


def _numbers(kind: Any, value: Any) -> Any:
    """Return a column as numbers; the one type of the objects that JSON does not know is an array."""
    return np.array(msgspec.convert(value, list[float | None]), np.float64)


def optional(title: str) -> set[str]:
    """Return the optional keys of the reference."""
    return set(_optional(KINDS[title], ""))


def _walked(value: Any, hint: Any, path: str) -> Iterator[tuple[str, bool]]:
    """Yield optional keys that are written, and with False those that the reference lacks."""
    held, written = below(hint)
    if written and value is not None:
        for each in value if written == "[]" else value.values():
            yield from _walked(each, held, path)
    elif is_object(held) and value is not None:
        keys = entries(held)
        for key, inside in value.items():
            here = f"{path}.{key}".lstrip(".")
            if key not in keys or keys[key].optional:
                yield here, key in keys
            if key in keys:
                yield from _walked(inside, keys[key].hint, here)


def _optional(kind: type, path: str) -> Iterator[str]:
    for key, entry in entries(kind).items():
        here, held = f"{path}.{key}".lstrip("."), innermost(entry.hint)[0]
        if entry.optional:
            yield here
        if is_object(held):
            yield from _optional(held, here)
