"""Markers in rendered films beside what their pixels allow, speed of `track`, and clearance in large meshes.

    python -m benchmarks.track [--quick] [--scenes N] [--markdown]

Films are rendered ray by ray with lenses that distort, blur and noise (tests/scenes), so that the truth is
known. Errors stand beside the bound: the noise of the centres as detected, propagated into space by the true
cameras. Angles come from sightings with noise of their own, in scenes of different cameras and routes.
No time is asserted.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from benchmarks import machine, number, options_parser, share, table
from tests.scenes import Ball, Lens, Scene, TagAt, arch, loop, render, ring, tag_poses
from tssgeom.engine import process
from tssgeom.errors import TssgeomError
from tssgeom.lumen.wall import Wall, nearest
from tssgeom.rig import Rig
from tssgeom.route.synthetic import colon, positions
from tssgeom.stream import Frame, FrameResult
from tssgeom.vision.blobs import BlobAppearance, blob_finder
from tssgeom.vision.cameras import Camera
from tssgeom.vision.tags import dictionary, tag_finder
from tssgeom.vision.track import Wanted, track
from tssgeom.vision.triangulation import noise_across
from tssgeom.vision.views import Sightings

_MARKERS = 16
_STEP = 1e-6  # [m]
_SIDE = 0.018  # of the tags [m]
_TOWARD = np.array([0.0, -0.6, 0.2])  # what they face [m]
Find = Callable[[np.ndarray], Sightings]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    parser = options_parser(__doc__, "fewer and shorter films")
    parser.add_argument("--scenes", type=int, default=0, help="scenes for the angle")
    options = parser.parse_args(arguments)
    scenes, frames = options.scenes or (24 if options.quick else 300), 4 if options.quick else 20
    print(machine())
    print(
        "\nrendered films, 640 x 480: error of a coordinate over what the pixels allow, and speed\n",
        flush=True,
    )
    header = (
        "film",
        "markers located [%]",
        "pixel [px]",
        "error [mm]",
        "allowed [mm]",
        "ratio",
        "stated / error",
    )
    speeds = ("find [ms/image]", "locate [ms/frame]", "frames/s")
    rows = [_film(*film, frames) for film in _films()]
    print(table((*header, *speeds), rows, text_columns=1, markdown=options.markdown), flush=True)
    print(f"\nΦ of {scenes} scenes, noise 0.25 px, 24 markers: within 1 and 2 s.e. (68 and 95 expected)\n")
    rows = [_angles(views, scenes) for views in (2, 3)]
    header = ("cameras", "all located [%]", "within 1 s.e. [%]", "within 2 s.e. [%]", "rms z", "misplaced")
    print(table(header, rows, text_columns=1, markdown=options.markdown), flush=True)
    print("\nclearance of 1000 nodes in a lumen\n")
    header = ("triangles", "first frame [s]", "each further [s]")
    counts = (10_000, 100_000) if options.quick else (10_000, 100_000, 1_000_000)
    print(table(header, [_clearance(n) for n in counts], text_columns=0, markdown=options.markdown))
    return 0


def _films() -> list[tuple[str, list[Lens], bool, float]]:
    return [
        ("balls, 2 cameras, noise 2", ring(2), False, 2.0),
        ("balls, 2 cameras, noise 8", ring(2), False, 8.0),
        ("balls, 3 cameras, noise 4", ring(3), False, 4.0),
        ("tags 18 mm, 2 cameras, noise 2", ring(2), True, 2.0),
    ]


def _film(name: str, lenses: list[Lens], tags: bool, noise: float, frames: int) -> tuple[str, ...]:
    count = 9 if tags else _MARKERS
    routes = [arch(count, 0.02 * f)[0] for f in range(frames)]
    find = tag_finder("4x4_50") if tags else blob_finder(BlobAppearance())
    images = [
        [_image(lens, v, f, routes[f], tags, noise) for v, lens in enumerate(lenses)] for f in range(frames)
    ]
    find(images[0][0])
    begin = time.perf_counter()
    detections = [[find(image) for image in row] for row in images]
    detected_in = (time.perf_counter() - begin) / (frames * len(lenses))
    cameras = tuple(_camera(lens, str(v)) for v, lens in enumerate(lenses))
    wanted = Wanted(tags, proximal=tuple(lenses[0].project(routes[0][:1])[0]))
    track(cameras, detections, wanted)
    begin = time.perf_counter()
    result = track(cameras, detections, wanted)
    located_in = (time.perf_counter() - begin) / frames
    error = np.array([one.points for one in result.frames]) - routes
    pixel = _pixel_error(lenses, detections, routes, tags)
    allowed = np.mean([_bound(lenses, route, pixel) for route in routes])
    rms = float(np.sqrt(np.nanmean(error**2)))
    spread = np.sqrt(np.nanmean([np.trace(one.covariance, axis1=1, axis2=2) / 3 for one in result.frames]))
    whole = 1.0 / (detected_in * len(lenses) + located_in)
    return (
        name,
        share(float(np.isfinite(error[..., 0]).mean())),
        number(pixel),
        number(1e3 * rms),
        number(1e3 * float(allowed)),
        number(rms / float(allowed)),
        number(float(spread) / rms),
        number(1e3 * detected_in),
        number(1e3 * located_in),
        number(whole),
    )


def _image(lens: Lens, camera: int, frame: int, route: np.ndarray, tags: bool, noise: float) -> np.ndarray:
    if not tags:
        return render(lens, Scene([Ball(position) for position in route]), camera, frame, noise)
    axes = tag_poses(route, _TOWARD)
    patterns = [cv2.aruco.generateImageMarker(dictionary("4x4_50"), k, 6) > 127 for k in range(len(route))]
    tags_in_view = [
        TagAt(cells.astype(int), _SIDE, *at)
        for cells, at in zip(patterns, zip(route, axes, strict=True), strict=True)
    ]
    return render(lens, Scene(tags=tags_in_view, background=90.0), camera, frame, noise)


def _camera(lens: Lens, name: str) -> Camera:
    (fx, fy), (cx, cy) = lens.focal, lens.centre
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    turn = np.asarray(cv2.Rodrigues(lens.rotation)[0], dtype=np.float64).ravel()
    return Camera(name, lens.width, lens.height, matrix, np.array(lens.distortion), turn, lens.shift)


def _pixel_error(
    lenses: Sequence[Lens],
    detections: Sequence[Sequence[Sightings]],
    routes: Sequence[np.ndarray],
    tags: bool,
) -> float:
    """Root mean square error of a coordinate of the detected centres [px]."""
    off = []
    for row, route in zip(detections, routes, strict=True):
        for lens, one in zip(lenses, row, strict=True):
            truth = _tag_centres(lens, route) if tags else lens.project(route)
            names = one.ids if tags else np.linalg.norm(one.centre[:, None] - truth, axis=2).argmin(axis=1)
            off.append((one.centre - truth[names]).ravel())
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


def _tag_centres(lens: Lens, route: np.ndarray) -> np.ndarray:
    """Mean of the pixels of the corners of each tag, not quite that of its middle [n, 2] [px]."""
    axes = tag_poses(route, _TOWARD)
    corners = [route + 0.5 * _SIDE * (x * axes[:, 0] + y * axes[:, 1]) for x in (-1, 1) for y in (-1, 1)]
    return np.mean([lens.project(corner) for corner in corners], axis=0)


def _bound(lenses: Sequence[Lens], route: np.ndarray, pixel: float) -> float:
    """Root mean square error of a coordinate that so much noise allows at best [m]."""
    values = []
    for position in route:
        step = _STEP * np.eye(3)
        slopes = [
            (lens.project(position + step) - lens.project(position - step)).T / (2 * _STEP) for lens in lenses
        ]
        stacked = np.concatenate(slopes)
        values.append(np.trace(np.linalg.inv(stacked.T @ stacked)) * pixel**2 / 3)
    return float(np.sqrt(np.mean(values)))


def _angles(views: int, scenes: int) -> tuple[str, ...]:
    z, whole, misplaced = list[float](), 0, 0
    for seed in range(scenes):
        random = np.random.default_rng(seed)
        lenses = ring(views, spread=random.uniform(0.6, 1.3), height=random.uniform(0.2, 0.9))
        route, angle = loop(24) if seed % 2 else arch(24, random.uniform(-1.0, 1.0))
        cameras = tuple(_camera(lens, str(v)) for v, lens in enumerate(lenses))
        try:
            tracked = track(cameras, [_detections(lenses, route, 0.25, random)], Wanted(tags=False)).frames[0]
        except TssgeomError:
            continue
        off = np.linalg.norm(tracked.points[:, None] - route, axis=2).min(axis=1)
        misplaced += int(np.sum(off > 5e-3))
        if len(tracked.points) < len(route):
            continue
        whole += 1
        frame = Frame(tracked.points, noise=noise_across(tracked.points, tracked.covariance))
        result = next(iter(process([frame], Rig(), tension_in=15.0)))
        if isinstance(result, FrameResult):
            z.append((result.arcs.total_angle - angle) / result.arcs.total_angle_se)
    size = np.abs(z)
    within = (share(float(np.mean(size < bars))) for bars in (1.0, 2.0))
    return (
        str(views),
        share(whole / scenes),
        *within,
        number(float(np.sqrt(np.mean(size**2)))),
        str(misplaced),
    )


def _detections(
    lenses: Sequence[Lens], route: np.ndarray, noise: float, random: np.random.Generator
) -> list[Sightings]:
    """Sightings with noise added to true pixels, in an order of no meaning."""
    values, count = [], len(route)
    for lens in lenses:
        order = random.permutation(count)
        pixels = lens.project(route[order]) + noise * random.standard_normal((count, 2))
        depth = (route[order] - lens.position) @ lens.rotation[2]
        area = np.pi * (0.004 * lens.focal[0] / depth) ** 2 * random.uniform(0.85, 1.15, count)
        values.append(Sightings(pixels[:, None], np.full(count, noise), np.full(count, -1), area))
    return values


def _clearance(triangles: int) -> tuple[str, ...]:
    """Time in a pipe around a colon-like route."""
    around = max(int(np.sqrt(triangles / 16)), 12)
    along = triangles // (2 * around)
    course = colon()
    s = np.linspace(0.0, course.total_length, along)
    middle = positions(course, s)
    tangent = np.gradient(middle, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    first = np.cross(tangent, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)[None, :, None]
    ring_of = np.cos(turn) * first[:, None] + np.sin(turn) * np.cross(tangent, first)[:, None]
    vertices = (middle[:, None] + 0.02 * ring_of).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij"))
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.vstack((np.column_stack((a, b, a + around)), np.column_stack((b, b + around, a + around))))
    wall = Wall(vertices[faces])
    nodes = middle[np.linspace(along // 50, along - along // 50, 1000).astype(int)]
    nearest(Wall(vertices[faces[:100]]), nodes[:3])
    times = []
    for _ in range(2):
        begin = time.perf_counter()
        nearest(wall, nodes)
        times.append(time.perf_counter() - begin)
    return f"{len(faces)}", number(times[0]), number(times[1])


if __name__ == "__main__":
    sys.exit(main())
