"""Two recordings side by side: one scale, one time, and a difference that is that of the results."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.view.conftest import analysed, arc
from tests.view.recorded import columns, entities, verify, views
from tssgeom.engine import process
from tssgeom.errors import SourceError
from tssgeom.rig import Friction, Rig
from tssgeom.stream import Frame, FrameResult
from tssgeom.view.colours import tension_rgba32
from tssgeom.view.samples import route_samples
from tssgeom.view.scene.compare.comparison import write_comparison
from tssgeom.view.scene.compare.difference import aligned, comparison, difference, parting, table
from tssgeom.view.scene.compare.reading import Side, read_side
from tssgeom.view.scene.paper import write_paper_recording
from tssgeom.view.scene.recording import write_recording
from tssgeom.view.scene.viewer import moment_of_greatest_tension
from tssgeom.view.wording import angle_with_error, with_error

ROUGH = Rig(friction=Friction(coefficient=0.3))


def rougher(results: list[FrameResult], later: float = 0.0) -> list[FrameResult]:
    """The same frames with more friction, and at later times [s]."""
    frames = [replace(one.frame, time=one.frame.time + later) for one in results]
    results = process(frames, ROUGH, tension_in=15.0)
    return [one for one in results if isinstance(one, FrameResult)]


@pytest.fixture(scope="module")
def rough(moving: list[FrameResult]) -> list[FrameResult]:
    return rougher(moving)


@pytest.fixture(scope="module")
def rough_file(rough: list[FrameResult], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rough") / "rough.rrd"
    write_recording(path, "rough", rough, timed=True)
    return path


@pytest.fixture(scope="module")
def both(moving_file: Path, rough_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("both") / "both.rrd"
    write_comparison(path, moving_file, rough_file)
    return path


def test_a_recording_is_read_back_as_the_results_in_it(moving_file: Path, moving: list[FrameResult]):
    side = read_side(moving_file)
    assert side.time is not None
    np.testing.assert_allclose(side.time, [one.frame.time for one in moving], atol=1e-9)
    for samples, pieces, result in zip(side.frames, side.pieces, moving, strict=True):
        expected = route_samples(result)
        for name in ("s", "position", "tension", "phi", "kappa", "kappa_se", "phi_se"):
            # single precision
            np.testing.assert_allclose(getattr(samples, name), getattr(expected, name), rtol=1e-6, atol=1e-7)
        np.testing.assert_array_equal(pieces.angle, result.arcs.angle)
    outs = [one.transmission.tension_out for one in moving]
    np.testing.assert_array_equal(side.numbers["tension_out_N"], outs)


def test_each_side_has_the_same_parts_and_the_views_are_in_pairs(both: Path):
    names = entities(both)
    sides = [{name[2:] for name in names if name.startswith(f"/{side}/")} for side in "ab"]
    assert sides[0] == sides[1]
    assert {"/route", "/labels", "/joints", "/sensed", "/tension/curve", "/curvature/pieces"} <= sides[0]
    assert {"/series/tension_in", "/series/tension_out", "/series/elongation"} <= sides[0]
    kinds = views(both)
    assert (kinds.count("3D"), kinds.count("2D")) == (2, 4)
    assert (kinds.count("TimeSeries"), kinds.count("TextDocument")) == (4, 2)
    verify(both)


def test_one_tension_has_one_colour_on_both_sides(both: Path, moving, rough):
    top = 12.0  # the greatest tension of both, itself a plain number
    for side, results in (("a", moving), ("b", rough)):
        rows = columns(both, f"/{side}/route", timed=True)["LineStrips3D:colors"]
        for shades, result in zip(rows, results, strict=True):
            tension = route_samples(result).tension.astype(np.float32).astype(float)
            expected = tension_rgba32(0.5 * (tension[:-1] + tension[1:]), top)
            np.testing.assert_array_equal(shades, expected)


def test_the_difference_is_that_of_the_results_at_every_moment(both: Path, moving, rough):
    for entity, field, factor in (("tension_out", "tension_out", 1.0), ("elongation", "elongation", 1e3)):
        rows = columns(both, f"/difference/{entity}", timed=True)
        expected = [
            factor * (getattr(b.transmission, field) - getattr(a.transmission, field))
            for a, b in zip(moving, rough, strict=True)
        ]
        np.testing.assert_allclose(np.ravel(rows["Scalars:scalars"]), expected, rtol=1e-12)


def test_the_text_has_the_numbers_of_the_greatest_pull(both: Path, moving, rough):
    a, b = moving[3].transmission, rough[3].transmission
    (text,) = columns(both, "/difference/words", timed=False)["TextDocument:text"][0]
    error = float(np.hypot(a.tension_out_se, b.tension_out_se))
    assert f"**{with_error(b.tension_out - a.tension_out, error, 2, '+')} N**".replace("-", "−") in text
    assert f"({a.tension_out:.2f} to {b.tension_out:.2f} N" in text
    assert "the drives are the same" in text
    assert "turn alike" in text
    (cells,) = columns(both, "/difference/table", timed=False)["TextDocument:text"][0]
    assert f"| T_out [N] | {a.tension_out:.2f} | {b.tension_out:.2f} |" in cells


def test_recordings_of_other_times_both_begin_at_zero(moving_file: Path, moving, tmp_path: Path):
    late = tmp_path / "late.rrd"
    write_recording(late, "late", rougher(moving, later=1.7e9), timed=True)
    a, b = aligned(read_side(moving_file), read_side(late))
    assert a.time is not None
    assert b.time is not None
    assert b.since == pytest.approx(1.7e9)
    np.testing.assert_allclose(a.time, b.time, atol=1e-6)  # seconds since 1970 in double precision
    write_comparison(tmp_path / "both.rrd", moving_file, late)
    for entity in ("/b/route", "/b/sensed", "/b/labels", "/b/series/tension_out"):
        times = columns(tmp_path / "both.rrd", entity, timed=True)["time"]
        assert {round(row.total_seconds(), 6) for row in times} == set(a.time)
    assert "time from its beginning" in comparison(a, b, difference(a, b))


def test_recordings_of_one_name_get_names_with_their_folders(moving_file: Path, tmp_path: Path):
    other = tmp_path / "elsewhere" / moving_file.name
    other.parent.mkdir()
    other.write_bytes(moving_file.read_bytes())
    write_comparison(tmp_path / "both.rrd", moving_file, other)
    (text,) = columns(tmp_path / "both.rrd", "/difference/words", timed=False)["TextDocument:text"][0]
    assert "moving of elsewhere" in text
    write_comparison(tmp_path / "both.rrd", moving_file, moving_file)  # even with itself
    (text,) = columns(tmp_path / "both.rrd", "/difference/words", timed=False)["TextDocument:text"][0]
    assert "**A** is moving (7 frames), **B** is moving (7 frames)" in text


def test_two_shapes_have_no_time_and_one_chart_for_both(still_file: Path, tmp_path: Path):
    write_recording(tmp_path / "bent.rrd", "bent", analysed([Frame(arc(60, 2.5))]), timed=False)
    write_comparison(tmp_path / "both.rrd", still_file, tmp_path / "bent.rrd")
    assert {"/difference/tension/a", "/difference/tension/b"} <= entities(tmp_path / "both.rrd")
    assert "TimeSeries" not in views(tmp_path / "both.rrd")
    a, b = read_side(still_file), read_side(tmp_path / "bent.rrd")
    assert difference(a, b) is None
    less = a.numbers["total_angle_rad"][0] - b.numbers["total_angle_rad"][0]
    error = np.hypot(a.numbers["total_angle_se_rad"][0], b.numbers["total_angle_se_rad"][0])
    assert f"turns **{angle_with_error(less, error)} less**" in comparison(a, b, None)
    assert table(a, b).count("\n") == 7


def test_a_shape_stands_beside_a_run(still_file: Path, moving_file: Path, tmp_path: Path):
    write_comparison(tmp_path / "both.rrd", still_file, moving_file)
    assert "/b/series/tension_out" in entities(tmp_path / "both.rrd")
    assert columns(tmp_path / "both.rrd", "/a/route", timed=True) == {}


def test_the_numbers_are_those_of_the_moment_in_the_picture(tmp_path: Path):
    pulls = (2.0, 12.0, 4.0, 11.999, 1.0)  # the picture shows the last of peaks that are the same within 1 %
    frames = [Frame(arc(40, 1.0 + 0.4 * k), 0.5 * k, tension_in=pull) for k, pull in enumerate(pulls)]
    results = analysed(frames)
    write_recording(tmp_path / "a.rrd", "a", results, timed=True)
    side = read_side(tmp_path / "a.rrd")
    assert side.time is not None
    assert ("time", side.time[side.peak]) == moment_of_greatest_tension(tmp_path / "a.rrd")
    assert "| time [s] | 1.50 | 1.50 | 0.00 |" in table(side, side)
    assert "-0.0" not in table(side, side)


def test_frames_that_a_long_recording_omits_are_counted(moving: list[FrameResult], tmp_path: Path):
    write_recording(tmp_path / "a.rrd", "a", moving[::2], timed=True)
    side = read_side(tmp_path / "a.rrd")
    assert "**A** is a (4 of its 7 frames)" in comparison(side, side, None)


def test_the_difference_of_two_shapes_has_its_sign(still_file: Path, tmp_path: Path):
    write_recording(tmp_path / "bent.rrd", "bent", analysed([Frame(arc(60, 2.0, 0.25))]), timed=False)
    heights = []
    for name, pair in (
        ("less", (tmp_path / "bent.rrd", still_file)),
        ("more", (still_file, tmp_path / "bent.rrd")),
    ):
        write_comparison(tmp_path / f"{name}.rrd", *pair)
        ((line,),) = columns(tmp_path / f"{name}.rrd", "/difference/tension/apart", timed=False)[
            "LineStrips2D:strips"
        ]
        heights.append(line[-1][1] - line[0][1])  # downwards, from 0 N at the proximal end
    assert heights[0] > 0.01  # B turns more: less tension than A
    assert heights[1] < -0.01


def test_tensions_differ_from_where_the_routes_differ(moving_file: Path):
    side = read_side(moving_file)
    assert parting(side, side) is None
    bent = side.frames[side.peak]
    changed = replace(bent, tension=np.where(bent.s > 0.1, 0.9, 1.0) * bent.tension)
    other: Side = replace(side, frames=[*side.frames[: side.peak], changed, *side.frames[side.peak + 1 :]])
    s = parting(side, other)
    assert s == pytest.approx(0.1, abs=0.005)  # the step of arc length


def test_a_recording_of_something_else_is_refused_with_what_can_be_compared(still_file: Path, tmp_path: Path):
    write_paper_recording(tmp_path / "paper.rrd")
    with pytest.raises(
        SourceError, match=r"paper\.rrd: no numbers of a route to compare: give recordings of"
    ):
        write_comparison(tmp_path / "both.rrd", still_file, tmp_path / "paper.rrd")
