"""Coordinates that are read straight from their text are those that the JSON library reads."""

import json
from fractions import Fraction

import numpy as np
import pytest

from tssgeom.io.formats.jsonl import plain_points


def _read(text: str) -> np.ndarray:
    return plain_points(text.encode())


def _written(rng: np.random.Generator, value: float) -> str:
    """Write a number in one of the ways in which senders do."""
    way = rng.integers(5)
    if way == 0:
        return f"{value:.4f}"
    if way == 1:
        return f"{value:.12e}"
    return repr(int(value)) if way == 2 else repr(value)


def test_numbers_are_rounded_as_by_the_json_library():
    rng = np.random.default_rng(0)
    read = 0
    for _ in range(3000):
        size = 10.0 ** rng.integers(-5, 5)
        numbers = [_written(rng, float(size * rng.standard_normal())) for _ in range(3)]
        text = f"[[{','.join(numbers)}]]"
        outcome = _read(text)
        read += len(outcome)
        if len(outcome):
            np.testing.assert_array_equal(outcome, json.loads(text))
    assert read > 2900  # the others have more than 22 digits, or stand too close to a tie


def test_a_number_halfway_between_two_is_left_to_the_json_library():
    numerator = 2**54 + 2  # halfway between its neighbours 2^54 and 2^54 + 4
    assert Fraction(numerator) - Fraction(float(2**54)) == 2
    assert len(_read(f"[[{numerator}.0,0,0]]")) == 0
    np.testing.assert_array_equal(_read(f"[[{numerator + 1}.0,0,0]]"), [[float(numerator + 1), 0, 0]])


def test_a_missing_point_is_a_row_of_nan():
    expected = [[1.0, 2.0, 3.0], [np.nan] * 3, [-400.0, 0.5, 6e-3]]
    np.testing.assert_array_equal(_read(" [[1,2 ,3],\tnull, [-4E2,0.5,6e-3]]\r\n"), expected)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[",
        "null",
        "[]",
        "[[1,2]]",
        "[[1,2,3,4]]",
        "[[1,2,3],]",
        "[[1,2,3]",
        "[[1,2,3]] 4",
        "[[1,2,null]]",
        "[[NaN,2,3]]",
        "[[01,2,3]]",
        "[[1.,2,3]]",
        "[[.5,2,3]]",
        "[[+1,2,3]]",
        "[[-,2,3]]",
        "[[1e,2,3]]",
        "[[1e999,2,3]]",
        "[[1e-30,2,3]]",
        "[[9000000000000000000,2,3]]",
        "[[99999999999999999999,2,3]]",
        "[[1,2,3]nul",
        "[nul]",
        '[["1",2,3]]',
    ],
)
def test_what_is_no_plain_row_is_left_to_the_json_library(text):
    assert len(_read(text)) == 0
