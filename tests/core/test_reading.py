"""Points straight from their text: the compiled entry against its twin, character by character."""

import numpy as np

from tests.core.twins.reading_points import points_of
from tssgeom import core

WAYS = ("{:.4f}", "{:.12e}", "{!r}", "{:.0f}", "{:g}", "{:.17g}", "{:.22f}", "{:.3E}")


def agree(text: bytes) -> int:
    """Assert that both read the same points; return how many."""
    characters = np.frombuffer(text, np.uint8)
    points = np.empty((len(text) // 5 + 1, 3))
    count = core.read_points(characters, points)
    np.testing.assert_array_equal(points[:count], points_of(characters))
    return count


def lines(rng: np.random.Generator, count: int) -> list[bytes]:
    """Rows of numbers written in many ways, and nulls."""
    made = []
    for _ in range(count):
        size = 10.0 ** rng.integers(-9, 12)
        rows = [
            "null"
            if rng.random() < 0.1
            else "["
            + ", ".join(str(rng.choice(WAYS)).format(float(x)) for x in size * rng.standard_normal(3))
            + "]"
            for _ in range(rng.integers(0, 4))
        ]
        made.append(f"[{','.join(rows)}]".encode())
    return made


def test_every_number_is_that_of_the_twin_to_the_last_digit():
    counts = [agree(line) for line in lines(np.random.default_rng(0), 3000)]
    assert sum(count > 0 for count in counts) > 1000


def test_a_damaged_line_is_refused_where_the_twin_refuses_it():
    rng = np.random.default_rng(1)
    characters = np.frombuffer(b'[],.-+eE0159nul \t\n{"\x00\xff', np.uint8)
    for line in lines(rng, 1500):
        damaged = np.frombuffer(line, np.uint8).copy()
        damaged[rng.integers(len(damaged), size=rng.integers(1, 3))] = rng.choice(characters)
        agree(damaged[: rng.integers(len(damaged) + 1)].tobytes())
        agree(damaged.tobytes())


def test_no_more_points_are_written_than_there_is_memory_for():
    points = np.full((3, 3), 7.0)
    assert core.read_points(np.frombuffer(b"[[1,2,3],[4,5,6],[7,8,9]]", np.uint8), points[:2]) == 0
    assert (points[2] == 7.0).all()
    assert core.read_points(np.zeros(0, np.uint8), np.empty((0, 3))) == 0
