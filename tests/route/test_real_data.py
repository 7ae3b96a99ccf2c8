"""Routes that others measured, where their files lie beside the project."""

import base64
import json
import zlib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
needs_aorta = pytest.mark.skipif(not (DATA / "vmtk_aorta").is_dir(), reason="needs the VMTK aorta lines")
needs_needle = pytest.mark.skipif(not (DATA / "fbg_needle").is_dir(), reason="needs the FBG needle shape")
needs_fibre = pytest.mark.skipif(not (DATA / "real" / "fibre_mocap").is_dir(), reason="needs the fibre")
_TYPES = {"Float32": "<f4", "Float64": "<f8", "Int32": "<i4", "Int64": "<i8"}


def _array(element) -> np.ndarray:
    """One zlib-compressed base64 array: counts, then blocks."""
    text = "".join(element.text.split())
    blocks = int(np.frombuffer(base64.b64decode(text[:16])[:4], "<u4")[0])
    head = -(-4 * (3 + blocks) // 3) * 4
    sizes = np.frombuffer(base64.b64decode(text[:head])[12 : 12 + 4 * blocks], "<u4")
    body, start, out = base64.b64decode(text[head:]), 0, b""
    for size in map(int, sizes):
        out += zlib.decompress(body[start : start + size])
        start += size
    return np.frombuffer(out, _TYPES[element.get("type")])


def _lines(name: str) -> list[np.ndarray]:
    """Lines of a VTK poly data file, millimetres to metres."""
    root = ElementTree.parse(DATA / "vmtk_aorta" / name).getroot()
    points = _array(root.find(".//Points/DataArray")).reshape(-1, 3).astype(float)
    cells = {e.get("Name"): _array(e) for e in root.findall(".//Lines/DataArray")}
    ends = [end for end in cells["offsets"] if end > 0]
    starts = [0, *ends[:-1]]
    return [1e-3 * points[cells["connectivity"][a:b]] for a, b in zip(starts, ends, strict=True)]


def _turning(points: np.ndarray) -> float:
    steps = np.diff(points, axis=0)
    steps = steps[np.any(steps != 0, axis=1)]
    steps /= np.linalg.norm(steps, axis=1)[:, None]
    return float(np.degrees(np.arccos(np.clip(np.sum(steps[1:] * steps[:-1], axis=1), -1, 1)).sum()))


@needs_aorta
@pytest.mark.parametrize("line", [0, 1])
def test_raw_aorta_comes_out_in_the_range_of_its_smoothed_versions(geometry, line):
    points = _lines("aorta-centerline.vtp")[line]
    assert _turning(points) > 1000  # what a plain sum gives, in degrees
    spline, profile, _ = geometry(points)
    route = spline.route
    phi, se = np.degrees([profile.total_angle, profile.total_angle_se])
    assert 91 <= phi <= 163
    assert 15 < se < 60  # nobody can be sure of it: the answer depends on the scale of what counts as error
    assert any("share their errors" in warning for warning in spline.warnings)
    assert len(route.residual) == len(route.weight) == len(route.station)


@needs_aorta
@pytest.mark.parametrize("line", [0, 1])
def test_smoothed_aorta_is_taken_at_its_word(geometry, line):
    points = _lines("test_vmtkcenterlinesmoothing_test_default_params.vtp")[line]
    _, profile, _ = geometry(points)
    assert np.degrees(profile.total_angle) == pytest.approx(_turning(points), rel=0.03)


@needs_needle
@pytest.mark.parametrize("noise", [0.0, 1e-4, 5e-4])
def test_needle_angle_is_the_integral_of_its_own_curvature(geometry, noise):
    shape = json.loads((DATA / "fbg_needle" / "shape_stuff.json").read_text())["shape"]
    points = 1e-3 * np.array(shape["pos"]).T
    bend = np.hypot(*np.array(shape["wv"])[:2])  # 1/mm every half millimetre
    truth = np.trapezoid(bend, dx=0.5)
    _, profile, _ = geometry(points + noise * np.random.default_rng(0).standard_normal(points.shape))
    if noise == 0.0:
        assert profile.total_angle == pytest.approx(truth, rel=3e-4)  # the spline is natural at its ends
        assert profile.length == pytest.approx(0.12, rel=1e-6)
    else:
        assert abs(profile.total_angle - truth) < 3 * profile.total_angle_se
        assert profile.total_angle == pytest.approx(truth, rel=0.1)


@needs_fibre
def test_markers_on_a_fibre_give_its_length_whatever_its_bend():
    """The fibre keeps its length; the chords between its markers become shorter when it bends."""
    length, angle, chords = [], [], []
    for name in ("1606_3min_first", "1606_3min_second"):
        lines = np.loadtxt(DATA / "real" / "fibre_mocap" / f"{name}_label.txt")
        for points in 1e-3 * lines.reshape(-1, 20, 3):
            chord = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
            if chord > 0.3005:  # all markers were observed
                fit = measure(clean(points))
                length.append(fit.arcs.total_length)
                angle.append(fit.arcs.total_angle)
                chords.append(chord)
                assert not any("polygon" in text or "apart" in text for text in fit.warnings)
    off = np.array(length) - 0.3028
    assert np.mean(np.abs(off) < 3e-4) > 0.9
    assert abs(np.polyfit(angle, length, 1)[0]) < 0.3 * abs(np.polyfit(angle, chords, 1)[0])


@needs_fibre
def test_a_lost_marker_lengthens_no_fibre():
    lines = np.loadtxt(DATA / "real" / "fibre_mocap" / "RandomTest_1606_label.txt")
    for row in (20, 30, 35):
        fit = measure(clean(1e-3 * lines[row].reshape(20, 3)))
        assert fit.arcs.total_length == pytest.approx(0.3028, abs=5e-4)
        assert any("outlying" in text for text in fit.warnings)
