"""List the private words that are left in names and in prose; docs/glossary.md has the words to use.

    python -m tests.vocabulary            # counts by word and by file; exit status 1 where a name is left
    python -m tests.vocabulary found gap  # every name and line that holds one of the words

Names are those of modules, functions, arguments, variables and attributes, split at underscores and capitals;
names inside f-strings count. Names of tests are sentences, and prose is docstrings, comments and documents:
both are counted, and do not change the exit status.
"""

import argparse
import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

ROOT = Path(__file__).parents[1]
FOLDERS = ("tssgeom", "pipelines", "benchmarks", "tests", "docs")
DOCUMENTS = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")

REPLACED = {
    "told untold tell tells telling": "observed, known, identifiable, selected",
    "seen unseen shown unshown found": "result, estimate, prediction, detected",
    "place places placed": "position, storage, heat map",
    "gap gaps": "spacing, clearance, misfit, interval",
    "look looks looked screen screens screened": "score test, screening",
    "stray strays": "outlier",
    "faced facing aim aims aimed blur blurred heft": "tangents, variance, weight",
    "ahead lead leads leading margin margins": "log_evidence_difference",
    "lay lays laid bed beds": "discretise, contact grid",
    "blame blamed blames": "misfit attribution",
    "acting": "with_effects",
    "account accounts": "posterior summary, running summary",
    "doubt doubts doubtful": "model_choice_variance",
    "weighed weighing": "whitened, noise model",
    "settle settles settled": "fit, converged",
    "odd odder oddest oddity oddities": "outlying inputs",
    "guard guards guarded": "detection limit",
    "hired crew died": "pool, worker, worker lost",
    "drawn lean light bare": "samples, strip()",
    "question questions answered reconsidered rival rivals": "model check, candidate model",
    "remedy remedies": "hint; Theorem 3 keeps remedy",
}
WORDS = {word: instead for words, instead in REPLACED.items() for word in words.split()}

ALLOWED = (
    # Words of the contract: keys of JSON files and commands keep their names.
    ("", r"gap", "key of findings and of report.json"),
    ("", r"size_over_guard", "key of findings"),
    ("", r"_?(\w+_)?(remedy|Remedy|REMEDY)(_\w+)?", "Theorem 3 and its command"),
    # Names of Python and of other packages.
    ("", r"\w+NotFoundError|allow_not_found|notfound", "Python and pyarrow"),
    ("", r"margins?|set_\w*margins?|light|look_target", "matplotlib, CSS and rerun"),
    ("tssgeom/io/formats/npz.py", r"tell", "position in a file, in Python"),
    # Ordinary words: the word of the table stands for another thing.
    ("tssgeom/view/", r"_?(drawn|DRAWN)(_\w+)?|_?draw_\w+", "a picture is drawn"),
    ("tests/view/", r"_?(drawn|DRAWN)(_\w+)?|test_drawn", "a picture is drawn"),
    *(
        (start, r"_?answered(_\w+)?", "a frame is answered")
        for start in ("benchmarks/", "tests/live/", "pipelines/")
    ),
    ("tssgeom/io/network/", r"_?answered(_\w+)?", "a frame is answered"),
    ("tssgeom/vision/", r"_?(light|LIGHT)(_\w+)?", "brightness of a pixel"),
    ("tests/scenes/", r"blur", "of an image"),
    ("tssgeom/view/figures/", r"screen", "plane of a picture"),
    ("tests/view/", r"screen", "plane of a picture"),
)
"""Where the file starts so, names that match stay; the last entry says why. Keep this short."""

Kind = Literal["name", "sentence", "prose"]
"""A test's name is a sentence."""

_PART = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")
_PROSE = re.compile(r"[A-Za-z]+")


@dataclass(frozen=True, slots=True)
class Use:
    """One private word in a name or in prose."""

    word: str
    file: str
    line: int
    text: str
    """The name, or the word's line of prose."""
    kind: Kind


def parts(name: str) -> list[str]:
    """Return the words of a name in lower case: `DetectionLimit_of` has detection, limit and of."""
    return [part.lower() for part in _PART.findall(name)]


def private_words(name: str, file: str = "") -> list[str]:
    """Return the private words of a name in a file, none where the name is allowed there."""
    held = [part for part in parts(name) if part in WORDS]
    if held and any(file.startswith(start) and re.fullmatch(pattern, name) for start, pattern, _ in ALLOWED):
        return []
    return held


def names(tokens: Iterable[tokenize.TokenInfo]) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of every name in a module."""
    for token in tokens:
        if token.type == tokenize.NAME:
            yield token.start[0], token.string
        elif token.type == tokenize.STRING and "f" in token.string.partition(token.string[-1])[0].lower():
            yield from ((token.start[0], name) for name in _inside(token.string))


def _inside(literal: str) -> Iterator[str]:
    """Yield the names inside the braces of an f-string, which Python 3.11 keeps in one token."""
    for node in ast.walk(ast.parse(literal, mode="eval")):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
                yield name
            case ast.keyword(arg=str(name)):
                yield name


def prose(code: str, tokens: Iterable[tokenize.TokenInfo]) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of every line of docstrings and comments in a module."""
    yield from ((token.start[0], token.string) for token in tokens if token.type == tokenize.COMMENT)
    for node in ast.walk(ast.parse(code)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield from enumerate(text.splitlines(), node.lineno)


def _of_module(path: Path, file: str) -> Iterator[Use]:
    code = path.read_text(encoding="utf-8")
    tokens = list(tokenize.generate_tokens(io.StringIO(code).readline))
    met = set[str]()
    for line, name in [(0, path.stem), *names(tokens)]:
        if name not in met:  # a name counts once a file
            met.add(name)
            kind = "sentence" if name.startswith("test_") else "name"
            yield from (Use(word, file, line, name, kind) for word in private_words(name, file))
    yield from _of_prose(prose(code, tokens), file)


def _of_prose(lines: Iterable[tuple[int, str]], file: str) -> Iterator[Use]:
    for line, text in lines:
        for word in _PROSE.findall(text):
            if word.lower() in WORDS:
                yield Use(word.lower(), file, line, text.strip(), "prose")


def pages(root: Path) -> list[Path]:
    """Return the documents below docs, without those that a build of the site writes there."""
    written = ("_build/", "examples/", "reference/python_")
    every = sorted((root / "docs").rglob("*.md"))
    return [path for path in every if not path.relative_to(root / "docs").as_posix().startswith(written)]


def uses(root: Path) -> list[Use]:
    """Return every private word that is left below a folder."""
    left = list[Use]()
    for path in sorted(path for folder in FOLDERS for path in (root / folder).rglob("*.py")):
        if path.stem not in ("vocabulary", "test_vocabulary"):  # they hold the words
            left += _of_module(path, str(path.relative_to(root)))
    documents = [root / name for name in DOCUMENTS if (root / name).exists()]
    for path in [*documents, *pages(root)]:
        text = path.read_text(encoding="utf-8")
        if path.name != "glossary.md" and not text.startswith("<!-- written by"):  # words; of docstrings
            lines = enumerate(text.splitlines(), 1)
            left += _of_prose(lines, str(path.relative_to(root)))
    return left


def count(left: Iterable[Use], kind: Kind) -> int:
    """Count the uses of one kind."""
    return sum(use.kind == kind for use in left)


def _table(title: str, left: Sequence[Use], key: str, rows: int) -> str:
    by_kind = [Counter(getattr(use, key) for use in left if use.kind == kind) for kind in get_args(Kind)]
    order = sorted(set().union(*by_kind), key=lambda each: ([-counter[each] for counter in by_kind], each))
    lines = [f"{'names':>6} {'tests':>6} {'prose':>6}  {title}"]
    for each in order[:rows]:
        instead = f"  → {WORDS[each]}" if each in WORDS else ""
        lines.append(" ".join(f"{counter[each]:6}" for counter in by_kind) + f"  {each}{instead}")
    return "\n".join([*lines, *([f"{'':22}… {len(order) - rows} more"] if len(order) > rows else [])])


def main() -> int:
    """Print what is left; return 1 where a name holds a private word."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.vocabulary", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("words", nargs="*", help="print each use of these words")
    parser.add_argument("--under", default="", metavar="PATH", help="only files whose path starts so")
    parser.add_argument("--names", action="store_true", help="print each name, without prose and test names")
    options = parser.parse_args()
    left = [use for use in uses(ROOT) if use.file.startswith(options.under)]
    if options.words or options.names:
        for use in left:
            if (use.word in options.words or not options.words) and (use.kind == "name" or not options.names):
                sys.stdout.write(f"{use.file}:{use.line}: {use.word}: {use.text}\n")
    else:
        sys.stdout.write(_table("word", left, "word", 99) + "\n\n" + _table("file", left, "file", 60) + "\n")
    remaining = count(left, "name")
    sys.stdout.write(
        f"private words left: {remaining} in names, {count(left, 'sentence')} in names of tests,"
        f" {count(left, 'prose')} in prose\n"
    )
    return int(remaining > 0)


if __name__ == "__main__":
    sys.exit(main())
