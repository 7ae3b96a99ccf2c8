"""Shapes that were measured elsewhere, beside the methods that a user would take instead.

Hard bounds come from the points alone: a curve through them is no shorter than their chords and turns no less
than their polygon.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import combinations

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks import ABSENT, number, share, table
from benchmarks.estimators import PEERS, Estimate, Sighting, chord_lengths, of_curve, scipy_splprep
from benchmarks.run_laws import DATA
from tssgeom.analysis import analyse
from tssgeom.arrays import Points, Vector
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.files import open_recording
from tssgeom.rig import Rig, ShapeSensor, Source
from tssgeom.route.bounds import polygon
from tssgeom.route.marker_offset import follow_markers
from tssgeom.route.observations import clean
from tssgeom.route.route import step_lengths
from tssgeom.statistics import NORMAL_95
from tssgeom.stream import Frame

_FIBRE = DATA / "real" / "fibre_mocap"
_FIBRE_LENGTH = 0.3028  # m; docs of the set: the sum of the chords where the fibre is straight
_FIBRE_NOISE = 2e-5  # m; the worst coordinate of a marker at rest
_FIBRE_BOUND = 0.3005  # m; chords below it belong to a lost or exchanged marker
_FIRST_AT_REST, _SECOND_AT_REST = slice(34, 49), slice(0, 15)  # lines of the two recordings
_TENTACLE = DATA / "real" / "tentacle_mocap"
_TENTACLE_FILES = {  # markers from base to tip, and Φ of the makers' kind of rod on their offsets [degrees]
    "m1_u005": ((3, 1, 2, 4, 0), 32.0),
    "m1_u025": ((4, 3, 0, 2, 1), 254.0),
    "m2_u02": ((3, 2, 4, 1, 0), 186.0),
    "m12_u001002": ((3, 2, 1, 0, 4), 149.0),
}
_TENTACLE_START = (-0.030, -0.013, 0.0)  # m; the centre line begins beside the base, along +y
_TENTACLE_OFFSETS = ((0, 0, 0), (25, 0, 0), (-21, 0, 0), (20, 0, 0), (0, 0, 8))  # mm, first axis along +x
_START_NOISE = math.radians(1.0)  # of the direction in which it is clamped
_ROD_ERROR = 20.0  # degrees
_AORTA = DATA / "vmtk_aorta" / "aorta-centerline.vtp"
_SMOOTHED = DATA / "vmtk_aorta" / "test_vmtkcenterlinesmoothing_test_default_params.vtp"
_GRID = 2000
_WINDOW, _DEGREE = 5, 3  # of the local regression
_QUICK_STEP = 10


@dataclass(frozen=True, slots=True)
class Fitted:
    """What a method makes of one shape."""

    length: float
    """[m]"""
    angle: float
    """Φ [rad]."""
    angle_se: float
    """Its standard error [rad]; NaN where the method gives none."""
    noise: float
    """Standard deviation of a coordinate that the method takes the points to have [m]."""
    warned: bool


Method = Callable[[Points, float], Fitted]


def tssgeom(points: Points, _: float, source: Source | None = None) -> Fitted:
    """Fit a shape as `tssgeom analyse` does; its noise is not stated."""
    result = analyse(points, Rig(shape=ShapeSensor(source=source)))
    arcs, fit = result.arcs, result.fit
    return Fitted(arcs.total_length, arcs.total_angle, arcs.total_angle_se, fit.noise, bool(fit.warnings))


def peer(estimator: Callable[[Sighting], Estimate], points: Points, noise: float) -> Fitted:
    """Fit a shape by another method, given the noise that the set states [m]."""
    result = estimator(Sighting(points, None, None, noise))
    return Fitted(float(result.s[-1] - result.s[0]), result.total_angle, math.nan, noise, warned=False)


def hermite(sighting: Sighting) -> Estimate:
    """Interpolate by a cubic spline over the chords."""
    points = sighting.points
    u = chord_lengths(points)
    spline, at = CubicSpline(u, points), np.linspace(0.0, u[-1], _GRID)
    return of_curve(at, spline(at, 1), spline(at, 2), known=False)


def local_polynomial(sighting: Sighting) -> Estimate:
    """Differentiate by local cubic regression over five points, as packages for Frenet frames do."""
    points = sighting.points
    u = chord_lengths(points)
    first, second = np.empty_like(points), np.empty_like(points)
    for i in range(len(u)):
        low = min(max(i - _WINDOW // 2, 0), max(len(u) - _WINDOW, 0))
        part = slice(low, low + _WINDOW)
        degree = min(_DEGREE, len(u[part]) - 1)
        power = np.vander(u[part] - u[i], degree + 1, increasing=True)
        weights = np.linalg.lstsq(power, points[part], rcond=None)[0]
        first[i], second[i] = weights[1], 2.0 * weights[2]
    return of_curve(u, first, second, known=False)


METHODS: dict[str, Method] = {
    "tssgeom": tssgeom,
    "splprep, noise": partial(peer, scipy_splprep),
    "GCV spline": partial(peer, PEERS["GCV spline"]),
    "csaps": partial(peer, PEERS["csaps"]),
    "Hermite": partial(peer, hermite),
    "local cubic": partial(peer, local_polynomial),
    "VMTK": partial(peer, PEERS["VMTK"]),
    "polygon": partial(peer, PEERS["turning"]),
}


def show_shapes(*, quick: bool, markdown: bool) -> int:
    """Print the tables and return how many fits break a hard bound without a warning."""
    every = _QUICK_STEP if quick else 1
    broken = 0
    for name, folder, show in (
        ("markers on a fibre", _FIBRE, _fibre),
        ("the same points as sensed by the fibre", _FIBRE, _sensed),
        ("markers beside a tentacle", _TENTACLE, _tentacle),
        ("two centre lines of an aorta", _AORTA, _aorta),
    ):
        if not folder.exists():
            print(f"\n{name}: left out, {folder.name} is not beside the project")
            continue
        text, wrong = show(every, markdown=markdown)
        broken += wrong
        print(f"\n{name}\n\n{text}", flush=True)
    if broken:
        print(f"\n{broken} fits break a hard bound without a warning", file=sys.stderr)
    return broken


def fitted(method: Method, points: Points, noise: float) -> Fitted | None:
    """Return what a method makes of a shape, or None where it refuses."""
    try:
        return method(points, noise)
    except (TssgeomError, ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None


def keeps_bounds(points: Points, one: Fitted) -> bool:
    """Whether a fit is as long as the polygon and turns as far, or states that it does not."""
    bound = polygon(points, np.ones(len(points)))
    return one.warned or bound.broken(one.length, one.angle, one.noise) is None


@cache
def _lines(name: str) -> Points:
    return 1e-3 * np.loadtxt(_FIBRE / name).reshape(-1, 20, 3)


def _markers(name: str) -> Points:
    return _lines(f"{name}_label.txt")


def _points_sensed(name: str) -> Points:
    return np.cumsum(_lines(f"{name}_output.txt"), axis=1)


_TIMED = ("1606_3min_first", "1606_3min_second")


def _fibre(every: int, *, markdown: bool) -> tuple[str, int]:
    shapes = np.concatenate([_markers(name) for name in (*_TIMED, "RandomTest_1606")])[::every]
    whole = np.array([step_lengths(points).sum() > _FIBRE_BOUND for points in shapes])
    rest = (_markers(_TIMED[0])[_FIRST_AT_REST], _markers(_TIMED[1])[_SECOND_AT_REST])
    rows, wrong = [], 0
    for name, method in METHODS.items():
        fits = [fitted(method, points, _FIBRE_NOISE) for points in shapes]
        kept = [one is None or keeps_bounds(points, one) for one, points in zip(fits, shapes, strict=True)]
        wrong += kept.count(False) if name == "tssgeom" else 0
        sound = [one for one, good in zip(fits, whole, strict=True) if one is not None and good]
        off = 1e3 * (np.array([one.length for one in sound]) - _FIBRE_LENGTH)
        trend = np.polyfit([one.angle for one in sound], off, 1)[0]
        near = float(np.mean(np.abs(off) <= 0.3))
        still = [[one for points in part if (one := fitted(method, points, _FIBRE_NOISE))] for part in rest]
        spread = [number(math.degrees(np.std([one.angle for one in part])), 2) for part in still]
        mean_se = [number(math.degrees(np.mean([one.angle_se for one in part])), 2) for part in still]
        row = [name, share(float(np.mean(kept))), number(_rms(off)), share(near), number(trend)]
        rows.append([*row, " ".join(spread), " ".join(mean_se)])
    header = ["method", "bounds %", "rms L [mm]", "within 0.3 %", "dL/dΦ [mm/rad]", "sd Φ at rest [°]"]
    lines = table([*header, "s.e. [°]"], rows, text_columns=1, markdown=markdown)
    return (
        f"{lines}\n\nL is {1e3 * _FIBRE_LENGTH:.1f} mm in every shape; {whole.sum()} sound of {len(shapes)}.",
        wrong,
    )


def _sensed(every: int, *, markdown: bool) -> tuple[str, int]:
    rows, wrong = [], 0
    for name, method in METHODS.items():
        row = [name]
        for recording in (*_TIMED, "RandomTest_1606"):
            pairs = list(zip(_markers(recording), _points_sensed(recording), strict=True))[::every]
            errors, inside, kept = [], [], []
            for markers, sensed in pairs:
                rebuilt = partial(tssgeom, source="fbg") if name == "tssgeom" else method
                true, one = fitted(method, markers, _FIBRE_NOISE), fitted(rebuilt, sensed, 1e-4)
                if true is None or one is None or true.warned:
                    continue
                errors.append(math.degrees(one.angle - true.angle))
                se = math.hypot(one.angle_se, true.angle_se)
                inside.append(abs(one.angle - true.angle) <= NORMAL_95 * se)
                kept.append(keeps_bounds(sensed, one))
            wrong += kept.count(False) if name == "tssgeom" else 0
            row += [
                number(_rms(np.array(errors))),
                share(float(np.mean(inside))) if name == "tssgeom" else ABSENT,
            ]
        rows.append(row)
    header = ["method"]
    for recording in ("first", "second", "random"):
        header += [f"{recording}: rms Φ [°]", "inside %"]
    return table(header, rows, text_columns=1, markdown=markdown), wrong


def _tentacle(_: int, *, markdown: bool) -> tuple[str, int]:
    rows, wrong = [], 0
    for name, method in METHODS.items():
        row = [name]
        for file, (order, rod) in _TENTACLE_FILES.items():
            points = _tentacle_markers(file, order)
            one = fitted(method, points, 1e-5)
            if one is None:
                row.append("refused")
                continue
            se = "" if math.isnan(one.angle_se) else f" ± {math.degrees(one.angle_se):.0f}"
            row.append(f"{math.degrees(one.angle):.0f}{se} ({rod:.0f})")
            wrong += name == "tssgeom" and not keeps_bounds(points, one)
        rows.append(row)
    rows.insert(1, ["tssgeom, offsets", *(_on_rod(*each) for each in _TENTACLE_FILES.items())])
    lines = table(["method", *_TENTACLE_FILES], rows, text_columns=1, markdown=markdown)
    note = f"Φ [°]; in brackets that of a rod with the markers beside it, good to {_ROD_ERROR:.0f}°"
    return f"{lines}\n\n{note}", wrong


def _tentacle_markers(file: str, order: Sequence[int]) -> Points:
    line = np.loadtxt(_TENTACLE / f"{file}.csv", delimiter=",", max_rows=1)
    return line[2:].reshape(5, 3)[list(order)]


def _on_rod(file: str, known: tuple[Sequence[int], float]) -> str:
    """Fit the centre line with offsets and the direction at the start; returns also the result of the rod."""
    points = _tentacle_markers(file, known[0])
    points[0] += _TENTACLE_START
    directions = np.full_like(points, np.nan)
    directions[0] = (0.0, 1.0, 0.0)
    shape = clean(points, None, directions, _START_NOISE)
    arcs = follow_markers(shape, None, _TENTACLE_OFFSETS, (1.0, 0.0, 0.0))[1].fit.arcs
    return f"{math.degrees(arcs.total_angle):.0f} ± {math.degrees(arcs.total_angle_se):.0f} ({known[1]:.0f})"


def _aorta(_: int, *, markdown: bool) -> tuple[str, int]:
    lines = [_first_frame(part).points for part in _parts_of_aorta()]
    rows = []
    for name, method in METHODS.items():
        of_scan = partial(tssgeom, source="centreline") if name == "tssgeom" else method
        fits = [fitted(of_scan, points, 1e-4) for points in lines]
        if None in fits:
            rows.append([name, "refused", *[ABSENT] * 4])
            continue
        sound = [one for one in fits if one is not None]
        pairs = list(combinations(sound, 2))
        most = max(abs(a.angle - b.angle) / max(math.hypot(a.angle_se, b.angle_se), 1e-12) for a, b in pairs)
        texts = [f"{math.degrees(one.angle):.0f}" for one in sound]
        if math.isfinite(most):
            texts = [f"{math.degrees(one.angle):.0f} ± {math.degrees(one.angle_se):.0f}" for one in sound]
        rows.append([name, *texts, number(most, 2) if math.isfinite(most) else ABSENT])
    header = ["method", "line 1: Φ [°]", "line 2: Φ [°]", "smoothed: 1", "2", "most apart [s.e.]"]
    return table(header, rows, text_columns=1, markdown=markdown), 0


def _parts_of_aorta() -> Sequence[str]:
    return [f"{file}#{line}" for file in (_AORTA, _SMOOTHED) for line in (1, 2)]


def _first_frame(path: str) -> Frame:
    frame = next(iter(open_recording(path, "mm").frames))
    if not isinstance(frame, Frame):
        raise LookupError(f"{path}: {frame.reason}")
    return frame


def _rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan
