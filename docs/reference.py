"""Write the pages of docs/reference from the code: commands, keys of rigs and JSON, columns, Python names.

python docs/reference.py            # writes the pages that are in git
python docs/reference.py --check    # are they those of the code?

The pages of the Python names are written when the site is built, by `building/reference_pages.py`.
"""

import inspect
import re
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import json_keys
import msgspec
import table_columns
import typer
from docstrings import cell, field_docs, parted, sentences, wrapped

import tssgeom
from pipelines.cli import COMMANDS, app
from tssgeom.effects import KINDS, LAWS
from tssgeom.rig import Rig, Sensor
from tssgeom.uncertain import UNKNOWNS, Follow

FOLDER = Path(__file__).parent / "reference"
WRITTEN = "<!-- written by docs/reference.py: change the code, then run it -->\n\n"

VALUES = {
    "str": "text",
    "float": "number",
    "float range": "number",
    "int": "whole number",
    "int range": "whole number",
    "list[str]": "one or more texts",
    "list[Path]": "one or more paths",
    "mm|m|cm|in|dm|um|nm|ft|mil": "`mm`, `m`, `cm`, `in`, `dm`, `um`, `nm`, `ft` or `mil`",
}
"""Kinds of values in words."""


class Key(NamedTuple):
    """One key of a rig file."""

    name: str
    kind: str
    default: str
    unit: str
    meaning: str


def pages() -> dict[str, str]:
    """Return the pages that are in git, by their names."""
    return {name: WRITTEN + page for name, page in _pages()}


def _pages() -> Iterator[tuple[str, str]]:
    yield "commands.md", "".join(_commands())
    yield "rig.md", "".join(_rig())
    yield "columns.md", "".join(table_columns.page())
    yield "json.md", "".join(json_keys.page())


def _commands() -> Iterator[str]:
    yield "# Commands\n\n"
    text = (
        "The options of each command, as `tssgeom COMMAND --help` prints them. Exit status: 0 done, 1 some "
        "inputs were rejected and the others done, 2 usage or nothing done. `tssgeom --version` prints the "
        "version; `tssgeom --install-completion` adds the completion of commands and options to the shell."
    )
    yield f"{wrapped(text)}\n"
    group = typer.main.get_command(app)
    for name in sorted(COMMANDS):
        command = group.get_command(typer.Context(group), name)
        context = typer.Context(command, info_name=f"tssgeom {name}")
        yield f"\n## {name}\n\n"
        yield f"    {command.get_usage(context).removeprefix('Usage: ')}\n\n"
        yield f"{wrapped(_as_code(inspect.cleandoc(command.help or '')))}\n"
        rows = [record for each in command.params if (record := each.get_help_record(context))]
        yield "\n| argument or option | value | meaning |\n|---|---|---|\n"
        for written, meaning in sorted(rows, key=lambda row: row[0].startswith("-")):
            names, _, value = written.partition(" <")
            names, _, shape = (
                names.partition(" ") if names.startswith("-") and "/" not in names else (names, "", "")
            )
            value = (
                VALUES.get(value.removesuffix(">"), value.removesuffix(">"))
                if value
                else f"`{shape}`" * bool(shape)
            )
            yield f"| `{names}` | {cell(value)} | {cell(meaning)} |\n"


def _as_code(text: str) -> str:
    """Return a help text with names of files and options as code."""
    return re.sub(r"(?<![\w`])(--[a-z][\w-]*)", r"`\1`", text)


def _rig() -> Iterator[str]:
    yield "# Keys of a rig file\n\n"
    text = (
        "A rig is a TOML file; [formats.md](../formats.md#rig) explains its tables with examples. All keys "
        "may be left out, unless the default is “required”. Unknown keys are refused. The defaults are those "
        "of the paper."
    )
    yield f"{wrapped(text)}\n"
    for table in Rig.__struct_fields__:
        kind = get_type_hints(Rig)[table]
        if table in ("effects", "columns"):
            continue
        many = {"sensors": Sensor, "adapt": Follow}.get(table)
        struct = many or kind
        below = {"sensors": ".NAME", "adapt": ".&quot;KEY&quot;"}.get(table, "")
        yield f"\n## [{table}{below}]\n\n"
        yield f"{wrapped(sentences(inspect.getdoc(struct) or ''))}\n\n"
        yield "| key | value | default | unit | meaning |\n|---|---|---|---|---|\n"
        for key in keys(struct):
            yield f"| `{key.name}` | {key.kind} | {key.default} | {key.unit} | {cell(key.meaning)} |\n"
    yield from _unknowns()
    yield from _effects()


def _unknowns() -> Iterator[str]:
    names = ", ".join(f"`{name}`" for name in UNKNOWNS)
    text = (
        'These numbers, and the parameters of effects, may be `"unknown"`, and `tssgeom calibrate` fits '
        f"them: {names}. Any number may be `{{ value = 0.12, sd = 0.03 }}`. "
        "[machines.md](../machines.md) has what is assumed of each."
    )
    yield f"\n## Numbers that are not known\n\n{wrapped(text)}\n"


def _effects() -> Iterator[str]:
    yield "\n## [[effects]]\n\nA table for each effect, with its `name`. Size zero changes nothing.\n\n"
    yield "| name | parameter | least | greatest | default | unit | meaning |\n"
    yield "|---|---|---|---|---|---|---|\n"
    for name, kind in KINDS.items():
        first = f"**`{name}`**"
        yield f"| {first} | | | | | | {cell(sentences(inspect.getdoc(kind) or ''))} |\n"
        for key in keys(kind):
            limits = kind.parameters.get(key.name)
            low, high = ("", "") if limits is None else (f"{limits.lower:g}", f"{limits.upper:g}")
            unit = key.unit if limits is None else limits.unit
            yield f"| | `{key.name}` | {low} | {high} | {key.default} | {unit} | {cell(key.meaning)} |\n"
    yield "\n## [[effects]]: laws\n\nA law is a smooth curve through points, where no formula fits.\n\n"
    yield "| name | key | value | meaning |\n|---|---|---|---|\n"
    for name, kind in LAWS.items():
        yield f"| **`{name}`** | | | {cell(sentences(inspect.getdoc(kind) or ''))} |\n"
        for key in keys(kind):
            yield f"| | `{key.name}` | {key.kind} | {cell(key.meaning)} |\n"


def keys(struct: type) -> Iterator[Key]:
    """Yield the keys of a struct, those of structs in it with their table."""
    hints, meanings = get_type_hints(struct), field_docs(struct)
    for field in msgspec.structs.fields(struct):
        if isinstance(hints[field.name], type) and issubclass(hints[field.name], msgspec.Struct):
            yield from (key._replace(name=f"{field.name}.{key.name}") for key in keys(hints[field.name]))
            continue
        meaning, unit = parted(meanings.get(field.name, ""))
        yield Key(field.name, written_kind(hints[field.name]), _default(field), unit, meaning)


def _default(field: Any) -> str:
    if field.default is msgspec.NODEFAULT and field.default_factory is msgspec.NODEFAULT:
        return "required"
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    match value:
        case None | () | {}:
            return "none"
        case bool():
            return f"`{str(value).lower()}`"
        case float():
            return f"{value:g}"
        case str():
            return f'`"{value}"`'
    return f"`{value}`"


def written_kind(hint: Any) -> str:
    """Return a type in the words of a TOML file."""
    if get_origin(hint) is Literal:
        return " or ".join(f'`"{each}"`' for each in get_args(hint))
    if get_origin(hint) is types.UnionType or str(get_origin(hint)).endswith("Union"):
        return " or ".join(
            dict.fromkeys(written_kind(each) for each in get_args(hint) if each is not type(None))
        )
    if get_origin(hint) is tuple:
        inside = [each for each in get_args(hint) if each is not Ellipsis]
        if len(inside) > 1:
            return f"[{', '.join(written_kind(each) for each in inside)}]"
        return f"list of {written_kind(inside[0])}"
    return {float: "number", int: "whole number", str: "text", bool: "`true` or `false`"}.get(hint, str(hint))


def python_pages() -> dict[str, str]:
    """Return the pages of the Python names, one for each group of `__all__`, and their table of contents."""
    out, entries = {}, list[str]()
    for title, names in groups().items():
        file = f"python_{re.sub(r'[^a-z]+', '_', title.lower()).strip('_')}"
        entries.append(f"{file}")
        rows = [title[0].upper() + title[1:], "=" * len(title), ""]
        for name in names:
            value = getattr(tssgeom, name)
            kind = "function" if inspect.isroutine(value) else "class"
            kind = "exception" if isinstance(value, type) and issubclass(value, Exception) else kind
            kind = kind if callable(value) else "data"
            rows += [f".. auto{kind}:: tssgeom.{name}", ""]
        out[f"{file}.rst"] = "\n".join(rows)
    return out


def groups() -> dict[str, list[str]]:
    """Return the names of `tssgeom.__all__` by the comments above them."""
    source = Path(inspect.getfile(tssgeom)).read_text("utf-8").partition("__all__ = [")[2].partition("]")[0]
    out, title = dict[str, list[str]](), "names"
    for line in source.splitlines():
        if line.strip().startswith("#"):
            title = line.strip("# ")
        out.setdefault(title, []).extend(re.findall(r'"(\w+)"', line))
    return {title: names for title, names in out.items() if names}


def main() -> None:
    """Write the pages, or check them."""
    if "--check" in sys.argv:
        old = [name for name, page in pages().items() if (FOLDER / name).read_text("utf-8") != page]
        sys.exit(f"{', '.join(old)} is not that of the code: run `python docs/reference.py`" if old else 0)
    for name, page in pages().items():
        (FOLDER / name).write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
