"""Cameras as the program knows them, from the lenses of rendered scenes."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.scenes import Lens
from tssgeom.vision.cameras import Camera


def camera_of(lens: Lens, name: str = "camera") -> Camera:
    (fx, fy), (cx, cy) = lens.focal, lens.centre
    return Camera(
        name,
        lens.width,
        lens.height,
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        np.array(lens.distortion),
        Rotation.from_matrix(lens.rotation).as_rotvec(),
        lens.shift,
    )


CamerasOf = Callable[[list[Lens]], tuple[Camera, ...]]


@pytest.fixture
def cameras_of() -> CamerasOf:
    return lambda lenses: tuple(camera_of(lens, f"camera{k}") for k, lens in enumerate(lenses))
