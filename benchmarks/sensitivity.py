"""What the tuned constants move when they are halved and doubled.

    python -m benchmarks.sensitivity [NAME…] [--only AREA] [--idle] [--list] [--quick] [--fresh]

A tuned constant is a field of a frozen dataclass or NamedTuple whose one instance is a module constant, such
as `LIMITS = OutlierLimits()`. Each is changed in a copy of the code, and the development cases run there, in
a fork of one process that has imported it. `--idle` searches only for constants that move nothing: a run ends
at the first number that moves, and a constant that moved one when halved is not doubled. A constant that no
case reads has "not reached". Rows that are done are kept in `results/sensitivity.json`, so a run that was
stopped goes on; where the code has changed, it starts again. `--list` prints the constants with unit and
origin, and counts limits of files, memory, queues and connections by themselves, for no model has them;
`--quick` changes one constant, in few cases.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import math
import re
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks import ABSENT, machine, number, options_parser, table
from benchmarks.changed import Copy, Field, edit, forget

Numbers = dict[str, float]
AREAS = ("route", "tendon", "identify", "adapt")
ROOT = Path(__file__).parents[1]
ORIGINS = ("derived", "cited", "fitted", "chosen", "measured")
FACTORS = (0.5, 2.0)
_CODE = ("*.py", "*.c", "*.h", "*.inl")
_ROWS = ROOT / "results" / "sensitivity.json"
_AREA_OF_CORE = {
    "constants": "route",
    "constants_route": "route",
    "constants_arcs": "route",
    "constants_tendon": "tendon",
}
_OF_INPUT = (
    *("io.network.", "io.formats.blocks.", "io.formats.laboratory.text.", "summary."),
    *("io.formats.laboratory.raw.RowLimits.sample", "io.formats.laboratory.table.UnnamedLimits.rows"),
    *("route.order.OrderLimits.most_sorted", "smoothed_frames.Window.points"),
    *("adapt.smoothing.SmoothingSettings.most_moments", "identify.mechanisms.KnotSettings.reported"),
)
"""Begins of the names of numbers that bound what is read, kept in memory or written out."""
_SAME = 1e-6  # relative change that counts as none: a search may end one step away
_SMALL = 0.01  # relative change below which a number is not named
_CLOCK = "processor time [s]"  # differs from run to run
_SLOWER = 1.5  # processor times differ by less from run to run
_NAMED = 3  # numbers that a row names, those that move most first
_UNREAD = "not reached"
_MOVED = "moves"


@dataclass(frozen=True, slots=True)
class Constant:
    """One tuned number in the source."""

    file: str
    """Path below the root of the code."""
    container: str
    field: str
    source: str
    """Its default as it is written."""
    span: tuple[int, int, int, int]
    """Line and column of the begin of the default, and of its end; columns in bytes, as `ast` counts."""
    text: str
    """Its documentation."""
    class_text: str
    class_end: int
    """Last line of the container."""

    @property
    def name(self) -> str:
        """Module, container and field."""
        return f"{self.file.removesuffix('.py').replace('/', '.')}.{self.container}.{self.field}"

    @property
    def key(self) -> Field:
        """Module, container and field as Python imports them."""
        return self.file.removesuffix(".py").replace("/", "."), self.container, self.field

    @property
    def unit(self) -> str:
        """Unit in brackets, as the documentation has it."""
        match = re.search(r"\[([^\]]+)\]", self.text)
        return match[1] if match else ABSENT

    @property
    def origin(self) -> str:
        """The word of the field's documentation, or else of the container's; a dash where there is none."""
        for text in (self.text, self.class_text):
            for word in ORIGINS:
                if re.search(rf"\b{word}\b", text, re.IGNORECASE):
                    return word
        return ABSENT

    @property
    def area(self) -> str | None:
        """The cases that may show it; None where there are none."""
        folder, stem = (self.file.split("/")[1] if "/" in self.file else ""), Path(self.file).stem
        if folder == "core":
            return _AREA_OF_CORE.get(stem)
        folder = {"statistics.py": "route", "stream.py": "route", "effects": "tendon"}.get(folder, folder)
        return folder if folder in AREAS else None

    def scaled(self, factor: float) -> Any:
        """Return the default times a factor; None where it is no number or would stay as it is."""
        try:
            value = eval(self.source, {"__builtins__": {"tuple": tuple, "range": range}, "math": math})
        except NameError:
            return None
        new = _scaled(value, factor)
        return None if new == value else new


def _scaled(value: object, factor: float) -> object:
    match value:
        case bool() | str():
            return None
        case int():
            return max(int(value * factor), min(value, 1))
        case float():
            return value * factor
        case tuple():
            parts = [_scaled(part, factor) for part in value]
            return None if None in parts else tuple(parts)
    return None


def constants(root: Path) -> list[Constant]:
    """Return every tuned constant below `tssgeom`, module by module; rows of matrices are none."""
    paths = sorted(each for each in (root / "tssgeom").rglob("*.py") if not each.stem.endswith("_rows"))
    return [each for path in paths for each in _of_module(path, str(path.relative_to(root)))]


def _of_module(path: Path, file: str) -> Iterator[Constant]:
    code = path.read_text(encoding="utf-8")
    body = ast.parse(code).body
    made = re.findall(r"^_?[A-Z][A-Z0-9_]*(?:: [^=\n]+)? = (\w+)\(\)", code, re.MULTILINE)
    for node in body:
        if isinstance(node, ast.ClassDef) and node.name in made and _is_frozen(node):
            yield from _of_class(node, file, code)


def _is_frozen(node: ast.ClassDef) -> bool:
    decorators = [ast.unparse(one) for one in node.decorator_list]
    frozen = any(one.startswith("dataclass(") and "frozen=True" in one for one in decorators)
    return frozen or "NamedTuple" in [ast.unparse(base) for base in node.bases]


def _of_class(node: ast.ClassDef, file: str, code: str) -> Iterator[Constant]:
    for i, one in enumerate(node.body):
        if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name) and one.value is not None:
            after = node.body[i + 1] if i + 1 < len(node.body) else None
            text = ""
            if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                text = str(after.value.value)
            value = one.value
            position = (value.lineno, value.col_offset, value.end_lineno or 0, value.end_col_offset or 0)
            source = ast.get_source_segment(code, value) or ""
            about = text, ast.get_docstring(node) or "", node.end_lineno or 0
            yield Constant(file, node.name, one.target.id, source, position, *about)


def changes(before: Numbers, after: Numbers) -> str:
    """Say which numbers moved, those that moved most first."""
    sizes = dict[str, float]()
    for name, old in before.items():
        new = after.get(name, math.nan)
        ratio = abs(new - old) / max(abs(old), 1e-12)
        if name != _CLOCK or max(new, old) > _SLOWER * min(new, old):
            sizes[name] = ratio
    moved = [name for name in sizes if not sizes[name] <= _SAME]
    large = sorted((name for name in moved if not sizes[name] <= _SMALL), key=lambda name: -sizes[name])
    if not moved or not large:
        return f"below {_SMALL:.0%}" if moved else "NOTHING"
    named = [f"{name} {number(before[name])} → {number(after.get(name, math.nan))}" for name in large]
    return "; ".join([*named[:_NAMED], *([f"{len(large) - _NAMED} more"] if len(large) > _NAMED else [])])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    chosen = [
        each
        for each in constants(ROOT)
        if (not options.only or each.area == options.only)
        and (not options.names or any(word in each.name for word in options.names))
    ]
    if options.list:
        print(listing(chosen, markdown=options.markdown))
        return 0
    print(machine())
    usable = [each for each in chosen if each.area]
    if options.quick:
        usable.sort(key=lambda each: (each.area == "identify", each.name))
        usable = usable[:1]
    path = _ROWS.with_name("sensitivity_idle.json") if options.idle else _ROWS
    rows = _Rows(None if options.quick else path, fresh=options.fresh)
    with TemporaryDirectory(prefix="sensitivity-") as room:
        run = _Run(Path(room), rows, usable, quick=options.quick, idle=options.idle)
        try:
            run.all_rows()
        finally:
            run.copy.close()
    print(_table(usable, rows.done, markdown=options.markdown))
    if others := len(chosen) - len(usable):
        print(f"\n{others} constants have no development cases: no row")
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "one constant in few cases; keeps no rows")
    parser.add_argument("names", nargs="*", metavar="NAME", help="only constants with this in their name")
    parser.add_argument("--only", choices=AREAS, help="only constants of one area")
    parser.add_argument("--list", action="store_true", help="print the constants with unit and origin")
    parser.add_argument("--idle", action="store_true", help="search only for constants that move nothing")
    parser.add_argument("--fresh", action="store_true", help="forget the rows that are done")
    return parser.parse_args(arguments)


class _Rows:
    """Numbers by constant and factor, kept in a file as long as the code stays the same."""

    def __init__(self, path: Path | None, *, fresh: bool) -> None:
        digest = hashlib.sha256()
        for each in sorted(path for kind in _CODE for path in (ROOT / "tssgeom").rglob(kind)):
            digest.update(each.read_bytes())
        self.path, self.code = path, digest.hexdigest()
        kept = json.loads(path.read_text("utf-8")) if path and path.exists() and not fresh else {}
        self.done: dict[str, Numbers | str] = kept["rows"] if kept.get("code") == self.code else {}

    def add(self, key: str, result: Numbers | str) -> None:
        """Keep the numbers of one run, or the reason why there are none."""
        self.done[key] = result
        if self.path:
            self.path.parent.mkdir(exist_ok=True)
            self.path.write_text(json.dumps({"code": self.code, "rows": self.done}), encoding="utf-8")


class _Run:
    """The rows of chosen constants."""

    def __init__(
        self, folder: Path, rows: _Rows, chosen: Sequence[Constant], *, quick: bool, idle: bool
    ) -> None:
        ends = dict[str, dict[str, int]]()
        for each in constants(ROOT):
            ends.setdefault(each.file, {})[each.container] = each.class_end
        self.copy = Copy(ROOT, folder, {file: list(each.items()) for file, each in ends.items()})
        self.rows, self.chosen, self.quick, self.idle = rows, chosen, quick, idle
        self.folder, self.before = folder, dict[str, dict[str, Any]]()

    def all_rows(self) -> None:
        """Compute every row that is not done."""
        jobs = [
            (each, x) for each in self.chosen for x in FACTORS if f"{each.name} {x}" not in self.rows.done
        ]
        for area in dict.fromkeys(each.area or "" for each, _ in jobs):
            print(f"{area}: as it is", file=sys.stderr, flush=True)
            self.before[area] = before = self.copy.run(area, quick=self.quick)
            if "numbers" not in before:
                raise RuntimeError(f"{area} fails as it is: {before['failed']}")
            self.rows.add(area, before["numbers"] | {_CLOCK: before["seconds"]})
        begin = time.perf_counter()
        for count, (constant, factor) in enumerate(jobs):
            passed = time.perf_counter() - begin
            left = f", {passed / count * (len(jobs) - count) / 60:.0f} min left" if count else ""
            result = self._row(constant, factor)
            word = result if isinstance(result, str) else "done"
            print(f"{count + 1} of {len(jobs)}{left}: {constant.name} × {factor:g}: {word}", file=sys.stderr)
            self.rows.add(f"{constant.name} {factor}", result)

    def _row(self, constant: Constant, factor: float) -> Numbers | str:
        before, (module, container, field) = self.before[constant.area or ""], constant.key
        name = [f"{module}.{container}", field]
        if (new := constant.scaled(factor)) is None:
            return ABSENT
        imported = name in before["imported"]
        if not (imported or name in before["reads"] or ".core." in module):
            return _UNREAD
        if (
            self.idle
            and factor == FACTORS[1]
            and self.rows.done.get(f"{constant.name} {FACTORS[0]}") == _MOVED
        ):
            return ABSENT
        more = {"before": before["taken"]} if self.idle else {}
        if imported:
            answer = self._edited(constant, new, more)
        else:
            answer = self.copy.run(constant.area or "", quick=self.quick, field=constant.key, new=new, **more)
        if answer.get("moved"):
            return _MOVED
        if "numbers" not in answer:
            return f"fails: {answer['failed']}"
        return answer["numbers"] | {_CLOCK: answer["seconds"]}

    def _edited(self, constant: Constant, new: object, more: Mapping[str, Any]) -> dict[str, Any]:
        """Run with the constant changed in the source, since it is read while modules are imported."""
        path = self.folder / constant.file
        kept = path.read_bytes()
        in_copy = next(each for each in constants(self.folder) if each.name == constant.name)
        edit(path, in_copy.span, repr(new))
        self.copy.restart()
        answer = self.copy.run(constant.area or "", quick=self.quick, **more)
        path.write_bytes(kept)
        forget(path)
        self.copy.restart()
        return answer


def _table(chosen: Sequence[Constant], done: Mapping[str, Numbers | str], *, markdown: bool) -> str:
    def cell(each: Constant, factor: float) -> str:
        before, after = done.get(each.area or ""), done.get(f"{each.name} {factor}", ABSENT)
        return changes(before, after) if isinstance(before, dict) and isinstance(after, dict) else str(after)

    rows = [
        [_short(each), each.unit, each.origin, each.source, *(cell(each, factor) for factor in FACTORS)]
        for each in chosen
    ]
    header = ["constant", "unit", "origin", "value", "½ ×", "2 ×"]
    return table(header, rows, text_columns=6, markdown=markdown)


def listing(chosen: Sequence[Constant], *, markdown: bool) -> str:
    """Return every constant with unit and origin, and how many of each kind, and without an origin."""
    rows = [[_short(each), each.source, each.unit, each.origin] for each in chosen]
    without = sum(each.origin == ABSENT for each in chosen)
    of_input = sum(_short(each).startswith(_OF_INPUT) for each in chosen)
    lines = table(["constant", "value", "unit", "origin"], rows, text_columns=4, markdown=markdown)
    counts = f"{len(chosen) - of_input} tuned constants and {of_input} limits of input"
    return f"{lines}\n\n{counts}, {without} without an origin"


def _short(constant: Constant) -> str:
    return constant.name.removeprefix("tssgeom.")


if __name__ == "__main__":
    sys.exit(main())
