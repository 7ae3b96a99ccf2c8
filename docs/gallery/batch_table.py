"""
A table of many shapes
======================

``tssgeom batch`` writes a table with a row for each input. Here it does the sample shapes, and the figure
is made from the table alone.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
import pyarrow.parquet as pq

from pipelines.cli import main

shapes = sorted(map(str, Path("sample_shapes").glob("*.csv")))
with TemporaryDirectory() as out:
    try:
        main(["batch", *shapes, "--out", out, "--no-pictures", "--quiet"])
    except SystemExit as end:
        print("exit status", end.code)
    table = pq.read_table(f"{out}/summary.parquet").sort_by("total_angle_rad")

names = table["name"].to_pylist()
figure, (angles, forces) = plt.subplots(1, 2, figsize=(8, 3.2), sharey=True)
for axes, value, error, unit in (
    (angles, "total_angle_rad", "total_angle_se_rad", "curve angle Φ [rad]"),
    (forces, "tension_out_N", "tension_out_se_N", r"$T_\mathrm{out}$ at $T_\mathrm{in}$ = 15 N [N]"),
):
    width = 1.96 * np.array(table[error].to_pylist())
    axes.errorbar(table[value].to_pylist(), names, xerr=width, fmt="o", capsize=3)
    axes.set(xlabel=unit)
    axes.grid(axis="y", alpha=0.3)
