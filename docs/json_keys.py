"""The objects of JSON that commands write, and the page of their keys."""

import inspect
import types
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict

import msgspec
import numpy as np
from docstrings import cell, field_docs, parted, sentences, wrapped
from numpy.typing import NDArray

from tssgeom.io.formats.cameras import CalibrationFile
from tssgeom.io.results.answers import Answer, Late, Refusal, Stale
from tssgeom.io.results.keys.calibrations import Calibrated, MachineCalibrated, PiecesCalibrated
from tssgeom.io.results.keys.commands import (
    CamerasCalibrated,
    Checked,
    CheckedCampaign,
    CheckedPoints,
    CheckedText,
    Closed,
    StatisticsOf,
    Tracked,
    Verified,
)
from tssgeom.io.results.keys.designs import PaperObject, Remedied
from tssgeom.io.results.keys.findings import Report
from tssgeom.io.results.keys.runs import Compensated, FollowedObject, MachineComputed, Simulated
from tssgeom.io.results.keys.shapes import ShapeObject
from tssgeom.io.results.run_record import RunFile
from tssgeom.rig import Rig

_VECTOR = NDArray[np.float64]  # an array, or from numpy 2.5 on the name of one


class Output(NamedTuple):
    """One kind of object that a command writes."""

    title: str
    kind: type
    text: str
    example: str = ""
    """Command whose output the page shows."""


OUTPUTS = (
    Output(
        "analyse --json, batch --json",
        ShapeObject,
        "One object for each shape, in a list if several.",
        "tssgeom analyse sample_shapes/half_circle.csv --json",
    ),
    Output("run.json", RunFile, "What `batch` writes beside its tables."),
    Output(
        "live: an answer",
        Answer,
        "A line for each good frame.",
        "head -1 sample_shapes/insertion.jsonl | tssgeom live",
    ),
    Output("live: a rejected frame", Refusal, "A line for each bad frame."),
    Output("live: silence", Stale, "One line when no good frame comes for `--stale-after`."),
    Output("live: a late answer", Late, "A line for each late answer."),
    Output("live: a client is cut off", Closed, "The last line that a TCP client gets."),
    Output("live --stats", StatisticsOf, "A line a second on stderr."),
    Output("simulate --json", Simulated, ""),
    Output("simulate --adapt --json, adapt.json", FollowedObject, ""),
    Output("compensate --json", Compensated, ""),
    Output("simulate --json, compensate --json of a machine", MachineComputed, ""),
    Output("calibrate --json, calibration.json", Calibrated, ""),
    Output("calibrate --json of a machine", MachineCalibrated, ""),
    Output("calibrate --every --json", PiecesCalibrated, ""),
    Output("discover --json, report.json", Report, ""),
    Output("check --json of a shape or recording", CheckedPoints, "One object for each file."),
    Output("check --json of a measured run, rig or mesh", CheckedText, "One object for each file."),
    Output("check --json of a campaign", CheckedCampaign, "One object for each file."),
    Output("check --json of what cannot be used", Checked, "One object for each file."),
    Output("verify --json", Verified, ""),
    Output("remedy --json, remedy.json", Remedied, ""),
    Output("paper --json", PaperObject, ""),
    Output("track --json", Tracked, ""),
    Output("track --calibrate --json", CamerasCalibrated, ""),
    Output("the file of track --calibrate", CalibrationFile, "JSON, or the same keys as TOML."),
)
"""Every object, in the order of the page."""

_WORDS = {
    float: "number",
    int: "whole number",
    str: "text",
    bool: "`true` or `false`",
    Rig: "object, [keys of a rig](rig.md)",
}


class Entry(NamedTuple):
    """A key with its position in the object."""

    path: str
    hint: Any
    optional: bool
    owner: type


def entries(kind: type) -> dict[str, Entry]:
    """Return the keys of an object, by name."""
    hints = get_type_hints(kind, include_extras=True)
    if is_typeddict(kind):
        return {name: Entry(name, *_of_hint(hint), kind) for name, hint in hints.items()}
    if is_dataclass(kind):  # where a number is not finite, null is written
        plain = get_type_hints(kind)
        hints = {each.name: plain[each.name] for each in fields(kind)}
        hints = {name: float | None if hint is float else hint for name, hint in hints.items()}
        return {name: Entry(name, hint, False, kind) for name, hint in hints.items()}
    omitted = kind.__struct_config__.omit_defaults  # pyright: ignore[reportAttributeAccessIssue]
    return {
        each.encode_name: Entry(each.encode_name, hints[each.name], omitted and not each.required, kind)
        for each in msgspec.structs.fields(kind)
    }


def _of_hint(hint: Any) -> tuple[Any, bool]:
    return (get_args(hint)[0], True) if get_origin(hint) is NotRequired else (hint, False)


def is_object(hint: Any) -> bool:
    """Whether a type is an object with keys of its own on this page."""
    struct = isinstance(hint, type) and issubclass(hint, msgspec.Struct)
    return hint is not Rig and (is_typeddict(hint) or is_dataclass(hint) or struct)


def below(hint: Any) -> tuple[Any, str]:
    """Return the type inside a list or an object by name, and how it is written; else the type itself."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (types.UnionType, Union):
        return below(next(each for each in inside if each is not type(None)))
    if origin in (list, tuple, Sequence):
        return inside[0], "[]"
    return (inside[1], ".NAME") if origin in (dict, Mapping) else (hint, "")


def innermost(hint: Any) -> tuple[Any, str]:
    """Return the type inside all lists and objects by name, and how they are written behind a key."""
    held, written = below(hint)
    if not written:
        return held, ""
    last, more = innermost(held)
    return last, written + more


def flat(kind: type, path: str = "", known: dict[type, str] | None = None) -> Iterator[tuple[Entry, str]]:
    """Yield each key with its path, and for an object described above that of the other one."""
    known = {} if known is None else known
    for entry in entries(kind).values():
        held, suffix = innermost(entry.hint)
        here = entry._replace(path=f"{path}{entry.path}")
        nested = f"{here.path}{suffix}"
        yield here, known.get(held, "") if is_object(held) else ""
        if is_object(held) and held not in known:
            known[held] = nested
            yield from flat(held, f"{nested}.", known)


def words(hint: Any, optional: bool = False) -> str:
    """Return a type in words; an optional key is left out where it would be null."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (types.UnionType, Union):
        kinds = dict.fromkeys(words(each) for each in inside if each is not type(None))
        return " or ".join([*kinds, *(["null"] if type(None) in inside and not optional else [])])
    if origin in (np.ndarray, get_origin(_VECTOR)):
        return "list of number or null"
    if origin in (list, tuple, Sequence):
        return f"list of {words(inside[0])}"
    if origin in (dict, Mapping):
        return f"object by name of {words(inside[1])}"
    return _WORDS.get(hint, "object")


def page() -> Iterator[str]:
    """Yield the parts of the page."""
    yield "# JSON keys\n\n"
    text = (
        "Each key with its type, unit and meaning, from the types of the functions that write it. Numbers "
        "are in SI, but where the name of a key ends in another unit. “Optional” is a key that is left "
        "out where it has nothing to state. `key[]` is each element of a list, `key.NAME` each value of "
        "an object by name. Frames that `live` takes are described in "
        "[formats.md](../formats.md#json-lines-a-frame-each-line)."
    )
    yield f"{wrapped(text)}\n"
    for title, kind, text, example in OUTPUTS:
        yield f"\n## {title}\n\n{sentences(inspect.getdoc(kind) or '')} {text}".rstrip() + "\n\n"
        yield f"```{{run}} sh\n{example}\n```\n\n" if example else ""
        yield "| key | type | unit | meaning |\n|---|---|---|---|\n"
        for entry, same in flat(kind):
            name = entry.path.rpartition(".")[2]
            meaning, unit = parted(field_docs(entry.owner)[name])
            kind_words = words(entry.hint, entry.optional) + (f", keys as `{same}`" if same else "")
            optional = ", optional" * entry.optional
            yield f"| `{entry.path}` | {kind_words}{optional} | {unit} | {cell(meaning)} |\n"
