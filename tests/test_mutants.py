"""The mutants of `tests/mutants.py` fit the code as it is; running the tests on them takes longer, apart."""

import ast
import re

import pytest

from tests.mutants import MUTANTS
from tests.mutation import ROOT


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda each: each.text)
def test_a_mutant_changes_one_text_of_the_program(mutant):
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    assert text.count(mutant.old) == 1, f"the code has moved on: mend {mutant.text!r} in tests/mutants.py"
    broken = text.replace(mutant.old, mutant.new)
    if mutant.file.endswith((".c", ".h", ".inl")):
        assert re.sub(r"/\*.*?\*/", "", broken, flags=re.DOTALL) != re.sub(
            r"/\*.*?\*/", "", text, flags=re.DOTALL
        )
    else:
        assert ast.dump(ast.parse(broken)) != ast.dump(ast.parse(text))
