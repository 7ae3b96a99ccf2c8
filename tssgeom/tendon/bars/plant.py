"""A setup laid on a route: the arrays that the march through a run reads.

Bars 1 … n lie in the sheath, bar 0 between drive and sheath, bar n + 1 between sheath and load, and the load.
Contacts 0 … n stand between neighbours. Source: docs/model.md (50)-(60).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Vector
from tssgeom.effects.setup import Setup
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import Bed, lay
from tssgeom.tendon.bars.laws import stretched

_GRADING = 1.5  # bars grow from the drive on, where fronts start
_FIRST = 0.1  # and the first is smaller still: what its contact holds, a position does not tell
_LEAST = 1e-9  # slack that is taken up leaves this much give, lest its law become a wall [m/N]


class Plant(NamedTuple):
    """What stays the same during a run; b = n + 2 bars, k = n + 1 contacts."""

    soft: np.ndarray  # [b] stretch per tension [m/N]
    toe: np.ndarray  # [b] stretch of the toe [m]
    toe_scale: np.ndarray  # [b] N
    gap: np.ndarray  # [b] path saved when taut [m]
    gap_scale: float  # N
    clearance: float  # path saved for each radian when taut [m/rad]
    creep_soft: np.ndarray  # [b] creep per tension in the end [m/N]
    creep_time: float  # s
    warm: np.ndarray  # [b] m/K
    rest: np.ndarray  # [b] stretch under the pretension, before the run and on its first route [m]
    pulling: np.ndarray  # [k] exponent of the cone, before load, wear and speed
    releasing: np.ndarray  # [k]
    fitting: np.ndarray  # [k] exponent whatever load, wear and speed
    low: np.ndarray  # [k] exp of the exponents, where nothing changes them
    high: np.ndarray  # [k]
    force: np.ndarray  # [k] N
    drag: np.ndarray  # [k] N·s/m
    load_exponent: float
    load_reference: float  # N
    wear_gain: float
    wear_travel: float  # m
    speed_gain: float
    speed_reference: float  # m/s
    backlash: float  # m
    pretension: float  # N
    load: float  # N/m
    curved: bool  # stretch is no straight line over tension
    by_rate: bool  # friction depends on the speed of sliding
    varied: bool  # the cone depends on tension, travel or speed
    swift: bool  # nothing but the drive moves the tendon: one sweep gives the answer


def edges(arcs: Arcs, bars: int) -> Vector:
    """Return where to cut the tendon, as fractions of its length, [bars + 1]; docs/model.md (63).

    Half of the bars go by length, half by angle, so that sharp bends get several.
    """
    s = np.concatenate(([0.0], np.cumsum(arcs.length)))
    phi = np.concatenate(([0.0], np.cumsum(arcs.angle)))
    s, phi = s / s[-1], phi / max(phi[-1], 1e-12)
    blend = (s + phi) / (s[-1] + phi[-1])
    cut = np.interp(np.linspace(0.0, 1.0, bars + 1) ** _GRADING, blend, s)
    cut[0], cut[-1] = 0.0, 1.0
    cut[1] *= _FIRST
    return cut


@njit(cache=True, nogil=True)
def bent(length, angle, bends):
    """Return lengths and angles of the pieces with hidden bends added; docs/model.md (60).

    `bends` [m, 3] holds the middle [m], the angle [rad] and the width [m] of each.
    """
    for i in range(bends.shape[0]):
        middle, extra, width = bends[i]
        end = np.concatenate((np.zeros(1), np.cumsum(length)))
        whole = end[-1]
        start = min(max(middle - 0.5 * width, 0.0), whole)
        stop = min(max(middle + 0.5 * width, 0.0), whole)
        if stop - start < 1e-9 * whole:
            start, stop = max(start - width, 0.0), min(stop + width, whole)
        knots = np.unique(np.concatenate((np.array([start, stop]), end)))
        phi = np.interp(knots, end, np.concatenate((np.zeros(1), np.cumsum(angle))))
        for k in range(knots.size):
            phi[k] += extra * min(max((knots[k] - start) / (stop - start), 0.0), 1.0)
        length, angle = np.diff(knots), np.diff(phi)
    return length, angle


def with_bends(setup: Setup, arcs: Arcs) -> Arcs:
    """Return the route as the tendon feels it, hidden bends included; docs/model.md (60)."""
    if not setup.bends:
        return arcs
    return Arcs.exact(*bent(arcs.length, arcs.angle, np.array(setup.bends)))


class _Sides(NamedTuple):
    """What a route makes of the contacts and of the paths that a taut tendon saves."""

    pulling: Vector  # [k] exponent of the cone
    releasing: Vector  # [k]
    low: Vector  # [k] exp of the exponents
    high: Vector  # [k]
    gap: Vector  # [b] m


def _sides(setup: Setup, arcs: Arcs, edge: Vector, bed: Bed, fitting: Vector) -> _Sides:
    pressed = bed.angle
    if setup.curvature_gain_m != 0.0:  # docs/model.md (53)
        factor = np.maximum(1.0 + setup.curvature_gain_m * arcs.kappa, 0.0)
        pressed = lay(edge, Arcs.exact(arcs.length, arcs.angle * factor)).angle
    base = setup.friction * pressed
    pulling, releasing = base * (1.0 + setup.asymmetry), base * (1.0 - setup.asymmetry)
    turn = _turns(edge, arcs) if setup.clearance_m_per_rad else np.zeros(len(bed.length))
    return _Sides(
        pulling,
        releasing,
        np.exp(-pulling - fitting),
        np.exp(releasing + fitting),
        _ended(setup.clearance_m_per_rad * turn, 0.0, 0.0),
    )


def moved_plant(held: Plant, setup: Setup, arcs: Arcs, edge: Vector) -> Plant:
    """Lay the tendon of a plant on another route: its bars keep their lengths, its contacts do not."""
    arcs = with_bends(setup, arcs)
    sides = _sides(setup, arcs, edge, lay(edge, arcs), held.fitting)
    return held._replace(**sides._asdict(), swift=False)


def plant(setup: Setup, arcs: Arcs, edge: Vector) -> Plant:
    """Lay tendon, friction and ends on a route, with bars cut at the fractions `edge`."""
    arcs = with_bends(setup, arcs)
    bed = lay(edge, arcs)
    k = len(bed.angle)
    fitting = _at_ends(k, setup.fitting_in_exponent, setup.fitting_out_exponent)
    force = setup.straight_friction_N_per_m * bed.span  # docs/model.md (54)
    force = force + _at_ends(k, setup.fitting_in_N, setup.fitting_out_N)
    sides = _sides(setup, arcs, edge, bed, fitting)
    rho_l = setup.compliance * bed.length
    load = 1.0 / setup.load_stiffness if setup.load_stiffness > 0.0 else 0.0
    by_speed = setup.speed_gain != 0.0
    soft = _ended(
        rho_l,
        max(setup.series_in_m_per_N, _LEAST if setup.take_up_in_m else 0.0),
        max(setup.series_out_m_per_N + load, _LEAST if setup.take_up_out_m else 0.0),
    )
    toe = _ended(setup.toe_strain * bed.length, setup.take_up_in_m, setup.take_up_out_m)
    toe_scale = _ended(
        np.full(len(rho_l), setup.toe_scale_N), setup.take_up_in_scale_N, setup.take_up_out_scale_N
    )
    gap_scale, pretension = float(setup.clearance_scale_N), float(setup.pretension)
    return Plant(
        soft=soft,
        toe=toe,
        toe_scale=toe_scale,
        gap=sides.gap,
        gap_scale=gap_scale,
        clearance=float(setup.clearance_m_per_rad),
        creep_soft=_ended(setup.creep_ratio * rho_l, 0.0, 0.0),
        creep_time=float(setup.creep_time_s),
        warm=_ended(setup.expansion_per_K * bed.length, 0.0, 0.0),
        rest=_rest(soft, toe, toe_scale, sides.gap, gap_scale, pretension),
        pulling=sides.pulling,
        releasing=sides.releasing,
        fitting=fitting,
        low=sides.low,
        high=sides.high,
        force=force,
        drag=setup.drag_Ns_per_m2 * bed.span,
        load_exponent=float(setup.load_exponent),
        load_reference=float(setup.load_reference_N),
        wear_gain=float(setup.wear_gain),
        wear_travel=float(setup.wear_travel_m),
        speed_gain=float(setup.speed_gain),
        speed_reference=float(setup.speed_reference_m_per_s),
        backlash=float(setup.backlash_m),
        pretension=pretension,
        load=float(setup.load_stiffness),
        curved=bool(
            setup.toe_strain or setup.take_up_in_m or setup.take_up_out_m or setup.clearance_m_per_rad
        ),
        by_rate=by_speed or setup.drag_Ns_per_m2 != 0.0,
        varied=bool(setup.load_exponent or setup.wear_gain or by_speed),
        swift=bool(
            setup.load_stiffness > 0.0
            and not (by_speed or setup.drag_Ns_per_m2 or setup.creep_ratio or setup.expansion_per_K)
        ),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _rest(soft, toe, toe_scale, gap, gap_scale, pretension):
    """Return the stretch of each bar under the pretension [m]; docs/model.md (50)."""
    rest = np.empty(soft.size)
    for j in range(soft.size):
        rest[j] = stretched(pretension, soft[j], toe[j], toe_scale[j], gap[j], gap_scale)[0]
    return rest


def _turns(edge: Vector, arcs: Arcs) -> Vector:
    """Curve angle under each bar [rad]."""
    s = np.concatenate(([0.0], np.cumsum(arcs.length)))
    phi = np.concatenate(([0.0], np.cumsum(arcs.angle)))
    return np.diff(np.interp(edge * s[-1], s, phi))


def _ended(inner: Vector, first: float, last: float) -> Vector:
    out = np.empty(len(inner) + 2)
    out[0], out[1:-1], out[-1] = first, inner, last
    return out


def _at_ends(count: int, first: float, last: float) -> Vector:
    out = np.zeros(count)
    out[0] += first
    out[-1] += last
    return out
