"""The public names of the package: each has a docstring, and the examples in them run."""

import doctest
import inspect
import re
from importlib.metadata import version
from pathlib import Path

import pytest

import tssgeom
from pipelines import tssgeom_version
from tssgeom.field_docs import documented_fields

STAGES = ("analyse", "process", "simulate", "compensate", "calibrate", "discover")
"""The functions that README promises to users of every stage."""


@pytest.mark.parametrize("name", tssgeom.__all__)
def test_a_public_name_is_there_with_a_docstring(name):
    assert inspect.getdoc(getattr(tssgeom, name))


FUNCTIONS = [name for name in tssgeom.__all__ if inspect.isroutine(getattr(tssgeom, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_docstring_of_a_function_has_each_parameter_what_it_returns_and_an_example(name):
    function = getattr(tssgeom, name)
    lines = (inspect.getdoc(function) or "").splitlines()
    assert {"Parameters", "Examples"} <= set(lines)
    assert {"Returns", "Yields"} & set(lines)
    described = {each for line in lines if re.fullmatch(r"\w+(, \w+)*", line) for each in line.split(", ")}
    assert set(inspect.signature(function).parameters) <= described


@pytest.mark.parametrize("name", STAGES)
def test_the_docstring_of_a_stage_has_errors_and_source(name):
    assert {"Raises", "Notes"} <= set((inspect.getdoc(getattr(tssgeom, name)) or "").splitlines())


@pytest.mark.parametrize("name", [*FUNCTIONS, "Engine"])
def test_the_example_of_a_function_runs(name, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[1])
    function = getattr(tssgeom, name)
    examples = doctest.DocTestFinder(recurse=False).find(function, name, globs={})
    runner = doctest.DocTestRunner()
    assert sum(runner.run(example).attempted for example in examples) > 0
    assert runner.failures == 0


@pytest.mark.parametrize("name", [name for name in tssgeom.__all__ if name[0].isupper()])
def test_every_field_of_a_public_class_is_described_in_its_help(name):
    kind = getattr(tssgeom, name)
    fields = getattr(kind, "__struct_fields__", getattr(kind, "_fields", getattr(kind, "__match_args__", ())))
    described = documented_fields(kind)
    assert [each for each in fields if not described.get(each)] == []
    text = inspect.getdoc(kind) or ""
    assert all(f"\n{each}\n    {described[each]}" in text for each in fields)


def test_the_version_is_that_of_the_installed_package():
    assert tssgeom.__version__ == tssgeom_version()
    assert tssgeom.__version__ == version("tssgeom")


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'analyze'"):
        tssgeom.analyze  # noqa: B018
