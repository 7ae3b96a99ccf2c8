"""The order of the gallery, its sample shapes, and figures that begin alike."""

from pathlib import Path
from typing import Any

from matplotlib import pyplot

ORDER = (
    "one_shape",
    "curvature_and_pieces",
    "tension_map",
    "sensor_comparison",
    "resolution",
    "hysteresis",
    "compensation",
    "moving_route",
    "batch_table",
    "calibration",
    "discovery",
    "adapting_filter",
    "friction_laws",
    "pair_on_a_joint",
    "added_curve",
)
"""Of the scripts: from a shape to tension, to runs, to rigs."""


def link_samples() -> None:
    """Put the sample shapes beside the scripts, as `tssgeom samples` does."""
    beside = Path(__file__).parents[1] / "gallery" / "sample_shapes"
    beside.mkdir(exist_ok=True)
    for path in (beside.parents[2] / "sample_shapes").iterdir():
        if path.suffix != ".md" and not (beside / path.name).exists():  # one would be the head of a gallery
            (beside / path.name).symlink_to(path)


class InOrder:
    """Sorts scripts as in `ORDER`; sphinx-gallery makes one for each folder."""

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def __call__(self, name: str) -> int:
        """Return the number of a script."""
        return ORDER.index(name.removesuffix(".py"))


def plain_figures(conf: Any, name: str) -> None:
    """Set the style of each script's figures."""
    pyplot.rcParams.update({"figure.figsize": (7.0, 3.6), "figure.constrained_layout.use": True})
