"""How well points can be known: the noise of pixels carried into space, apart from the program."""

import numpy as np

STEP = 1e-6


def bound(lenses, positions, noise):
    """Root mean square error of a coordinate that pixel noise [px] allows at best [m]."""
    result = []
    for position in positions:
        slopes = np.concatenate(
            [
                np.stack(
                    [
                        (lens.project((position + step)[None]) - lens.project((position - step)[None]))[0]
                        / (2 * STEP)
                        for step in STEP * np.eye(3)
                    ],
                    axis=1,
                )
                for lens in lenses
            ]
        )
        result.append(np.trace(np.linalg.inv(slopes.T @ slopes)) * noise**2 / 3)
    return float(np.sqrt(np.mean(result)))


def pixel_error(lenses, images, positions, find):
    """Root mean square error of a coordinate of the detected centres [px]."""
    off = []
    for lens, image in zip(lenses, images, strict=True):
        centre, truth = find(image).centre, lens.project(positions)
        off.append(
            (centre - truth[np.linalg.norm(centre[:, None] - truth[None], axis=2).argmin(axis=1)]).ravel()
        )
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))
