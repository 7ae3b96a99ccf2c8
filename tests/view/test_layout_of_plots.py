"""Where the axes of plots over time begin and end in a recording."""

import pytest

from tssgeom.view.quantities import COUNT
from tssgeom.view.scene.blueprint import beside_legend, from_zero


@pytest.mark.parametrize(("top", "end"), [(7.9, 10.0), (4.0, 4.0), (15.0, 15.0), (0.06, 0.1), (100.0, 100.0)])
def test_an_axis_ends_at_a_power_of_ten_that_at_most_doubles_it(top: float, end: float) -> None:
    axis = from_zero(top)
    assert axis is not None
    assert axis.range is not None
    ((low, high),) = axis.range.as_arrow_array().to_pylist()
    assert (low, high) == pytest.approx((-0.05 * end, 1.05 * end))
    assert from_zero(None) is None


@pytest.mark.parametrize(("timeline", "unit"), [("time", 1e9), (COUNT, 1.0)])
def test_a_legend_has_room_before_the_first_sample(timeline: str, unit: float) -> None:
    axis = beside_legend((2.0, 102.0), timeline)
    assert axis is not None
    assert axis.view_range is not None
    (span,) = axis.view_range.as_arrow_array().to_pylist()
    assert span["end"] == 102.0 * unit
    assert span["start"] == pytest.approx(-24.0 * unit)
    assert beside_legend((3.0, 3.0)) is None
    assert beside_legend(None) is None
