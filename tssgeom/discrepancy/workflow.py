"""The workflow: base fit, error model, where, what, decision, ties, next experiment, updated rig.

Steps and constants: docs/discovery.md, "How it decides"; equations: docs/model.md (100)-(119).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from tssgeom.discrepancy.base import base_fit, posed
from tssgeom.discrepancy.campaign import Campaign
from tssgeom.discrepancy.finding import Estimate, Finding
from tssgeom.discrepancy.outcome import gap_of, traces
from tssgeom.discrepancy.problem import Fit, columns
from tssgeom.discrepancy.readings import readings
from tssgeom.discrepancy.stack import stacked
from tssgeom.discrepancy.where import along_routes, heat_map, pointed

_NORMAL = 1.959964  # of a 95 % interval


def discover(
    campaign: Campaign, *, seed: int = 0, progress: Callable[[str, float], None] | None = None
) -> Finding:
    """Find what the model of a rig lacks.

    Parameters
    ----------
    campaign
        Measured runs and the rig as it is believed to be.
    seed
        Of the simulated clean campaigns; the same seed gives the same answer.
    progress
        Is told of each step and the share that is done [1].

    Raises
    ------
    SettingsError
        Where the runs cannot be used.
    """
    begun = time.perf_counter()
    tell = progress or _silent
    tell("reading the runs", 0.0)
    runs, notes = readings(campaign)
    tell("fitting friction and compliance", 0.05)
    _, _, fit = base_fit([run for run in runs if not run.held_out], campaign.rig)
    tell("mapping where they disagree", 0.1)
    whole, _ = posed(stacked(runs), campaign.rig, fit.at)
    heat, where = heat_map(whole, fit.at)
    along = along_routes(whole, fit.at, columns(whole, fit.at, whole.left(fit.at)))
    where = pointed(where, along, {run.name: run.route.name for run in runs})
    told = traces(runs, campaign.rig, fit.at, fit.at)
    tell("done", 1.0)
    return Finding(
        campaign=campaign,
        verdict="none",
        sentence="No effect was looked for.",
        effects=(),
        ties=(),
        breaks_tie=(),
        unobservable={},
        where=where,
        heat=heat,
        along=along,
        gap=gap_of(told),
        base=base_estimates(fit),
        nominal={
            "friction": campaign.rig.friction.coefficient,
            "compliance_per_N": campaign.rig.tendon.compliance_per_N,
        },
        base_tie="",
        ranking=(),
        missing_shapes=(),
        rig=fit.at.rig(campaign.rig),
        traces=told,
        notes=notes,
        seconds=time.perf_counter() - begun,
    )


def _silent(step: str, share: float) -> None:
    pass


def base_estimates(fit: Fit) -> dict[str, Estimate]:
    """Friction and compliance with their 95 % intervals."""
    sd = np.sqrt(np.diag(fit.covariance))
    both = (("friction", fit.at.friction, "1"), ("compliance_per_N", fit.at.compliance, "1/N"))
    return {
        name: Estimate(value, unit, value * math.exp(-_NORMAL * s), value * math.exp(_NORMAL * s))
        for (name, value, unit), s in zip(both, sd[:2], strict=True)
    }
