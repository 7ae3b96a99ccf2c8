"""Draw small faults in the code at random, and list those that no test detects.

    pytest --cov --cov-context=test              # once, some 40 min: which test runs which line; not with -n0
    python -m tests.mutants                      # 200 faults; a table, exit status 1 below 95 % detected
    python -m tests.mutants --count 20 --seed 3 core route

Here are the faults; `tests/mutation.py` runs the tests on them.
"""

import ast
import random
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("core", "identify", "io", "route", "tendon")
GENERATED = ("_entries.py", "_declarations.py", "build.py", "hook.py")

_REVERSED = {"<": ">=", ">": "<=", "<=": ">", ">=": "<", "==": "!=", "!=": "=="}
_NEGATED = {"is": "is not", "in": "not in"}
_EXCHANGED = {"+": "-", "-": "+", "*": "/", "/": "*", "and": "or", "or": "and", "&&": "||", "||": "&&"}
_CHANGED = {**_REVERSED, **_NEGATED, **_EXCHANGED, "min": "max", "max": "min", "fmin": "fmax", "fmax": "fmin"}
_IN_C = re.compile(r"(?<= )(?:[-+*/](?==? )|[<>]=?(?= )|[=!]=(?= )|&&|\|\|)|\bf(?:min|max)(?=\()")
_WITH_FAULTS = ast.BoolOp | ast.Compare | ast.NamedExpr | ast.UnaryOp
"""Conditions of Python that have faults of their own, or would need brackets."""
_NO_CODE_IN_C = re.compile(r'/\*.*?\*/|//[^\n]*|"[^"\n]*"|^[ \t]*#[^\n]*', re.DOTALL | re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Mutant:
    """One small fault: some characters of a file are replaced."""

    file: str
    line: int
    start: int
    """Where the replaced characters begin, of all of the file."""
    old: str
    new: str

    def put_into(self, text: str) -> str:
        """Return the text of the file with the fault."""
        assert text.startswith(self.old, self.start)
        return f"{text[: self.start]}{self.new}{text[self.start + len(self.old) :]}"

    def described(self, text: str) -> str:
        """Return the fault in one line."""
        begin = text.rfind("\n", 0, self.start) + 1
        end = text.find("\n", self.start) % (len(text) + 1)
        broken = f"{text[begin : self.start]}{self.new}{text[self.start + len(self.old) : end]}".strip()
        return f"{self.file.removeprefix('tssgeom/')}:{self.line}: {self.old or 'if'} → {self.new}: {broken}"


def sampled(count: int, seed: int, packages: tuple[str, ...] = PACKAGES) -> list[Mutant]:
    """Draw faults, the same number in each package, each line of a package with the same chance."""
    rng, mutants = random.Random(seed), list[Mutant]()
    for rank, package in enumerate(packages):
        share = (count + rank) // len(packages)
        lines = dict[tuple[str, int], list[Mutant]]()
        for path in sorted((ROOT / "tssgeom" / package).rglob("*")):
            if path.suffix in (".c", ".h", ".inl", ".py") and path.name not in GENERATED:
                for each in mutants_of(path):
                    lines.setdefault((each.file, each.line), []).append(each)
        chosen = rng.sample(sorted(lines), min(share, len(lines)))
        mutants += [rng.choice(lines[line]) for line in sorted(chosen)]
    return mutants


def mutants_of(path: Path) -> list[Mutant]:
    """Return the faults of one file."""
    text, file = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
    tokens = _in_python(text) if path.suffix == ".py" else _in_c(text)
    return [Mutant(file, text.count("\n", 0, at) + 1, at, old, new) for at, old, new in tokens]


def _in_c(text: str) -> Iterator[tuple[int, str, str]]:
    code = _NO_CODE_IN_C.sub(lambda text: re.sub(r"[^\n]", " ", text[0]), text)
    for token in _IN_C.finditer(code):
        yield token.start(), token[0], _CHANGED[token[0]]


def _in_python(text: str) -> Iterator[tuple[int, str, str]]:
    begins = [0]
    for line in text.splitlines(keepends=True):
        begins.append(begins[-1] + len(line))

    def at(line: int, column: int) -> int:  # the tree counts bytes
        return begins[line - 1] + len(text[begins[line - 1] : begins[line]].encode()[:column].decode())

    def start(node: ast.expr) -> int:
        return at(node.lineno, node.col_offset)

    def between(left: ast.expr, right: ast.expr) -> Iterator[tuple[int, str, str]]:
        assert left.end_lineno is not None
        assert left.end_col_offset is not None
        begin = at(left.end_lineno, left.end_col_offset)
        for token in re.finditer(r"[-+*/<>=!]+|\b(?:and|or|is|in)\b(?! not)", text[begin : start(right)]):
            if token[0] in _CHANGED and "not" not in text[begin : start(right)]:
                yield begin + token.start(), token[0], _CHANGED[token[0]]

    for node in _executed(ast.parse(text)):
        if isinstance(node, ast.BinOp):
            yield from between(node.left, node.right)
        elif isinstance(node, ast.BoolOp):
            yield from between(*node.values[:2])
        elif isinstance(node, ast.Compare) and len(node.ops) == 1:
            yield from between(node.left, node.comparators[0])
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            yield start(node), "-" if isinstance(node.op, ast.USub) else "not ", ""
        elif (
            isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("min", "max")
        ):
            yield start(node.func), node.func.id, _CHANGED[node.func.id]
        elif isinstance(node, ast.If | ast.IfExp) and isinstance(
            node.test, ast.Name | ast.Attribute | ast.Call
        ):
            yield start(node.test), "", "not "


def _executed(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what is below a node, without what only checks types or words messages."""
    for child in ast.iter_child_nodes(node):
        types = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
        if not types and not isinstance(child, ast.Assert | ast.JoinedStr):
            yield child
            yield from _executed(child)


if __name__ == "__main__":
    from tests.mutation import main

    sys.exit(main())
