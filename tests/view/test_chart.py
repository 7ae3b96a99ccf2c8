import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tssgeom.view.scene.charts import Axis, Box, Chart

CHART = Chart(Axis(500.0, "mm"), Axis(15.0, "N"), Box(width=2.0, text=0.1))


@given(st.floats(1e-6, 1e6))
def test_an_axis_has_three_to_eight_numbers_from_zero_to_at_most_its_top(top: float) -> None:
    ticks = Axis(top, "").ticks
    assert 3 <= len(ticks) <= 8
    assert ticks[0] == 0
    assert ticks[-1] <= top * (1 + 1e-9)


@given(st.floats(1e-3, 1e3), st.floats(1e-6, 1.0))
def test_an_axis_with_negative_values_has_numbers_on_both_sides_of_zero(top: float, share: float) -> None:
    axis = Axis(top, "", -share * top)
    assert 3 <= len(axis.ticks) <= 8
    assert 0.0 in axis.ticks
    assert axis.bottom * (1 + 1e-6) <= axis.ticks[0]
    assert axis.ticks[-1] <= top * (1 + 1e-9)


def test_numbers_carry_their_unit() -> None:
    assert CHART.y.labels == ["0 N", "5 N", "10 N", "15 N"]


def test_origin_is_the_lower_left_corner_as_rerun_counts_downwards() -> None:
    np.testing.assert_allclose(
        CHART.position(np.array([0.0, 500.0]), np.array([0.0, 15.0])), [[0, 1], [2, 0]]
    )


def test_values_beyond_the_axes_are_held_at_the_edge() -> None:
    np.testing.assert_allclose(CHART.position(600.0, -1.0), [[2.0, 1.0]])


def test_grid_and_numbers_lie_inside_what_the_view_shows() -> None:
    positions, texts = CHART.numbers()
    everything = np.vstack([positions, *CHART.grid()])
    assert len(positions) == len(texts)
    for axis, (low, high) in enumerate([CHART.box.x_range, CHART.box.y_range]):
        assert (everything[:, axis] > low).all()
        assert (everything[:, axis] < high).all()
