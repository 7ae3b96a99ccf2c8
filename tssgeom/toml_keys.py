"""Keys of TOML files, whose reader takes a time that grows with the square of their parts."""

import re
from typing import Any

import msgspec

_MOST_PARTS = 100  # of a key; chosen: no file of ours has more than four
_LONG_KEY = re.compile(rb"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){%d}""" % _MOST_PARTS)


def with_short_keys(content: bytes) -> bytes:
    """Return the content of a TOML file; raises msgspec.DecodeError where a key has more than 100 parts."""
    if _LONG_KEY.search(content):
        raise msgspec.DecodeError(f"a key has more than {_MOST_PARTS} parts")
    return content


def without_none(value: Any) -> Any:
    """Leave out unset values, which TOML cannot express."""
    kept = value.items() if isinstance(value, dict) else ()
    return {key: without_none(item) for key, item in kept if item not in (None, {}, ())} if kept else value
