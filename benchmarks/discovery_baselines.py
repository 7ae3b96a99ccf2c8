"""The peers on one campaign, as far as they are installed (extra `baselines`)."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from benchmarks.discovery_process import by_gaussian_process
from benchmarks.discovery_residuals import residuals
from benchmarks.discovery_scores import Baseline
from benchmarks.discovery_sindy import by_sparse_regression

_PEERS = {
    "sparse regression (pysindy)": ("pysindy", by_sparse_regression),
    "Gaussian process (scikit-learn)": ("sklearn", by_gaussian_process),
}


def baselines(folder: Path) -> dict[str, Baseline]:
    """Return what each installed peer makes of a campaign; one that fails on it is told, and has no part."""
    installed = {name: work for name, (package, work) in _PEERS.items() if find_spec(package)}
    runs = residuals(folder) if installed else []
    told = dict[str, Baseline]()
    for name, work in installed.items():
        try:
            told[name] = work(runs)
        except (ValueError, ArithmeticError) as error:
            print(f"{name} fails on a campaign: {error}", file=sys.stderr)
    return told
