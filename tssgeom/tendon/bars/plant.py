"""The laws of bars and contacts, and a rig with effects as the arrays that these laws read.

Bars 1 … n lie in the sheath, bar 0 between drive and sheath, bar n + 1 between sheath and load, and the load.
Contacts 0 … n stand between neighbours. Source: docs/model.md (50)-(60).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Vector
from tssgeom.effects.kinds import Setup
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import ContactGrid, discretise, with_bends

LEAST_LOAD = 1e-3
"""Below this tension load-dependent friction depends on the load no more [N]."""
_LEAST = 1e-9  # slack that is taken up leaves this much give, lest its law become a wall [m/N]


class Plant(NamedTuple):
    """What stays the same during a run; b = n + 2 bars, k = n + 1 contacts."""

    soft: np.ndarray  # [b] stretch per tension [m/N]
    toe: np.ndarray  # [b] stretch of the toe [m]
    toe_scale: np.ndarray  # [b] N
    saved: np.ndarray  # [b] path saved when taut [m]
    saved_scale: float  # N
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


class Memory(NamedTuple):
    """What one sample leaves to the next, b bars and k contacts; each step writes into these arrays."""

    tension: np.ndarray  # [b] N
    displacement: np.ndarray  # [k] displacement of each contact since the pretensioned state [m]
    speed: np.ndarray  # [k] of the last step [m/s]
    travel: np.ndarray  # [k] path slid so far, either way [m]
    creep: np.ndarray  # [b] m
    slip: np.ndarray  # [k] int8: +1 slid on a pull, 0 stuck, −1 slid on a release
    drive: np.ndarray
    """[6] last drive [N or m], warmth [K], position past the backlash [m], lag [m], lead [m], rate [m/s]"""


@njit(cache=True, nogil=True, error_model="numpy")
def stretched(tension, soft, toe, toe_scale, saved, saved_scale):
    """Return stretch [m] of a taut bar and its slope [m/N]; docs/model.md (50)."""
    stretch, slope = soft * tension, soft
    if toe != 0.0:
        rest = math.exp(-tension / toe_scale)
        stretch += toe * (1.0 - rest)
        slope += toe * rest / toe_scale
    if saved != 0.0:
        rest = math.exp(-tension / saved_scale)
        stretch += saved * (1.0 - rest)
        slope += saved * rest / saved_scale
    return stretch, slope


@njit(cache=True, nogil=True, error_model="numpy")
def stretch_of(plant, j, tension):
    """Return the stretch of bar j [m]; docs/model.md (50)."""
    soft, toe, toe_scale = plant.soft[j], plant.toe[j], plant.toe_scale[j]
    return stretched(tension, soft, toe, toe_scale, plant.saved[j], plant.saved_scale)[0]


@njit(cache=True, nogil=True, error_model="numpy")
def load_factor(load, exponent, reference):
    """Return what the tension at a contact makes of the friction there [1]; docs/model.md (52)."""
    if exponent == 0.0:
        return 1.0
    return math.exp(exponent * math.log(max(load, LEAST_LOAD) / reference))


@njit(cache=True, nogil=True, error_model="numpy")
def worn(plant, travel, pulling, releasing):
    """Set the exponents of the cone after wear by the travel so far; docs/model.md (52)."""
    for i in range(travel.size):
        factor = 1.0 - plant.wear_gain * math.expm1(-travel[i] / plant.wear_travel)
        pulling[i], releasing[i] = plant.pulling[i] * factor, plant.releasing[i] * factor


@njit(cache=True, nogil=True, error_model="numpy")
def creep_weights(x):
    """Return weights of old creep, old and new tension after x time constants; docs/model.md (57)."""
    kept = math.exp(-x)
    mean = -math.expm1(-x) / x
    return kept, mean - kept, 1.0 - mean


class _Sides(NamedTuple):
    """What a route makes of the contacts and of the paths that a taut tendon saves."""

    pulling: Vector  # [k] exponent of the cone
    releasing: Vector  # [k]
    low: Vector  # [k] exp of the exponents
    high: Vector  # [k]
    saved: Vector  # [b] m


def _sides(setup: Setup, arcs: Arcs, edge: Vector, grid: ContactGrid, fitting: Vector) -> _Sides:
    pressed = grid.angle
    if setup.curvature_gain_m != 0.0:  # docs/model.md (53)
        factor = np.maximum(1.0 + setup.curvature_gain_m * arcs.kappa, 0.0)
        pressed = discretise(edge, Arcs.exact(arcs.length, arcs.angle * factor)).angle
    base = setup.friction * pressed
    pulling, releasing = base * (1.0 + setup.asymmetry), base * (1.0 - setup.asymmetry)
    turn = _turns(edge, arcs) if setup.clearance_m_per_rad else np.zeros(len(grid.length))
    return _Sides(
        pulling,
        releasing,
        np.exp(-pulling - fitting),
        np.exp(releasing + fitting),
        _ended(setup.clearance_m_per_rad * turn, 0.0, 0.0),
    )


def moved_plant(held: Plant, setup: Setup, arcs: Arcs, edge: Vector) -> Plant:
    """Return the plant on another route: its bars keep their lengths, its contacts do not."""
    arcs = with_bends(setup, arcs)
    sides = _sides(setup, arcs, edge, discretise(edge, arcs), held.fitting)
    return held._replace(**sides._asdict(), swift=False)


def plant(setup: Setup, arcs: Arcs, edge: Vector) -> Plant:
    """Return tendon, friction and ends on a route, with bars cut at the fractions `edge`."""
    arcs = with_bends(setup, arcs)
    grid = discretise(edge, arcs)
    k = len(grid.angle)
    fitting = _at_ends(k, setup.fitting_in_exponent, setup.fitting_out_exponent)
    force = setup.straight_friction_N_per_m * grid.span  # docs/model.md (54)
    force = force + _at_ends(k, setup.fitting_in_N, setup.fitting_out_N)
    sides = _sides(setup, arcs, edge, grid, fitting)
    rho_l = setup.compliance * grid.length
    load = 1.0 / setup.load_stiffness if setup.load_stiffness > 0.0 else 0.0
    by_speed = setup.speed_gain != 0.0
    soft = _ended(
        rho_l,
        max(setup.series_in_m_per_N, _LEAST if setup.take_up_in_m else 0.0),
        max(setup.series_out_m_per_N + load, _LEAST if setup.take_up_out_m else 0.0),
    )
    toe = _ended(setup.toe_strain * grid.length, setup.take_up_in_m, setup.take_up_out_m)
    toe_scale = _ended(
        np.full(len(rho_l), setup.toe_scale_N), setup.take_up_in_scale_N, setup.take_up_out_scale_N
    )
    saved_scale, pretension = float(setup.clearance_scale_N), float(setup.pretension)
    return Plant(
        soft=soft,
        toe=toe,
        toe_scale=toe_scale,
        saved=sides.saved,
        saved_scale=saved_scale,
        clearance=float(setup.clearance_m_per_rad),
        creep_soft=_ended(setup.creep_ratio * rho_l, 0.0, 0.0),
        creep_time=float(setup.creep_time_s),
        warm=_ended(setup.expansion_per_K * grid.length, 0.0, 0.0),
        rest=_rest(soft, toe, toe_scale, sides.saved, saved_scale, pretension),
        pulling=sides.pulling,
        releasing=sides.releasing,
        fitting=fitting,
        low=sides.low,
        high=sides.high,
        force=force,
        drag=setup.drag_Ns_per_m2 * grid.span,
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
def _rest(soft, toe, toe_scale, saved, saved_scale, pretension):
    """Return the stretch of each bar under the pretension [m]; docs/model.md (50)."""
    rest = np.empty(soft.size)
    for j in range(soft.size):
        rest[j] = stretched(pretension, soft[j], toe[j], toe_scale[j], saved[j], saved_scale)[0]
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
