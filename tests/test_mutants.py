"""The mutants of `tests/mutants.py` fit the code as it is; whether tests see them is its own, longer run."""

import ast

import pytest

from tests.mutants import MUTANTS, ROOT


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda each: each.shown)
def test_a_mutant_changes_one_place_and_is_still_python(mutant):
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    assert text.count(mutant.old) == 1, f"the code has moved on: mend {mutant.shown!r} in tests/mutants.py"
    broken = text.replace(mutant.old, mutant.new)
    assert ast.dump(ast.parse(broken)) != ast.dump(ast.parse(text))
