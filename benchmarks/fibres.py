"""Φ from the curvatures of a fibre, beside the peers: rows of `benchmarks.accuracy`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_smoothing_spline

from benchmarks import number, share, table
from tests.known_routes import harmonic_course
from tssgeom.arrays import Matrix, Vector
from tssgeom.route.fibre.sensed import clean_fibre, fit_fibre
from tssgeom.route.synthetic import Course, colon, setup_a
from tssgeom.statistics import NORMAL_95

_ROUTES: Mapping[str, Callable[[np.random.Generator], Course]] = {
    "setup A": lambda _: setup_a(),
    "colon": lambda _: colon(),
    "harmonics": harmonic_course,
}
_FINE = 2000


class FibreCell(NamedTuple):
    """One route, sensed by a fibre."""

    route: str
    n: int
    """Gratings, even from end to end."""
    noise: float
    """Standard deviation of a curvature component [1/m]."""
    noise_known: bool

    @property
    def title(self) -> str:
        """Group and name, which `--cell` searches."""
        known = "" if self.noise_known else " unknown"
        return f"fibre: {self.route} {self.n} gratings {self.noise:g}/m{known}"


CELLS = tuple(
    FibreCell(route, n, 0.15, known)
    for route in _ROUTES
    for n, known in ((40, True), (120, True), (120, False))
)


def fibre_table(cells: Sequence[FibreCell], trials: int, *, markdown: bool) -> str:
    """Return errors of Φ by the curvatures of fibres, in per cent, and how often its interval holds it."""
    head = ["fibre", "raw rms", "GCV spline rms", "tssgeom rms", "bias [s.e.]", "95 % hold [%]"]
    return table(head, [_row(cell, trials) for cell in cells], text_columns=1, markdown=markdown)


def _row(cell: FibreCell, trials: int) -> list[str]:
    errors = np.array([_errors(cell, trial) for trial in range(trials)])
    raw, spline, ours = (f"{number(100.0 * float(np.sqrt(np.mean(x**2))))}" for x in errors.T[:3])
    off = errors[:, 2] / errors[:, 3]
    bias, held = f"{np.mean(off):+.2f}", share(float(np.mean(np.abs(off) <= NORMAL_95)))
    return [cell.title.removeprefix("fibre: "), raw, spline, ours, bias, held]


def _errors(cell: FibreCell, trial: int) -> tuple[float, float, float, float]:
    """Errors of Φ by raw curvatures, by a spline and by this project, and its standard error, over Φ."""
    rng = np.random.default_rng([CELLS.index(cell), trial])
    course = _ROUTES[cell.route](rng)
    s = np.linspace(0.0, course.total_length, cell.n)
    edge = np.concatenate(([0.0], np.cumsum(course.length)))
    piece = np.clip(np.searchsorted(edge, s, side="right") - 1, 0, len(course.length) - 1)
    bend = course.bend[piece] + cell.noise * rng.standard_normal((cell.n, 2))
    fine = np.linspace(0.0, course.total_length, _FINE)
    smooth = np.column_stack([make_smoothing_spline(s, one)(fine) for one in bend.T])
    arcs = fit_fibre(clean_fibre(bend, s), cell.noise if cell.noise_known else None).fit.arcs
    angles = np.array([_turned(s, bend), _turned(fine, smooth), arcs.total_angle])
    raw, spline, ours = (angles - course.total_angle) / course.total_angle
    return float(raw), float(spline), float(ours), arcs.total_angle_se / course.total_angle


def _turned(s: Vector, bend: Matrix) -> float:
    return float(np.trapezoid(np.linalg.norm(bend, axis=1), s))
