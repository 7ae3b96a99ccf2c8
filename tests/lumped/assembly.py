"""A path and its physics as the arrays that the march reads: bars 0 … n + 2 and nodes 0 … n + 1.

Node 0 and node n + 1 are the fittings at the ends of the sheath, the others the vertices of the polygon.
Bar 0 and bar n + 2 lie outside the sheath, towards the drive and the load.
"""

from typing import NamedTuple

import numpy as np

from tests.lumped.physics import Distal, Physics
from tests.lumped.route import Path

RIGID = 1e-5  # of a bar's compliance: what "no compliance" outside the sheath is, 1e-10 m at 10 N


class Chain(NamedTuple):
    """What stays the same during a run."""

    compliance: np.ndarray  # [b] m/N
    toe: np.ndarray  # [b] m
    toe_scale: np.ndarray  # [b] N
    clearance_per_turn: float  # m/rad
    clearance_scale: float  # N
    expansion: np.ndarray  # [b] m/K
    creep_compliance: np.ndarray  # [b, c] m/N
    creep_time: np.ndarray  # [c] s
    friction: np.ndarray  # [k] coefficient of a vertex, ratio of a fitting
    floor: np.ndarray  # [k] N
    drag: np.ndarray  # [k] N s/m
    share: np.ndarray  # [k] m
    asymmetry: float
    curvature_gain: float
    load_exponent: float
    load_reference: float
    load_is_normal: bool
    wear_gain: float
    wear_travel: float
    speed_law: tuple[float, float, float, float]
    speed_lag: float
    by_speed: bool
    straight: bool  # every law is a straight line, so that one pass is exact
    pretension: float
    slack: float  # m
    force_driven: bool
    weight: bool


def chain(path: Path, physics: Physics, distal: Distal, force_driven: bool) -> Chain:
    """Return the arrays of a run."""
    p, bars, share = physics, path.bars[0], path.shares
    rho = p.compliance_per_N
    rigid = RIGID * rho * bars.min()
    load = 1.0 / distal.stiffness_N_per_m if distal.kind == "spring" else 0.0
    return Chain(
        compliance=_ended(rho * bars, p.series_in_m_per_N + rigid, p.series_out_m_per_N + load + rigid),
        toe=_ended(p.toe_strain * bars, p.take_up_in_m, p.take_up_out_m),
        toe_scale=_ended(np.full_like(bars, p.toe_scale_N), p.take_up_in_scale_N, p.take_up_out_scale_N),
        clearance_per_turn=float(p.clearance_m),
        clearance_scale=float(p.clearance_scale_N),
        expansion=_ended(p.expansion_per_K * bars, 0.0, 0.0),
        creep_compliance=np.outer(_ended(rho * bars, 0.0, 0.0), np.array(p.creep_ratios, dtype=float)),
        creep_time=np.array(p.creep_times_s, dtype=float),
        friction=_ended(
            p.friction * np.interp(path.stations, p.profile_s_m, p.profile),
            p.fitting_in_ratio,
            p.fitting_out_ratio,
        ),
        floor=_ended(
            p.straight_friction_N_per_m * share, p.fitting_in_N, p.fitting_out_N + p.load_friction_N
        ),
        drag=_ended(p.viscous_drag_Ns_per_m2 * share, 0.0, 0.0),
        share=_ended(share, share[0], share[-1]),
        asymmetry=float(p.asymmetry),
        curvature_gain=float(p.curvature_gain_m),
        load_exponent=float(p.load_exponent),
        load_reference=float(p.load_reference),
        load_is_normal=p.load_measure == "normal",
        wear_gain=float(p.wear_gain),
        wear_travel=float(p.wear_travel_m),
        speed_law=tuple(
            map(float, (p.speed_gain, p.speed_reference_m_per_s, p.stribeck_gain, p.stribeck_speed_m_per_s))
        ),
        speed_lag=float(p.speed_lag_s),
        by_speed=_by_speed(p),
        straight=not (
            _by_speed(p)
            or p.load_exponent
            or p.toe_strain
            or p.clearance_m
            or p.take_up_in_m
            or p.take_up_out_m
        ),
        pretension=float(p.pretension_N),
        slack=float(p.slack_m),
        force_driven=force_driven,
        weight=distal.kind == "weight",
    )


def _by_speed(p: Physics) -> bool:
    return p.speed_gain != 0.0 or p.stribeck_gain != 0.0


def _ended(inner: np.ndarray, first: float, last: float) -> np.ndarray:
    return np.concatenate(([float(first)], inner, [float(last)]))
