"""Numbers of a machine that hang on where a sheath bends, where nobody knows it; docs/model.md (322)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tssgeom.errors import FitError
from tssgeom.identify.machine_estimates import MachineEstimate
from tssgeom.identify.machine_fit import fit_round
from tssgeom.identify.machine_problem import FitState, Problem


def bend_remarks(problem: Problem, state: FitState, estimates: Sequence[MachineEstimate]) -> tuple[str, ...]:
    """Say which numbers an even bend puts outside of their intervals, and how much worse it fits; (322).

    Parameters
    ----------
    problem, state
        The fit, in which the shares of the angle may be fitted too.
    estimates
        What it gives.

    Returns
    -------
    One sentence, or none.
    """
    kept = np.array([each.kind != "share" for each in problem.parameters])
    even = _even(problem, state, kept) if not kept.all() else None
    if even is None:
        return ()
    made, fitted = even
    values = {
        each.key: each.value(u)
        for each, u in zip(made.parameters, fitted.u, strict=True)
        if each.kind == "rig"
    }
    moved = [
        f"{each.name} {values[each.key]:.4g}"
        for each in estimates
        if each.key in values and each.identified and not each.low <= values[each.key] <= each.high
    ]
    if not moved:
        return ()
    above = 2.0 * (fitted.objective - state.objective)
    return (
        "route.bends is not known, and numbers hang on it: with an even bend, whose χ² is "
        f"{above:.3g} above, {', '.join(moved)}; the intervals are those of the "
        "shares that are fitted alone and may miss the truth: state route.bends, or sense the shape",
    )


def _even(problem: Problem, state: FitState, kept: np.ndarray) -> tuple[Problem, FitState] | None:
    """Return the fit with an even bend, with the same weights; None without an equilibrium."""
    own = [each for each, there in zip(problem.parameters, kept, strict=True) if there]
    made = replace(problem, parameters=tuple(own), too_few_bars=())
    try:
        near = fit_round(made, state.u[kept], state.weight, state.inflation)
        made = made.corrected(near.u, near.channels)  # bars miss more or less than where the bends were
        return made, fit_round(made, near.u, state.weight, state.inflation)
    except FitError:
        return None
