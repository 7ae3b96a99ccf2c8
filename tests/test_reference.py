"""The pages of the reference are those of the code, and pages that give code execute some."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
GUIDES = [
    DOCS / "tutorial.md",
    *sorted((DOCS / "howto").glob("*.md")),
    *sorted((DOCS / "explanation").glob("*.md")),
]
PAGES = sorted(set(DOCS.rglob("*.md")) - set((DOCS / "_build").rglob("*.md")))


def test_commands_keys_and_columns_are_those_of_the_code():
    done = subprocess.run([sys.executable, DOCS / "reference.py", "--check"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(DOCS).as_posix())
def test_a_page_with_code_has_code_that_is_executed(page):
    text = page.read_text("utf-8")
    fenced = re.findall(r"^```(\{?\w+\}?)", text, re.MULTILINE)
    code = [kind for kind in fenced if kind not in ("{toctree}", "{include}")]
    assert not code or "{run}" in code
    if page in GUIDES:
        assert all(kind == "{run}" for kind in code)
    # elsewhere: rigs, PLUS, and examples that need a second program; tests/live/test_docs.py runs them
    assert set(code) <= {"{run}", "toml", "xml"} or page.name == "live.md"


def test_each_script_of_the_gallery_is_in_its_order():
    order = (DOCS / "building" / "gallery_order.py").read_text("utf-8")
    names = sorted(path.stem for path in (DOCS / "gallery").glob("*.py"))
    assert names == sorted(re.findall(r'^    "(\w+)",$', order, re.MULTILINE))
    assert len(names) >= 12
