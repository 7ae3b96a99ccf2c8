"""A Gaussian process for what the base model leaves, by scikit-learn: it names nothing."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks.discovery_residuals import Residual, held_out_ratio
from benchmarks.discovery_scores import Baseline

_POINTS = 300  # of the fitted runs; the work grows with the cube


def by_gaussian_process(runs: Sequence[Residual]) -> Baseline:
    """Learn the residual of each channel over the drive, the model's tensions and the speed."""
    fitted = [run for run in runs if not run.held_out]
    table = np.concatenate([_features(run) for run in fitted])
    centre, spread = table.mean(axis=0), table.std(axis=0)
    scale = np.where(spread > 0.0, spread, 1.0)  # a tension may stay at zero
    some = np.linspace(0, len(table) - 1, _POINTS).astype(int)
    told: list[dict[str, np.ndarray]] = [{} for _ in runs]
    for channel in runs[0].left:
        target = np.concatenate([run.left[channel] for run in fitted])
        process = _fitted(((table - centre) / scale)[some], target[some])
        for run, corrections in zip(runs, told, strict=True):
            corrections[channel] = process.predict((_features(run) - centre) / scale)
    return Baseline("", held_out_ratio(runs, told))


def _fitted(table: np.ndarray, target: np.ndarray) -> Any:
    processes, kernels = (import_module(f"sklearn.gaussian_process{part}") for part in ("", ".kernels"))
    kernel = kernels.ConstantKernel(10.0) * kernels.RBF(np.ones(table.shape[1])) + kernels.WhiteKernel(1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # lengths without bearing run to their bounds
        return processes.GaussianProcessRegressor(kernel, random_state=0).fit(table, target)


def _features(run: Residual) -> np.ndarray:
    time, place = run.measured["time_s"], run.measured["displacement_in_m"]
    speed = np.gradient(place, time)
    smooth = np.convolve(speed, np.full(5, 0.2), mode="same")
    return np.column_stack([place, run.model["tension_in_N"], run.model["tension_out_N"], smooth])
