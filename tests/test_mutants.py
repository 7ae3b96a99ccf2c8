"""The faults that `tests/mutants.py` samples are faults; running the tests on them takes longer, apart."""

import ast

import pytest

from tests.mutants import PACKAGES, ROOT, sampled


@pytest.mark.parametrize("package", PACKAGES)
def test_each_fault_changes_what_is_executed(package):
    for mutant in sampled(60, 2, (package,)):
        text = (ROOT / mutant.file).read_text(encoding="utf-8")
        broken = mutant.put_into(text)
        assert broken != text
        if mutant.file.endswith(".py"):
            assert ast.dump(ast.parse(broken)) != ast.dump(ast.parse(text)), mutant
        else:
            before = text[: mutant.start]
            assert before.count("/*") == before.count("*/"), mutant


def test_a_seed_gives_the_same_faults():
    assert sampled(20, 7) == sampled(20, 7) != sampled(20, 8)


def test_faults_are_sampled_evenly_over_packages():
    files = [each.file for each in sampled(50, 3)]
    assert [sum(file.startswith(f"tssgeom/{one}/") for file in files) for one in PACKAGES] == [10] * 5
