"""How well points can be known: the noise of pixels carried into space, apart from the program."""

import numpy as np

STEP = 1e-6


def bound(lenses, places, noise):
    """Root mean square error of a coordinate that pixel noise [px] allows at best [m]."""
    found = []
    for place in places:
        slopes = np.concatenate(
            [
                np.stack(
                    [
                        (lens.project((place + step)[None]) - lens.project((place - step)[None]))[0]
                        / (2 * STEP)
                        for step in STEP * np.eye(3)
                    ],
                    axis=1,
                )
                for lens in lenses
            ]
        )
        found.append(np.trace(np.linalg.inv(slopes.T @ slopes)) * noise**2 / 3)
    return float(np.sqrt(np.mean(found)))


def pixel_error(lenses, images, places, find):
    """Root mean square error of a coordinate of the centres that were found [px]."""
    off = []
    for lens, image in zip(lenses, images, strict=True):
        centre, truth = find(image).centre, lens.project(places)
        off.append(
            (centre - truth[np.linalg.norm(centre[:, None] - truth[None], axis=2).argmin(axis=1)]).ravel()
        )
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))
