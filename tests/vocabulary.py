"""List the private words that are left in names and in prose; docs/glossary.md has the words to use.

    python -m tests.vocabulary            # counts by word and by file; exit status 1 where one is left
    python -m tests.vocabulary found gap  # every name and line that holds one of the words

Names are those of modules, functions, arguments, variables and attributes, split at underscores and capitals;
names inside f-strings count. Names of tests are sentences. Prose is docstrings, comments, documents, and the
strings of more than one word outside tests, which are messages. Of C files the comments count.
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
    "doubt doubts doubtful": "by_models",
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
    ("tssgeom/io/results/keys/", r"told|seen|points_not_seen|place_m|answered", "keys of JSON"),
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
"""Where the file starts so, names that match stay; the last entry is the reason. Keep this short."""

_FRAMES = ("benchmarks/", "tests/live/", "pipelines/", "tssgeom/io/network/", "docs/", "README", "CHANGELOG")
_PICTURES = ("tssgeom/view/", "tests/view/", "docs/view.md")
_IMAGES = ("tssgeom/vision/", "tests/vision/", "tests/scenes/", "benchmarks/track")

PHRASES = (
    # Names that a text mentions.
    ("", r"`(?! )[^`]*\b(gap|size_over_guard|remedy|seen|light)\b[^`]*(?<! )`", "keys, commands and options"),
    ("", r"[Tt]he remedy of (Theorem 3|the paper)|(tssgeom|test) remedy", "Theorem 3 and its command"),
    ("docs/json_keys.py", r"remedy --json, remedy\.json", "a command and its file"),
    ("tssgeom/tendon/paper.py", r"remedy", "the paper's own word"),
    ("tssgeom/view/figures/paper.py", r"remedy", "the paper's own word"),
    ("", r"[Ll]ight, dark|dark on light", "styles of pictures"),
    ("", r"command not found", "message of a shell"),
    # Terms of numerics and mathematics that contain a word of the table.
    ("", r"\bin place\b(?! of)", "an array that is changed itself"),
    ("", r"compiled ahead of time", "before the program runs"),
    ("", r"leading blocks?", "of a matrix"),
    ("", r"odd number", "not even"),
    ("", r"lay (the sheath|it)", "a sheath is laid, as a cable is"),
    # Ordinary words: the word of the table stands for another thing.
    *((start, r"answered", "a frame is answered") for start in _FRAMES),
    *((start, r"drawn|screens?|margins?", "of a picture and its display") for start in _PICTURES),
    *((start, r"blur|light", "of an image") for start in _IMAGES),
)
"""Where the file starts so, words inside a matching phrase of prose stay; the last entry is the reason."""

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


def private_uses(text: str, file: str = "") -> list[str]:
    """Return the private words of a line of prose in a file, but for those inside an allowed phrase."""
    allowed = [
        match.span()
        for start, phrase, _ in PHRASES
        if file.startswith(start)
        for match in re.finditer(phrase, text)
    ]
    return [
        word.group().lower()
        for word in _PROSE.finditer(text)
        if word.group().lower() in WORDS
        and not any(begin <= word.start() and word.end() <= end for begin, end in allowed)
    ]


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
    for node in _docstrings(code):
        yield from enumerate(str(node.value).splitlines(), node.lineno)


def messages(code: str) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of every string in a module that is no docstring and holds a space."""
    docstrings = {(node.lineno, node.col_offset) for node in _docstrings(code)}
    for node in ast.walk(ast.parse(code)):
        match node:
            case ast.Constant(value=str(text)) if " " in text:
                if (node.lineno, node.col_offset) not in docstrings:
                    yield node.lineno, text


def _docstrings(code: str) -> Iterator[ast.Constant]:
    for node in ast.walk(ast.parse(code)):
        match node:
            case ast.Expr(value=ast.Constant(value=str()) as text):
                yield text


def comments(code: str) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of every line of the comments in C code."""
    for comment in re.finditer(r"/\*.*?\*/|//[^\n]*", code, re.DOTALL):
        yield from enumerate(comment.group().splitlines(), code.count("\n", 0, comment.start()) + 1)


def _of_module(path: Path, file: str) -> Iterator[Use]:
    code = path.read_text(encoding="utf-8")
    tokens = list(tokenize.generate_tokens(io.StringIO(code).readline))
    met = set[str]()
    for line, name in [(0, path.stem), *names(tokens)]:
        if name not in met:  # a name counts once a file
            met.add(name)
            if name.startswith("test_") and line:
                sentence = name.replace("_", " ")
                yield from (Use(word, file, line, name, "sentence") for word in private_uses(sentence, file))
            else:
                yield from (Use(word, file, line, name, "name") for word in private_words(name, file))
    yield from _of_prose(prose(code, tokens), file)
    if not file.startswith("tests/"):
        yield from _of_prose(messages(code), file)


def _of_prose(lines: Iterable[tuple[int, str]], file: str) -> Iterator[Use]:
    for line, text in lines:
        yield from (Use(word, file, line, text.strip(), "prose") for word in private_uses(text, file))


def pages(root: Path) -> list[Path]:
    """Return the documents below docs, without those that a build of the site writes there."""
    written = ("_build/", "examples/", "reference/python_")
    every = sorted((root / "docs").rglob("*.md"))
    return [path for path in every if not path.relative_to(root / "docs").as_posix().startswith(written)]


def _sources(root: Path, kind: str) -> list[Path]:
    every = sorted(path for folder in FOLDERS for path in (root / folder).rglob(kind))
    return [path for path in every if "_build" not in path.relative_to(root).parts]


def uses(root: Path) -> list[Use]:
    """Return every private word that is left below a folder."""
    left = list[Use]()
    for path in _sources(root, "*.py"):
        if path.stem not in ("vocabulary", "test_vocabulary", "_entries"):  # they hold the words; of headers
            left += _of_module(path, str(path.relative_to(root)))
    for path in _sources(root, "*.[ch]"):
        left += _of_prose(comments(path.read_text(encoding="utf-8")), str(path.relative_to(root)))
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
    """Print what is left; return 1 where a private word is left."""
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
    sys.stdout.write(
        f"private words left: {count(left, 'name')} in names, {count(left, 'sentence')} in names of tests,"
        f" {count(left, 'prose')} in prose\n"
    )
    return int(bool(left))


if __name__ == "__main__":
    sys.exit(main())
