import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tssgeom.view.colours import PIECES, piece_rgb, tension_rgb, tension_rgba32


def luminance(rgb: np.ndarray) -> np.ndarray:
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def test_more_tension_is_never_darker() -> None:
    assert (np.diff(luminance(tension_rgb(np.linspace(0, 15, 200), 15.0))) >= -1e-9).all()


def test_zero_tension_is_visible_on_the_dark_background() -> None:
    assert luminance(tension_rgb(np.zeros(1), 15.0))[0] > 0.03


@given(st.floats(0, 100), st.floats(0.1, 100))
def test_packed_colour_is_the_same_colour_and_opaque(tension: float, top: float) -> None:
    packed = int(tension_rgba32(np.array([tension]), top)[0])
    expected = np.rint(255 * tension_rgb(np.array([tension]), top)[0]).astype(int)
    assert [packed >> 24, packed >> 16 & 255, packed >> 8 & 255, packed & 255] == [*expected, 255]


def test_tension_beyond_the_top_keeps_the_brightest_colour() -> None:
    np.testing.assert_array_equal(*tension_rgb(np.array([10.0, 99.0]), 10.0))


def test_neighbouring_pieces_differ_in_colour() -> None:
    assert all(piece_rgb(number) != piece_rgb(number + 1) for number in range(2 * len(PIECES)))
