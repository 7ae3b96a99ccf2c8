"""Which of position and tension at the proximal end drives a tendon: the one that is measured more exactly.

Source: docs/model.md (273), (275).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError
from tssgeom.identify.calibrated_run import CalibratedRun
from tssgeom.identify.fit import Point, Problem
from tssgeom.identify.machine_drive_noise import INPUT_NOISE, is_noisy
from tssgeom.identify.readings import in_order
from tssgeom.identify.turning import Legs, legs
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.statistics import NORMAL_95, reading_noise
from tssgeom.tendon.simulation import Measured


@dataclass(frozen=True, slots=True)
class ExactDriveSettings:
    """When a position drives although the tension is measured."""

    worth: float = 2.0
    """Of the noise of T_in: noise of the position, as tension, up to which it drives [1]; measured: on runs
    of `tests/lumped` it is better at 1.3, and at 4.3 its error of the friction is up to twice as large."""


EXACT_DRIVE = ExactDriveSettings()
_SEED = 20  # of the draws; any, but the same in all fits


def position_is_exact(measured: Measured) -> bool:
    """Return whether the position is to drive a run with T_in and without an elongation; docs/model.md (273).

    The stiffness that makes a tension of its noise is that of the run: how far T_in goes per metre of it.
    """
    tension, position, time = measured.tension_in, measured.displacement_in, measured.time
    if tension is None or position is None or measured.elongation is not None:
        return False
    there = in_order(time, position) & np.isfinite(tension)
    if np.count_nonzero(there) < PLAUSIBLE.fewest_rows:
        return False
    share = [
        reading_noise(values[there], time[there]) / max(float(np.ptp(values[there])), 1e-300)
        for values in (position, tension)
    ]
    return share[0] <= EXACT_DRIVE.worth * share[1]


class DriveNoise(NamedTuple):
    """What the noise of a position that drives does to a fit; docs/model.md (275)."""

    covariance: Matrix
    """[size, size] What it adds to the covariance of the numbers."""
    spread: Vector
    """[rows] Root mean square of what it does to each reading [N, m]."""


def drive_noise(
    run: CalibratedRun, problem: Problem, at: Point, bread: Matrix, of_data: Matrix
) -> DriveNoise:
    """Return what the noise of a position that drives does to a fit, from draws of it; docs/model.md (275).

    Parameters
    ----------
    run, problem, at
        The fit.
    bread
        [size, size] Inverse of the normal matrix.
    of_data
        [rows, size] Derivatives of the whitened prediction.
    """
    fitted = [k for k, zero in enumerate(run.zeros, start=2) if zero.name.startswith("turn_")]
    sd = np.array([run.zeros[k - 2].sd for k in fitted])
    here, errors, changes = run.predicted(at, problem.rig), list[Vector](), list[Vector]()
    for again in _draws(run):
        try:
            change = here - replace(run, legs=again).predicted(at, problem.rig)
        except FitError:
            continue
        error = bread @ (of_data.T @ problem.whitening.whitened(change))
        error[fitted] -= (run.legs.turn_values - again.turn_values)[: len(fitted)] / sd
        errors.append(error)
        changes.append(change)
    if not errors:
        return DriveNoise(np.zeros_like(bread), np.zeros(len(here)))
    factor = (float(stdtrit(len(errors), 0.975)) / NORMAL_95) ** 2
    of_draws = factor * np.transpose(errors) @ np.array(errors) / len(errors)
    of_levels = bread[:, fitted] @ bread[fitted]  # the draws have it too
    return DriveNoise(of_draws - of_levels, np.sqrt(np.mean(np.square(changes), axis=0)))


def _draws(run: CalibratedRun) -> Iterator[Legs]:
    """Yield the drive of a run as other noise might have made it, its turns between the same readings."""
    made, rng = run.legs, np.random.default_rng(_SEED)
    time = np.delete(run.reading.time, made.turns + np.arange(len(made.turns)))
    for _ in range(INPUT_NOISE.draws if is_noisy(made.values, made.noise) else 0):
        read = made.values + made.noise * rng.standard_normal(len(time))
        again = legs(read, time, of_position=True)
        if len(again.turns) == len(made.turns):  # noise that makes another turn is none that was read
            yield replace(again, turns=made.turns)
