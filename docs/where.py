"""Write the table of docs/where.md: which functions compute which equation of docs/model.md.

python docs/where.py            # writes the table anew, below the topics, which are written by hand
python docs/where.py --check    # is it that of the code, and is everything there that the topics name?

A comment or docstring of the code states the number of its equation: `docs/model.md (29)`, or `; (29)`.
"""

import ast
import io
import re
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGE, MODEL, CODE = ROOT / "docs" / "where.md", ROOT / "docs" / "model.md", ROOT / "tssgeom"
BEGIN = "<!-- equations: written by docs/where.py -->\n"
ASIDE = ("_entries", "_declarations", "constants")  # what the build of the core generates; tuned numbers

ONE = r"\(\d+[a-z]?\)"
OF_PAPER = re.compile(rf"\beqs?\.\s*{ONE}(?:(?:\s*(?:,|and|to|-)\s*){ONE})*")
MARK = re.compile(rf"(?<![\w)])({ONE})(?:(?:-|\s+to\s+)({ONE}))?")
C_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
C_PART = re.compile(
    r"^(?!typedef|enum|#)[A-Za-z][^;{}=]*?(\w+)\s*\([^;{}]*\)\s*(?:\{[^\n]*\}$|\{.*?^\})",
    re.DOTALL | re.MULTILINE,
)
REFERENCE = re.compile(r"`([\w/]+\.\w+)`(?: · ((?:`[\w.]+`(?:, )?)+))?")


class Note(NamedTuple):
    """A comment or docstring, and the function that it is in or above; none where it heads a file."""

    function: str
    text: str


def equations() -> dict[str, str]:
    """Return the numbers of model.md in the order of the page, each with the heading above it."""
    heading, numbers = "", dict[str, str]()
    for line in MODEL.read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            heading = line.lstrip("# ")
        for number in re.findall(rf"\*\*({ONE})\*\*", line):
            numbers[number] = heading
    return numbers


def sources() -> list[Path]:
    """Return the files that compute."""
    paths = [path for kind in ("*.py", "*.c", "*.inl") for path in CODE.rglob(kind)]
    return sorted(path for path in paths if not path.name.startswith(ASIDE))


def notes(path: Path) -> Iterator[Note]:
    """Yield the comments and docstrings of a file."""
    text = path.read_text(encoding="utf-8")
    yield from _of_python(text) if path.suffix == ".py" else _of_c(text)


def parts(path: Path) -> list[str]:
    """Return the names of a file: functions, classes and what a module assigns; a method with its class."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return [match[1] for match in C_PART.finditer(_named(text))]
    tree = ast.parse(text)
    targets = [
        (node.targets if isinstance(node, ast.Assign) else [node.target])
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
    ]
    assigned = [target.id for each in targets for target in each if isinstance(target, ast.Name)]
    return [*assigned, *(name for _, _, name in _python_parts(tree, ""))]


def _python_parts(tree: ast.AST, outer: str) -> Iterator[tuple[int, int, str]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.end_lineno or node.lineno, f"{outer}{node.name}"
            yield from _python_parts(node, f"{outer}{node.name}.")


def _of_python(text: str) -> Iterator[Note]:
    tree = ast.parse(text)
    inside = list(_python_parts(tree, ""))

    def function(line: int) -> str:
        return next((name for first, last, name in reversed(inside) if first <= line <= last), "")

    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield Note(function(token.start[0]), token.string)
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str(words))):
                yield Note(function(node.lineno), words)
            case _:
                pass


def _named(text: str) -> str:
    """Return C with names that a macro makes as they are in it, no comments, each character where it was."""
    text = C_COMMENT.sub(lambda comment: re.sub(r"[^\n]", " ", comment[0]), text)
    return re.sub(r"NAMED\((\w+)\)", lambda macro: macro[1].ljust(len(macro[0])), text)


def _of_c(text: str) -> Iterator[Note]:
    inside = list(C_PART.finditer(_named(text)))
    for comment in C_COMMENT.finditer(text):
        follows = next((one for one in inside if one.end() > comment.end()), None)
        between = text[comment.end() : follows.start()].strip() if follows else "none"
        heads = comment.start() == 0 or (follows and between and follows.start() > comment.start())
        yield Note("" if heads or follows is None else follows[1], comment[0])


def table() -> str:
    """Return the table, section by section of model.md."""
    known = equations()
    order = list(known)
    stated, covered = (
        defaultdict[str, dict[str, list[str]]](dict),
        defaultdict[str, dict[str, list[str]]](dict),
    )
    for path in sources():
        name = path.relative_to(CODE).as_posix()
        for note in notes(path):
            for first, last in MARK.findall(OF_PAPER.sub("", note.text)):
                if first not in known or (last and last not in known):
                    continue
                all_of = [one for one in order if _value(first) <= _value(one) <= _value(last or first)]
                to = stated if note.function and not last else covered
                for number in all_of:
                    functions = to[number].setdefault(name, [])
                    if note.function and note.function not in functions:
                        functions.append(note.function)
    lines, heading = list[str](), ""
    for number in order:
        if known[number] != heading:
            heading = known[number]
            lines += ["", f"## {heading}", "", "| equation | file · functions |", "|---|---|"]
        where = stated.get(number) or covered.get(number, {})
        lines.append(f"| {number} | {'; '.join(_entry(*each) for each in where.items())} |")
    return "\n".join(lines[1:]) + "\n"


def _value(number: str) -> tuple[int, str]:
    """Return what equations are ordered by: "(20a)" is (20, "a")."""
    digits = re.sub(r"\D", "", number)
    return int(digits), number.strip("()").removeprefix(digits)


def _entry(name: str, functions: list[str]) -> str:
    return f"`{name}`" + (" · " + ", ".join(f"`{one}`" for one in functions) if functions else "")


def faults(page: str) -> Iterator[str]:
    """Yield what is wrong with the page."""
    by_hand, _, written = page.partition(BEGIN)
    if written.strip() != table().strip():
        yield "the table is not that of the code: run `python docs/where.py`"
    for line in written.splitlines():
        if line.startswith("| (") and line.endswith("|  |"):
            yield f"no line of the code states equation {line.split()[1]}"
    for name, functions in REFERENCE.findall(by_hand):
        path = next((top / name for top in (CODE, ROOT) if (top / name).exists()), None)
        missing = set(re.findall(r"`([\w.]+)`", functions)) - set(parts(path) if path else ())
        if path is None:
            yield f"there is no {name}"
        elif missing:
            yield f"{name} has no {', '.join(sorted(missing))}"


def main() -> None:
    """Write the table, or check it."""
    page = PAGE.read_text(encoding="utf-8")
    if "--check" in sys.argv:
        sys.exit("\n".join(faults(page)) or 0)
    PAGE.write_text(page.partition(BEGIN)[0] + BEGIN + "\n" + table(), encoding="utf-8")


if __name__ == "__main__":
    main()
