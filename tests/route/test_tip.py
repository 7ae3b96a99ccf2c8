"""Base and tip alone, with the length between them: the mean of all routes that fit both."""

import numpy as np
import pytest

from tests.route.test_real_data import DATA
from tssgeom import Frame, FrameResult, Rig, analyse, process
from tssgeom.errors import ShapeError
from tssgeom.rig import ShapeSensor
from tssgeom.route.synthetic import Course, chain, frames

LENGTH = 0.2


def sensed(course: Course, noise: float, seed: int, *, tip_direction: bool = False) -> Frame:
    joints, axes = frames(course)
    rng, directions = np.random.default_rng(seed), np.full((2, 3), np.nan)
    directions[0] = axes[0][0]
    if tip_direction:
        directions[1] = axes[-1][0]
    points = joints[[0, -1]] + noise * np.array([[0.0], [1.0]]) * rng.standard_normal((2, 3))
    return Frame(points, directions=directions, length=course.total_length)


def pieces(seed: int, count: int) -> Course:
    rng = np.random.default_rng(seed)
    length = LENGTH * rng.dirichlet(np.full(count, 4.0))
    return chain(length, rng.uniform(0.0, 12.0, count), rng.uniform(0.0, 2.0 * np.pi, count))


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("tip_direction", [False, True])
def test_intervals_hold_the_angle(count, tip_direction):
    rig, held = Rig(shape=ShapeSensor(noise_mm=0.5, direction_noise_deg=0.6)), 0
    for seed in range(20):
        course = pieces(seed, count)
        arcs = analyse(sensed(course, 5e-4, seed, tip_direction=tip_direction), rig).arcs
        held += abs(arcs.total_angle - course.total_angle) < 1.96 * arcs.total_angle_se
        assert arcs.total_length == pytest.approx(LENGTH, rel=0.01)
    assert held >= 15


def test_the_fitted_route_goes_from_the_base_to_the_tip():
    course = pieces(4, 2)
    frame = sensed(course, 0.0, 0, tip_direction=True)
    result = analyse(frame)
    assert frame.directions is not None
    np.testing.assert_allclose(result.route.position[[0, -1]], frame.points, atol=3e-4)
    np.testing.assert_allclose(result.route.tangent[[0, -1]], frame.directions, atol=0.03)
    assert result.profile.total_angle == pytest.approx(result.arcs.total_angle)
    assert result.profile.total_angle_se == pytest.approx(result.arcs.total_angle_se, rel=0.01)
    assert result.arcs.method == "tip"
    assert "not sensed" in result.warnings[0]


def test_a_stream_of_tips_moves_the_tendon():
    turns = np.linspace(1.0, 2.0, 6)
    courses = [chain(np.array([LENGTH]), np.array([turn / LENGTH]), np.zeros(1)) for turn in turns]
    stream = [sensed(course, 0.0, 0) for course in courses]
    results = [one for one in process(stream, Rig(), tension_in=5.0) if isinstance(one, FrameResult)]
    assert len(results) == len(stream)
    assert np.all(np.diff([one.arcs.total_angle for one in results]) > 0.0)


def test_a_tip_beyond_the_length_is_refused_or_named():
    frame = sensed(pieces(0, 1), 0.0, 0)
    far = Frame(1.5 * frame.points, directions=frame.directions, length=LENGTH)
    with pytest.raises(ShapeError, match=r"the tip lies .* mm from the base, the route is 200 mm long"):
        analyse(far)
    straight = Frame(np.array([[0.0, 0, 0], [0, 0, 0.201]]), directions=frame.directions, length=LENGTH)
    straight = Frame(straight.points, directions=np.array([[0, 0, 1.0], [np.nan] * 3]), length=LENGTH)
    assert any("1 mm farther from the base" in text for text in analyse(straight).warnings)


@pytest.mark.parametrize("lacking", ["length", "directions", "base"])
def test_two_points_need_the_length_and_the_direction_of_the_base(lacking):
    frame = sensed(pieces(0, 1), 0.0, 0)
    directions = None if lacking == "directions" else frame.directions
    if lacking == "base":
        directions = np.full((2, 3), np.nan)
    length = None if lacking == "length" else LENGTH
    with pytest.raises(ShapeError, match="or base and tip, with the direction of the base and the length"):
        analyse(Frame(frame.points, directions=directions, length=length))


@pytest.mark.skipif(not DATA.is_dir(), reason="needs the measured tips")
@pytest.mark.parametrize(("name", "length", "flagged"), [("tdcr_", 0.1945, 0.0), ("tdcrv6", 0.230, 0.72)])
def test_measured_tips_beyond_the_stated_length_are_flagged(name, length, flagged):
    (file,) = (DATA / "real" / "tdcr_tendon_tip").glob(f"{name}*keypoints.csv")
    columns = file.read_text().partition("\n")[0].split(",")
    tips = np.genfromtxt(
        file, delimiter=",", skip_header=1, usecols=[columns.index(f"tip_{x}") for x in "xyz"]
    )
    directions, count = np.array([[0.0, 0, 1], [np.nan] * 3]), 0
    for tip in 1e-3 * tips[::25]:
        try:
            one = analyse(Frame(np.array([np.zeros(3), tip]), directions=directions, length=length))
            count += any("farther from the base" in text for text in one.warnings)
        except ShapeError:
            count += 1
    assert count / len(tips[::25]) == pytest.approx(flagged, abs=0.1)
