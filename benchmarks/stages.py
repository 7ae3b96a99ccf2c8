"""Stages of a frame as they are timed, and the pipeline of peers beside them: splprep, numpy and ruptures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import TypeVar

import numpy as np
import ruptures
from scipy.interpolate import splev, splprep

from benchmarks import number, table
from benchmarks.estimators import RIG
from tests.attack.live_lines import KINDS
from tests.known_routes import PIECEWISE, harmonic_course, of_arcs, truth
from tests.live_process import line
from tests.tendon import steps
from tssgeom import core
from tssgeom.arrays import Points, Vector
from tssgeom.engine import Engine, process
from tssgeom.io.formats.jsonl import frame_of
from tssgeom.io.formats.recording import PER_METRE
from tssgeom.io.results.answers import answer
from tssgeom.rig import Rig, ShapeSensor
from tssgeom.route.geometry import Method, measure
from tssgeom.route.observations import Shape, clean
from tssgeom.route.pieces import Arcs, constant_curvature_pieces, smooth_geometry
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.spline.fit import fit
from tssgeom.route.spline.spline import Spline, rows_for
from tssgeom.route.synthetic import Course
from tssgeom.route.tracking import TrackedFit, follow
from tssgeom.stream import Frame, FrameResult
from tssgeom.tendon.bars.bar_state import BARS, BarState
from tssgeom.tendon.capstan import Corners, pretensioned, step, transmit

NOISE = 5e-4
"""Standard deviation of each coordinate, known to every fit [m]."""
_SWAY = 0.02  # relative change of all curvatures to both sides, over the frames
_TENSIONS = (15.0, 6.0)  # [N]
_MU = RIG.friction.coefficient

_Given = TypeVar("_Given")
_Calls = Callable[[Sequence[Frame]], Iterator[Callable[[], object]]]


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage, as calls without arguments that follow each other."""

    name: str
    calls: _Calls
    """Endless calls on frames; what each is given is made before the call."""


def moving_course(*, smooth: bool) -> Course:
    """Return the route that sways in the frames: smooth, or of seven pieces."""
    if smooth:
        return harmonic_course(np.random.default_rng(5))
    course = truth(PIECEWISE[-1], np.random.default_rng(0)).course
    if course is None:
        raise TypeError(f"{PIECEWISE[-1]} has no pieces: choose another route for the frames")
    return course


def frames(n: int, count: int, *, smooth: bool = False) -> list[Frame]:
    """Return frames of `n` points on a route that sways slowly, the tension going up and down."""
    course = moving_course(smooth=smooth)
    rng = np.random.default_rng(1)
    stations = np.linspace(0.0, course.total_length, n)
    sensed = []
    for i in range(count):
        sway = 1.0 + _SWAY * np.sin(2 * np.pi * i / count)
        route = of_arcs(Course(course.length, sway * course.bend), piecewise=not smooth)
        points = route.position(stations) + NOISE * rng.standard_normal((n, 3))
        sensed.append(Frame(points, float(i), stations, _TENSIONS[i % 2]))
    return sensed


def _stage(name: str, given: Callable[[Frame], _Given], act: Callable[[_Given], object]) -> Stage:
    def calls(sensed: Sequence[Frame]) -> Iterator[Callable[[], object]]:
        return cycle([partial(act, given(frame)) for frame in sensed])

    return Stage(name, calls)


def _frame(frame: Frame) -> Frame:
    return frame


def _clean(frame: Frame) -> Shape:
    return clean(frame.points)


def _known(frame: Frame) -> Shape:
    return clean(frame.points, frame.stations)


def _fitted(frame: Frame) -> Spline:
    return fit(_known(frame), NOISE)


def _pieces(frame: Frame) -> Arcs:
    return constant_curvature_pieces(_fitted(frame))


def _measured(shape: Shape, method: Method = "auto") -> RouteFit:
    return measure(shape, NOISE, method)


def _moving(frame: Frame) -> tuple[Corners, float]:
    """Tendon after a pull and a release, and where its proximal tension goes next."""
    loaded = step(step(pretensioned(RIG), 15.0, _MU), 9.0, _MU)
    return loaded, frame.tension_in or 0.0


def _stepped(given: tuple[Corners, float]) -> Corners:
    return step(*given, _MU)


def _loaded(frame: Frame) -> tuple[Corners, Arcs]:
    return _stepped(_moving(frame)), _pieces(frame)


def _followed(method: Method, *, stations: bool) -> _Calls:
    """Geometry of one frame after the other, each from where the last one was."""

    def calls(sensed: Sequence[Frame]) -> Iterator[Callable[[], object]]:
        last: TrackedFit | None = None

        def go_on(shape: Shape) -> TrackedFit:
            nonlocal last
            last = follow(shape, NOISE, last, method)
            return last

        return cycle([partial(go_on, _known(frame) if stations else _clean(frame)) for frame in sensed])

    return calls


def _bent(frame: Frame) -> tuple[BarState, Arcs, float]:
    """Bars after a pull and a release on a route that is not quite the frame's, and where the drive goes."""
    arcs = _pieces(frame)
    before = Arcs.exact(arcs.length, (1.0 + _SWAY) * arcs.angle)
    state = steps.pretensioned_bars(RIG, before)
    for tension_in in (15.0, 9.0):
        state = steps.step(state, before, RIG, tension_in=tension_in)
    return state, arcs, frame.tension_in or 0.0


def _moved(given: tuple[BarState, Arcs, float]) -> BarState:
    state, arcs, tension_in = given
    return steps.step(state, arcs, RIG, tension_in=tension_in)


def _streamed(*, stations: bool) -> _Calls:
    """Whole frames through the engine, which carries the tendon along."""
    rig = Rig(shape=ShapeSensor(noise_mm=1e3 * NOISE))

    def calls(sensed: Sequence[Frame]) -> Iterator[Callable[[], object]]:
        given_frames = sensed if stations else [Frame(f.points, f.time, None, f.tension_in) for f in sensed]
        results = process(cycle(given_frames), rig, tension_in=_TENSIONS[0])
        while True:
            yield partial(next, results)

    return calls


def _line(frame: Frame) -> bytes:
    return line(1e3 * frame.points, frame.time)


def _result(frame: Frame) -> FrameResult:
    rig = Rig(shape=ShapeSensor(noise_mm=1e3 * NOISE))
    result = next(process([frame], rig, tension_in=_TENSIONS[0]))
    if not isinstance(result, FrameResult):
        raise TypeError(result.reason)
    return result


def _answer_line(result: FrameResult) -> bytes:
    return answer(result, result.frame.time, result.seq, 0.0, 0)


def _core_alone(sensed: Sequence[Frame]) -> Iterator[Callable[[], object]]:
    """Compiled calls of the geometry and the tendon of a frame, everything ready and nothing done with it."""
    first = fit(_clean(sensed[0]), NOISE)
    last, route, n = first.memory, first.route, len(sensed[0].points)
    variance = (NOISE / last.spacing) ** 2
    arcs = constant_curvature_pieces(first)
    state = steps.step(steps.pretensioned_bars(RIG, arcs), arcs, RIG, tension_in=15.0)

    def calls(frame: Frame) -> object:
        core.clearly_sound(frame.points)
        core.spline_frame(
            frame.points,
            last.u,
            last.y,
            last.weight,
            last.mean,
            last.covariance,
            last.ratio,
            last.intensity,
            1.0,
            last.spacing,
            variance,
            None,
            rows_for(n),
        )
        core.curvature_profile(
            route.s,
            route.tangent,
            route.curvature_vector,
            first.covariance,
            first.gain,
            first.freedom,
            route.noise,
            False,
            0.0,
            0.0,
            route.station,
            first.joints,
        )
        return steps.step(state, arcs, RIG, tension_in=14.0)

    return cycle([partial(calls, frame) for frame in sensed])


WHOLE = (
    Stage("whole frame, stations known", _streamed(stations=True)),
    Stage("whole frame, stations unknown", _streamed(stations=False)),
)
STAGES = (
    _stage("line of JSON read", _line, partial(frame_of, unit=None)),
    _stage("clean, stations unknown", _frame, _clean),
    _stage("clean, stations known", _frame, _known),
    _stage("spline fit, stations known", _known, partial(fit, noise=NOISE)),
    _stage("spline fit, stations unknown", _clean, partial(fit, noise=NOISE)),
    _stage("curvature profile and pieces", _fitted, smooth_geometry),
    _stage("cold: spline, stations known", _known, partial(_measured, method="spline")),
    _stage("cold: arcs, stations known", _known, partial(_measured, method="arcs")),
    _stage("cold: chosen, stations known", _known, _measured),
    _stage("cold: chosen, stations unknown", _clean, _measured),
    Stage("warm: spline, stations known", _followed("spline", stations=True)),
    Stage("warm: spline, stations unknown", _followed("spline", stations=False)),
    Stage("warm: arcs, stations known", _followed("arcs", stations=True)),
    Stage("warm: arcs, stations unknown", _followed("arcs", stations=False)),
    _stage("tendon step", _moving, _stepped),
    _stage(f"tendon step, moving route, {BARS} bars", _bent, _moved),
    _stage("transmit", _loaded, lambda given: transmit(*given, RIG)),
    _stage("line of JSON answered", _result, _answer_line),
    *WHOLE,
)
SMOOTH_STAGES = (*WHOLE, Stage("its arithmetic alone, the limit", _core_alone))
"""What is timed on a smooth route that moves."""


_CURVATURE_NOISE = 1.0  # what ruptures shall take for noise [1/m]
_PER_PIECE = 3.0  # times ln N, as in the criterion of this project


def _curvature(frame: Frame) -> Vector:
    """Curvature at the stations [1/m], from the quintic with the residual that the noise leaves."""
    points: Points = frame.points
    tck, u = splprep(points.T, u=frame.stations, k=5, s=points.size * NOISE**2)
    first, second = (np.array(splev(u, tck, order)).T for order in (1, 2))
    return np.linalg.norm(np.cross(first, second), axis=1) / np.linalg.norm(first, axis=1) ** 3


def _penalty(n: int) -> float:
    return _PER_PIECE * np.log(n) * _CURVATURE_NOISE**2


def pelt(frame: Frame) -> Sequence[int]:
    """Cut the route where the curvature changes, by PELT with the l2 cost (Python)."""
    kappa = _curvature(frame)
    return ruptures.Pelt(model="l2").fit(kappa).predict(_penalty(len(kappa)))


def kernel(frame: Frame) -> Sequence[int]:
    """Cut the route where the curvature changes, by KernelCPD with the linear kernel (C)."""
    kappa = _curvature(frame)[:, None]
    return ruptures.KernelCPD(kernel="linear").fit(kappa).predict(pen=_penalty(len(kappa))) or []


def first_frame_table(counts: Sequence[int], clock: Callable[[], float], *, markdown: bool) -> str:
    """Return the time of the first frame of a stream over its points, of routes that are hard to fit."""
    rows = [[kind, *(number(1e3 * _first(kind, n, clock)) for n in counts)] for kind in KINDS]
    return table(["route", *(f"{n} [ms]" for n in counts)], rows, text_columns=1, markdown=markdown)


def _first(kind: str, count: int, clock: Callable[[], float]) -> float:
    frame, engine = Frame(KINDS[kind](count) / PER_METRE["mm"], 0.0), Engine(Rig(), tension_in=_TENSIONS[0])
    begin = clock()
    engine.push(frame)
    return clock() - begin


def _calls(
    pipeline: Callable[[Frame], Sequence[int]],
) -> Callable[[Sequence[Frame]], Iterator[Callable[[], object]]]:
    return lambda sensed: cycle([partial(pipeline, frame) for frame in sensed])


PIPELINES = (
    Stage("scipy + ruptures PELT", _calls(pelt)),
    Stage("scipy + ruptures kernel", _calls(kernel)),
)
"""The same, with the usual and with the fastest search of ruptures."""
