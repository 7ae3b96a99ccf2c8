"""JSON lines: one frame a line, decoded one at a time."""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, Generic, NamedTuple, TypeVar

import msgspec
import numpy as np

from tssgeom import core
from tssgeom.arrays import read_only
from tssgeom.errors import ShapeError
from tssgeom.io.formats.laboratory.unknown import NO_OTHERS, OtherKeys, other_keys
from tssgeom.io.formats.paths import LONGEST_LINE, reading, stem
from tssgeom.io.formats.recording import GIVE_UNIT, PER_METRE, UNTIMED, Frames, Recording, agreed_unit
from tssgeom.stream import Frame, Rejected

_TOO_LONG = f"the line is longer than {LONGEST_LINE} bytes (1 MiB): send fewer points"
_UNOBSERVED = (None, None, None)
_STATE_UNIT = 'write "unit": "mm" or "unit": "m" in each line'
_KEY = re.compile(r"(?:\$\.|field `)(\w+)")  # that a decoder names as wrong or missing
_TO_WRITE = {
    "points": "write each point as [x,y,z], or null where it is missing",
    "directions": "write each direction as [x,y,z], or null where none was sensed",
    "s": 'write "s" as a list of numbers',
    "id": 'write "id" as text or a whole number',
    "unit": _STATE_UNIT,
}

Coordinates = tuple[float | None, float | None, float | None]


_Listed = list[Coordinates | None]
_Points = TypeVar("_Points")


class Line(msgspec.Struct, Generic[_Points], frozen=True):
    """One line as it is written."""

    points: _Points = None  # type: ignore[assignment]  # the line has none; `null` is refused
    t: float | None = None
    unit: str | None = None
    s: list[float | None] | None = None
    tension_in_N: float | None = None
    tension_out_N: float | None = None
    displacement_in_m: float | None = None
    elongation_m: float | None = None
    id: str | int | None = None
    displacement_target_m: float | None = None
    tension_out_target_N: float | None = None
    directions: _Listed | None = None
    length_m: float | None = None
    temperature_C: float | None = None
    noise_m: float | None = None


class _Strict(Line[_Points], Generic[_Points], frozen=True, forbid_unknown_fields=True):
    """A line without other fields."""


class _Heading(msgspec.Struct, frozen=True):
    """The fields that a first pass over a file reads, and that identify a rejected frame."""

    t: float | None = None
    unit: str | None = None
    id: str | int | None = None


_strict_decoder = msgspec.json.Decoder(_Strict[msgspec.Raw])
_quick_decoder = msgspec.json.Decoder(Line[msgspec.Raw])
_line_decoder = msgspec.json.Decoder(Line[_Listed])
_heading_decoder = msgspec.json.Decoder(_Heading)
_KNOWN = frozenset(Line.__struct_fields__)


def frame_of(
    text: bytes, unit: str | None, time: float | None = None, *, may_lack_points: bool = False
) -> Frame:
    """Decode one line.

    Parameters
    ----------
    text
        The line.
    unit
        Unit for a line that states none; a line that states another one is refused.
    time
        Time for a line that states none [s].
    may_lack_points
        Whether a line may have none: its route is then that of the rig.

    Raises
    ------
    ShapeError
        Where the line is too long, is no JSON, lacks its points, unit or time, or is ragged.
    """
    if len(text) > LONGEST_LINE:
        raise ShapeError(_TOO_LONG)
    try:
        if decoded := _decoded_fast(text):
            return _frame(*decoded, unit, time)
        line = _line_decoder.decode(text)
        beside = other_keys(text, _KNOWN)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ShapeError(_fault(error)) from error
    if line.points is None and not may_lack_points:
        raise ShapeError(f"Object missing required field `points`: {_TO_WRITE['points']}")
    return _frame(line, _rows(line.points or []), beside, unit, time)


def _fault(error: Exception) -> str:
    """Return the fault of a line that could not be decoded, and what to write instead."""
    key = _KEY.search(str(error)) if isinstance(error, msgspec.ValidationError) else None
    if key is None:
        return f"{error}: write one JSON object a line, null for NaN or a missing point"
    hint = _TO_WRITE.get(key[1], f'write "{key[1]}" as a number')
    return f"{error}: {hint}"


def _decoded_fast(text: bytes) -> tuple[Line[msgspec.Raw], np.ndarray, OtherKeys] | None:
    """Decode a line with plain points, and its other keys; None for any other line."""
    beside = NO_OTHERS
    try:
        line = _strict_decoder.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        try:
            line = _quick_decoder.decode(text)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return None
        beside = other_keys(text, _KNOWN)
    if line.points is None:
        return None
    points = plain_points(line.points)
    return (line, points, beside) if len(points) else None


def plain_points(text: bytes | msgspec.Raw) -> np.ndarray:
    """Read `[[x,y,z],null,…]` without the JSON library; no row where the text is anything else [n, 3]."""
    characters = np.frombuffer(text, np.uint8)
    points = np.empty((len(characters) // 5 + 1, 3))  # the shortest row is a null and a comma
    return points[: core.read_points(characters, points)].copy()


def frame_or_refusal(text: bytes, unit: str | None) -> Frame | Rejected:
    """Decode one line of a stream; one that cannot be used is rejected with its own time and id."""
    try:
        return frame_of(text, unit, may_lack_points=True)
    except ShapeError as error:
        heading = _heading(text)
        heading = _Heading() if isinstance(heading, str) else heading
        time = math.nan if heading.t is None else heading.t
        return Rejected(0, time, " ".join(str(error).split()), "" if heading.id is None else heading.id)


def _frame(
    line: Line[Any], points: np.ndarray, beside: OtherKeys, unit: str | None, time: float | None
) -> Frame:
    stated = line.unit or unit or (None if len(points) else "m")
    if stated not in PER_METRE:
        raise ShapeError(f"the unit is {stated!r}: {_STATE_UNIT}, or {GIVE_UNIT}")
    if unit is not None and stated != unit:
        raise ShapeError(f"the line is in {stated}, --unit says {unit}: read it without --unit")
    moment = line.t if line.t is not None else time
    if moment is None:
        raise ShapeError('the line has no time: write "t" in s')
    per_metre = PER_METRE[stated]
    in_metres = points / per_metre
    in_metres.flags.writeable = False
    return Frame(
        in_metres,
        moment,
        _stations(line, len(points), per_metre),
        line.tension_in_N,
        line.tension_out_N,
        line.displacement_in_m,
        line.elongation_m,
        "" if line.id is None else line.id,
        line.displacement_target_m,
        line.tension_out_target_N,
        directions=_directions(line, len(points)),
        length=line.length_m,
        temperature=line.temperature_C,
        noise=line.noise_m,
        warnings=beside.warnings,
        of_machine=beside.of_machine,
    )


def _rows(given: _Listed) -> np.ndarray:
    try:
        flat = np.fromiter(chain.from_iterable(given), np.float64, 3 * len(given))  # type: ignore[arg-type]
    except TypeError:  # a point that was not observed
        flat = np.array([row or _UNOBSERVED for row in given], dtype=np.float64)
    rows = flat.reshape(-1, 3)
    missing = np.isnan(rows)
    if missing.any():
        rows[missing.any(axis=1)] = np.nan
    return rows


def _directions(line: Line[Any], count: int) -> np.ndarray | None:
    if line.directions is None:
        return None
    if len(line.directions) != count:
        raise ShapeError(
            f"{len(line.directions)} directions for {count} points: "
            "give one for each, null where none was sensed"
        )
    return read_only(_rows(line.directions))


def _stations(line: Line[Any], count: int, per_metre: float) -> np.ndarray | None:
    if line.s is None:
        return None
    if len(line.s) != count:
        raise ShapeError(f"{len(line.s)} stations for {count} points: give one for each, or none")
    return read_only(np.array(line.s, dtype=np.float64) / per_metre)


@dataclass(frozen=True, slots=True)
class JsonFrames(Frames):
    """The frames of a file of JSON lines."""

    path: Path
    unit: str | None
    """Unit for lines that state none."""
    counted: bool
    """True where the lines hold no time and are counted instead."""

    def read(self) -> Iterator[Frame | Rejected]:
        """Yield the frames as the file holds them."""
        for seq, (number, text) in enumerate(_lines(self.path)):
            try:
                frame = frame_of(text, self.unit, float(seq) if self.counted else None)
                yield replace(frame, warnings=()) if frame.warnings else frame  # the recording has them
            except ShapeError as error:
                yield Rejected(seq, 0.0, f"line {number}: {error}")


def open_jsonl(path: Path, unit: str | None) -> Recording:
    """Open a file of JSON lines; a first pass reads its unit, its length and whether it has a clock.

    Raises ShapeError where no line is a frame, or where the unit is missing or mixed; SourceError where the
    file cannot be read.
    """
    survey = _survey(path)
    agreed = agreed_unit(path, survey.unit, unit, _STATE_UNIT)
    timed = survey.has_clock or survey.lines > 1
    warnings = ((UNTIMED,) if timed and not survey.has_clock else ()) + survey.unknown
    frames = JsonFrames(path, unit, counted=not survey.has_clock)
    return Recording(stem(path), path, agreed, "jsonl", timed, survey.lines, frames, warnings)


class _Survey(NamedTuple):
    lines: int
    unit: str | None
    has_clock: bool
    unknown: tuple[str, ...]
    """Keys that are not read, a sentence each."""


def _survey(path: Path) -> _Survey:
    lines, read, unit, has_clock, fault = 0, 0, None, False, ""
    keys, unknown = -1, dict[str, None]()
    for number, text in _lines(path):
        lines += 1
        heading = _heading(text)
        if isinstance(heading, str):
            fault = fault or heading
            continue
        read += 1
        if (count := text.count(b'":')) != keys:  # lines of one sender have the same keys
            keys = count
            with suppress(ShapeError, msgspec.DecodeError, UnicodeDecodeError):  # which its frame reports
                unknown |= dict.fromkeys(other_keys(text, _KNOWN).warnings)
        has_clock |= heading.t is not None
        if unit and heading.unit and heading.unit != unit:
            raise ShapeError(
                f"{path}: line {number}: mixed units, {heading.unit} after {unit}: write all in one"
            )
        unit = unit or heading.unit
    if not read:
        empty = "the file is empty: write one frame a line (docs/formats.md)"
        raise ShapeError(f"{path}: " + (f"no line is a frame; the first: {fault}" if lines else empty))
    return _Survey(lines, unit, has_clock, tuple(unknown))


def _heading(text: bytes) -> _Heading | str:
    """Return the heading of a line, or why it has none."""
    if len(text) > LONGEST_LINE:
        return _TOO_LONG
    try:
        return _heading_decoder.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        return _fault(error)


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield number and text of each line that is not blank; a line that is too long is cut one byte above."""
    with reading(path), path.open("rb") as file:
        number = 0
        while text := file.readline(LONGEST_LINE + 1):
            number += 1
            if len(text) > LONGEST_LINE and not text.endswith(b"\n"):
                _skip_line(file)
            if number == 1:
                text = text.removeprefix(codecs.BOM_UTF8)
            if text.strip():
                yield number, text.rstrip(b"\r\n")


def _skip_line(file: BinaryIO) -> None:
    while (rest := file.readline(LONGEST_LINE)) and not rest.endswith(b"\n"):
        pass
