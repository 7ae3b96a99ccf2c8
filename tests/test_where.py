"""docs/where.md is the table of the code, and its topics name functions that exist."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "docs" / "where.py"


def checked(script: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True, check=False)


@pytest.fixture
def script(tmp_path: Path) -> Path:
    """The script beside a model of two equations, a page and one function in each language."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "tssgeom").mkdir()
    shutil.copy2(SCRIPT, tmp_path / "docs")
    (tmp_path / "docs" / "model.md").write_text("## One\n\n> **(1)** a = b\n\n> **(20a)** c = d\n")
    (tmp_path / "docs" / "where.md").write_text(
        "In `one.c` · `first`.\n\n<!-- equations: written by docs/where.py -->\n"
    )
    (tmp_path / "tssgeom" / "one.c").write_text(
        "/* As (20a) below. */\n\n/* (1) */\nint first(int a) { return a; }\n"
    )
    (tmp_path / "tssgeom" / "two.py").write_text(
        'class Two:\n    def second(self):\n        """Paper, eq. (1), as in (20a)."""\n'
    )
    return tmp_path / "docs" / SCRIPT.name


def test_the_page_is_that_of_the_code():
    done = checked(SCRIPT)
    assert (done.returncode, done.stderr) == (0, "")


def test_an_equation_is_where_a_function_states_it_and_those_of_the_paper_are_none(script):
    subprocess.run([sys.executable, script], check=True)
    page = script.with_suffix(".md").read_text("utf-8")
    assert "| (1) | `one.c` · `first` |\n| (20a) | `two.py` · `Two.second` |" in page
    assert checked(script).returncode == 0


def test_an_old_table_an_equation_without_code_and_a_function_that_went_are_reported(script):
    subprocess.run([sys.executable, script], check=True)
    (script.parents[1] / "tssgeom" / "one.c").write_text("/* (20a) */\nint another(int a) { return a; }\n")
    assert "the table is not that of the code" in checked(script).stderr
    subprocess.run([sys.executable, script], check=True)
    said = checked(script).stderr
    assert "no line of the code states equation (1)" in said
    assert "one.c has no first" in said
