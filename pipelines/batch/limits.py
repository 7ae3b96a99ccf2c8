"""How a batch is divided among workers and in its report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BatchLimits:
    """How a batch is divided among workers and in its report; no number depends on it."""

    most_figures: int = 500
    """Inputs that the report draws; of all others it has the numbers and the link to the recording [1].
    Chosen: each adds 20 to 60 kB to the page."""
    most_outlying: int = 10
    """Outlying inputs with a line on the terminal [1]; the report has all. Chosen."""
    most_rows: int = 40
    """Inputs that the table lists [1]; chosen: the height of a terminal."""
    shared_size: int = 4 << 20
    """Size of an input from which several workers share frames that stand alone [B].
    Chosen: a worker takes about as long for it as for its start."""
    worker_size: int = 4 << 20
    """Size of all inputs for each further worker [B]. Chosen: as `shared_size`."""
    worker_pictures: int = 30
    """Inputs with pictures for each further worker [1]. Chosen: it draws them in the time of its start."""
