"""Keys of TOML files: how long they may be, and which one was meant."""

import difflib
import functools
import re
from typing import Any, get_args

import msgspec

_MOST_PARTS = 100  # of a key; chosen: no file of ours has more than four
_LONG_KEY = re.compile(rb"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){%d}""" % _MOST_PARTS)


def with_short_keys(content: bytes) -> bytes:
    """Return the content of a TOML file; raises msgspec.DecodeError where a key has more than 100 parts.

    A reader takes a time that grows with their square.
    """
    if _LONG_KEY.search(content):
        raise msgspec.DecodeError(f"a key has more than {_MOST_PARTS} parts")
    return content


def without_none(value: Any) -> Any:
    """Leave out unset values, which TOML cannot express."""
    kept = value.items() if isinstance(value, dict) else ()
    return {key: without_none(item) for key, item in kept if item not in (None, {}, ())} if kept else value


def _values_of(kind: Any) -> list[str]:
    """Return the values that a type lists, also as one of several."""
    return [
        value
        for one in get_args(kind)
        for value in (_values_of(one) if get_args(one) else [one] if isinstance(one, str) else [])
    ]


def with_choices(reported: str, like: msgspec.Struct) -> str:
    """Return what msgspec reports of a file, and the nearest key or value of a struct of its form."""
    wrong = r"(?:Object contains unknown field `(\w+)`|Invalid enum value '(.*)')(?:.*`\$\.?(.*)`)?"
    match = re.match(wrong, reported)
    if match is None:
        return reported
    steps = [each for each in (match[3] or "").split(".") if each]
    last = steps.pop() if match[2] else ""
    try:
        types = {
            each.name: each.type for each in msgspec.structs.fields(functools.reduce(getattr, steps, like))
        }
        choices = _values_of(types[last]) if match[2] else list(types)
    except (AttributeError, KeyError, TypeError):  # in a list, or in a table of the user's own names
        return reported
    near = difflib.get_close_matches(match[1] or match[2], choices, 1)
    hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(choices)}"
    return f"{reported}; {hint}"
