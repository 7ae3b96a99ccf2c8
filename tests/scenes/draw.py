"""Glowing balls, square tags and flat covers, rendered by casting rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter

from tests.scenes.lenses import Lens

_FINE = 4  # rays along each side of a pixel


@dataclass(frozen=True)
class Ball:
    """A ball of even brightness: position and radius [m], colour blue green red."""

    position: np.ndarray
    radius: float = 0.004
    colour: tuple[float, float, float] = (230.0, 230.0, 230.0)


@dataclass(frozen=True)
class TagAt:
    """A flat tag: cells [k, k] of 0 and 1 with its black border, side [m], pose of its middle."""

    cells: np.ndarray
    side: float
    position: np.ndarray
    axes: np.ndarray
    """Right, up, out [3, 3]."""
    margin: float = 1.35
    """Side of the white paper over that of the tag."""


@dataclass(frozen=True)
class Scene:
    """Everything in front of the cameras."""

    balls: Sequence[Ball] = ()
    tags: Sequence[TagAt] = ()
    covers: Sequence[tuple[int, int, int, int, int]] = field(default_factory=tuple)
    """Camera and box x0, y0, x1, y1 [px] of what stands in front of everything."""
    background: float = 40.0


def render(
    lens: Lens, scene: Scene, camera: int, seed: int, noise: float = 2.0, blur: float = 0.7
) -> np.ndarray:
    """Image of a scene, 8 bits, blue green red."""
    random = np.random.default_rng((seed, camera))
    y, x = np.mgrid[0 : lens.height, 0 : lens.width]
    ground = scene.background * (1.0 + 0.4 * x / lens.width - 0.3 * y / lens.height)
    image = np.repeat(ground[:, :, None], 3, axis=2)
    for thing in sorted([*scene.balls, *scene.tags], key=lambda one: -_depth(lens, one.position)):
        _draw(image, lens, thing)
    for number, x0, y0, x1, y1 in scene.covers:
        if number == camera:
            image[y0:y1, x0:x1] = 25.0
    image = gaussian_filter(image.astype(np.float32), (blur, blur, 0))
    image += noise * random.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _depth(lens: Lens, position: np.ndarray) -> float:
    return float(lens.rotation[2] @ position + lens.shift[2])


def _draw(image: np.ndarray, lens: Lens, thing: Ball | TagAt) -> None:
    reach = thing.radius if isinstance(thing, Ball) else 0.75 * thing.margin * thing.side
    middle = lens.project(thing.position[None])[0]
    wide = 1.15 * lens.focal[0] * reach / _depth(lens, thing.position) + 2
    x0, y0 = np.maximum(np.floor(middle - wide).astype(int), 0)
    x1 = min(int(middle[0] + wide) + 2, lens.width)
    y1 = min(int(middle[1] + wide) + 2, lens.height)
    if x0 >= x1 or y0 >= y1:
        return
    step = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    fine_x, fine_y = (np.arange(x0, x1)[:, None] + step).ravel(), (np.arange(y0, y1)[:, None] + step).ravel()
    px, py = np.meshgrid(fine_x, fine_y)
    slope = lens.slopes(np.stack((px, py), axis=-1).reshape(-1, 2))
    rays = np.column_stack((slope, np.ones(len(slope)))) @ lens.rotation
    cover, value = (_ball if isinstance(thing, Ball) else _tag)(lens, rays, thing)  # type: ignore[operator]

    def pooled(values: np.ndarray) -> np.ndarray:
        return values.reshape(y1 - y0, _FINE, x1 - x0, _FINE).mean(axis=(1, 3))

    share = pooled(cover)[:, :, None]
    light = np.stack([pooled(cover * value[:, c]) for c in range(3)], axis=2)
    image[y0:y1, x0:x1] = (1 - share) * image[y0:y1, x0:x1] + light


def _ball(lens: Lens, rays: np.ndarray, ball: Ball) -> tuple[np.ndarray, np.ndarray]:
    to = ball.position - lens.position
    along = rays @ to / np.sum(rays * rays, axis=1)
    off = along[:, None] * rays - to
    cover = (np.sum(off * off, axis=1) <= ball.radius**2).astype(float)
    return cover, np.broadcast_to(np.array(ball.colour), (len(rays), 3))


def _tag(lens: Lens, rays: np.ndarray, tag: TagAt) -> tuple[np.ndarray, np.ndarray]:
    right, up, out = tag.axes
    reach = ((tag.position - lens.position) @ out) / (rays @ out)
    at = lens.position + reach[:, None] * rays - tag.position
    u, v = at @ right / tag.side + 0.5, 0.5 - at @ up / tag.side
    paper = 0.5 * (tag.margin - 1.0)
    cover = ((u > -paper) & (u < 1 + paper) & (v > -paper) & (v < 1 + paper)).astype(float)
    k = len(tag.cells)
    inside = (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
    column, row = np.clip((u * k).astype(int), 0, k - 1), np.clip((v * k).astype(int), 0, k - 1)
    bright = np.where(inside, tag.cells[row, column], 1)
    return cover, np.repeat((20.0 + 200.0 * bright)[:, None], 3, axis=1)
