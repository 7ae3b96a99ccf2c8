"""One route sensed several times: route and errors are estimated together."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from pipelines.cli import app
from tests.route.test_resolution import ARCS, sensed
from tssgeom import Frame, analyse_same
from tssgeom.errors import ShapeError
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.repeated import common_route
from tssgeom.route.synthetic import chain, colon, half_circle


def lines(course, length, size, count, seed=0):
    """Lines of a course, every second one from the distal end and in coordinates of its own [m]."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        points = sensed(course, length, size, 100 * seed + k)
        yield Rotation.random(random_state=rng).apply(points)[::-1] + 0.3 if k % 2 else points


@pytest.mark.parametrize("count", [2, 4])
def test_lines_of_a_route_hold_its_angle_where_one_is_far_off(count):
    held, off, alone = 0, [], []
    for seed in range(8):
        course = (ARCS, colon())[seed % 2]
        fits = [measure(clean(points)) for points in lines(course, 0.02, 1e-3, count, seed)]
        common = common_route(fits)
        error = common.fit.arcs.total_angle - course.total_angle
        held += error**2 < 1.96**2 * common.shared.angle
        off.append(abs(error) / course.total_angle)
        alone.append(abs(fits[0].arcs.total_angle - course.total_angle) / course.total_angle)
    assert held >= 7
    assert np.median(off) < 0.2 * np.median(alone)


@pytest.mark.parametrize("length", [0.03, 0.06])
def test_the_errors_of_a_line_are_reported(length):
    fits = [measure(clean(points)) for points in lines(ARCS, length, 2e-3, 5)]
    common = common_route(fits)
    assert common.error == pytest.approx(2e-3 * ARCS.total_length, rel=0.4)
    assert common.error_length == pytest.approx(length * ARCS.total_length, rel=0.4)


def test_the_tendon_is_pulled_on_the_common_route():
    frames = [Frame(points, tension_in=10.0) for points in lines(half_circle(), 0.02, 1e-3, 3)]
    result, common = analyse_same(frames)
    assert result.arcs.total_angle == pytest.approx(np.pi, rel=0.06)
    assert result.profile.total_angle == pytest.approx(result.arcs.total_angle)
    assert result.arcs.total_angle_se**2 == pytest.approx(common.shared.angle, rel=1e-6)
    expected = 10.0 * np.exp(-0.145 * result.arcs.total_angle)
    assert result.transmission.tension_out == pytest.approx(expected)
    assert abs(result.transmission.tension_out - 10.0 * np.exp(-0.145 * np.pi)) < (
        1.96 * result.transmission.tension_out_se
    )


def test_lines_of_other_routes_are_refused():
    first = measure(clean(sensed(ARCS, 0.02, 0.0, 0)))
    longer = measure(clean(1.2 * sensed(ARCS, 0.02, 0.0, 1)))
    other = chain(np.array([0.1, 0.3, 0.1]), np.array([20.0, 0.0, 20.0]), np.array([0.0, 0.0, np.pi]))
    with pytest.raises(ShapeError, match="two or more"):
        common_route([first])
    with pytest.raises(ShapeError, match=r"line 2 is 599.9 mm long, the first 500 mm"):
        common_route([first, longer])
    with pytest.raises(ShapeError, match="line 2 bends otherwise"):
        common_route([first, measure(clean(sensed(other, 0.02, 0.0, 2)))])


def test_the_command_adds_the_common_route(tmp_path):
    for k, points in enumerate(lines(ARCS, 0.02, 1e-3, 3)):
        np.savetxt(tmp_path / f"{k}.csv", 1e3 * points, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    done = CliRunner().invoke(
        app, ["analyse", str(tmp_path), "--same", "--json", "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    *single, common = json.loads((tmp_path / "out" / "result.json").read_text())
    assert common["shape"] == "same_route"
    assert common["lines"] == [one["shape"] for one in single] == ["0", "1", "2"]
    assert common["total_angle_se_rad"] < abs(single[0]["total_angle_rad"] - ARCS.total_angle)
    assert abs(common["total_angle_rad"] - ARCS.total_angle) < 1.96 * common["total_angle_se_rad"]
    assert 1e-4 < common["error_m"] < 1e-3
    assert (tmp_path / "out" / "same_route.rrd").exists()


def test_the_command_goes_on_where_the_shapes_are_no_one_route(tmp_path):
    for k, points in enumerate((sensed(ARCS, 0.02, 0.0, 0), 1.5 * sensed(ARCS, 0.02, 0.0, 1))):
        np.savetxt(tmp_path / f"{k}.csv", 1e3 * points, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    done = CliRunner().invoke(app, ["analyse", str(tmp_path), "--same"])
    assert done.exit_code == 1
    assert "line 2 is 749.9 mm long, the first 500 mm" in done.output
    assert "500.0" in done.output
