"""Names that hurt: bytes that are not UTF-8, control characters, marks of shells and of other programs."""

from __future__ import annotations

import os
from pathlib import Path

from tests.attack.bombs import SOUND

# fmt: off
STEMS = (
    b'\xff', b'\xffa', b'a\xfe\xff', b'\xed\xb3\xbf', b'\xc3', b'loop\xe9', b'\x80\x81\x82', b'\xf0\x9f',
    b'\x1b[31mred', b'\x1b]0;title\x07', b'\x01', b'\x02\x03', b'\x7f', b'tab\t', b'line\nbreak',
    b'car\rriage', b'\xc2\x9b31m', b'\xe2\x80\xae', b'\xe2\x80\xa8', b'\xef\xbb\xbf', b'\xc2\xa0',
    b'\xf0\x9f\x98\x80', b'e\xcc\x81', b'#', b'a#1', b'a#b#c', b'#1', b'%s%n', b'%00', b'%2e%2e', b'{0}',
    b'$HOME', b'`id`', b'$(id)', b';id', b'|id', b'&amp;', b'<b>', b'<script>alert(1)<script>', b'"', b"'",
    b'\\', b'\\x1b', b'[red]', b'[]', b'-', b'--help', b'-rf', b'~', b'*', b'?', b'CON', b'nul', b'a b',
    b' a', b'a ', b'a.', b'..a', b'a..b', b'=1+1', b"n" * 200, b"\xc3\xa9" * 100, b'A', b'http:', b':__',
    b'1e300', b'nan',
)
# fmt: on
"""Of files."""


def make_named(folder: Path) -> list[Path]:
    """Write a sound shape under each name, some of them in folders of such names."""
    made = list[Path]()
    folder.mkdir(exist_ok=True)
    for number, stem in enumerate(STEMS):
        home = folder / os.fsdecode(b"in-" + stem[:40]) if number % 4 == 0 else folder
        home.mkdir(parents=True, exist_ok=True)
        made.append(home / os.fsdecode(stem + b".csv"))
        made[-1].write_bytes(SOUND.read_bytes())
    return made
