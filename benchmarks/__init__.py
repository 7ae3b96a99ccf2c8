"""Measurements of accuracy and speed beside the peers; each module prints tables, in one run.

Linear algebra is held to one thread before numpy loads: times are those of one core, and the trials already
keep every core busy.
"""

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
