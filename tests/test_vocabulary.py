"""`python -m tests.vocabulary` lists private words wherever they stand, and none is left."""

import re
from pathlib import Path

import pytest

import tssgeom
from tests.vocabulary import ROOT, WORDS, comments, parts, private_uses, private_words, uses

PLANTED = '''"""Where the stray went."""

def misfit_of(gap_mm, *, limit):
    oddest = gap_mm  # the guard
    return f"{limit.isBlamed:.3g} told {oddest}"

def test_a_place_is_kept():
    raise FileNotFoundError("a rival is lost")
'''


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "tssgeom").mkdir()
    (tmp_path / "tssgeom" / "bed.py").write_text(PLANTED, encoding="utf-8")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "page.md").write_text("Nothing.\nA crew works.\n", encoding="utf-8")
    (tmp_path / "docs" / "glossary.md").write_text("The words we do not use: crew.\n", encoding="utf-8")
    return tmp_path


def test_a_planted_word_is_listed_with_its_file_and_line(tree):
    assert {(use.word, use.line, use.kind) for use in uses(tree) if use.file == "tssgeom/bed.py"} == {
        ("bed", 0, "name"),
        ("gap", 3, "name"),
        ("oddest", 4, "name"),
        ("blamed", 5, "name"),  # inside an f-string
        ("place", 7, "sentence"),
        ("stray", 1, "prose"),
        ("guard", 4, "prose"),
        ("told", 5, "prose"),
        ("rival", 8, "prose"),
    }
    assert [(use.file, use.line) for use in uses(tree) if use.word == "crew"] == [("docs/page.md", 2)]


def test_names_are_split_at_underscores_and_capitals():
    assert parts("_DetectionLimit_of_CSVFile2") == ["detection", "limit", "of", "csv", "file", "2"]


def test_names_of_the_contract_and_of_python_are_allowed():
    assert not private_words("gap")
    assert not private_words("size_over_guard")
    assert not private_words("FileNotFoundError")
    assert private_words("gap_mm") == ["gap"]
    assert private_words("drawn", "tssgeom/route/summary.py") == ["drawn"]
    assert not private_words("drawn", "tssgeom/view/mesh.py")


def test_prose_keeps_the_names_and_terms_that_contain_a_private_word():
    assert not private_uses("The key `gap`, an array changed in place, and the remedy of Theorem 3")
    assert private_uses("The remedy of a fault takes the place of a hint") == ["remedy", "place"]
    assert private_uses("`a` gap `b`") == ["gap"]
    assert private_uses("a frame is answered", "tests/live/test_answers.py") == []
    assert private_uses("a frame is answered", "tssgeom/frame.py") == ["answered"]


def test_comments_of_c_are_prose():
    code = "int gap; /* one\n   stray */ // two\n"
    assert list(comments(code)) == [(1, "/* one"), (2, "   stray */"), (2, "// two")]


def test_every_private_word_has_its_replacement_in_the_glossary():
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    not_used = glossary.partition("## Words we do not use")[2]
    assert not [instead for instead in set(WORDS.values()) if instead not in not_used]


def test_the_code_names_of_the_glossary_are_names_of_the_code():
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").partition("## Words")[0]
    rows = [line.split(" | ") for line in glossary.splitlines() if line.startswith("| ")]
    listed = {name for row in rows for name in re.findall(r"`(\w+)`", row[3])}
    modules = [*(ROOT / "tssgeom").rglob("*.py"), *(ROOT / "pipelines").rglob("*.py")]
    known = {word for path in modules for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    assert len(listed) > 60
    assert listed <= known


def test_the_glossary_has_every_term_once_and_every_public_class():
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").partition("## Words")[0]
    rows = [line.split(" | ") for line in glossary.splitlines() if line.startswith("| ")]
    terms = [row[0] for row in rows if row[0] != "| term"]
    listed = {name for row in rows for name in re.findall(r"`(\w+)`", row[3])}
    public = {name for name in tssgeom.__all__ if isinstance(getattr(tssgeom, name), type)}
    assert len(terms) == len(set(terms))
    assert {name for name in public if not name.endswith("Error")} <= listed


def test_no_private_word_is_left():
    assert [(use.file, use.line, use.word, use.text) for use in uses(ROOT)] == []
