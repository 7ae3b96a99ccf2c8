"""Tension and elongation of a tendon on a route that moves under load, driven by force or by position.

Each step solves for the equilibrium that friction allows, from the state before it; docs/model.md (40)-(49).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from tssgeom.arrays import Vector, read_only
from tssgeom.errors import FitError, SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import Bed, MaterialState, lay
from tssgeom.tendon.bars.equilibrium import PATIENCE, equilibrium
from tssgeom.tendon.bars.fixed_route import range_of_drive
from tssgeom.tendon.capstan import check_tension

ACCEPTED = 1e-7
"""Largest residual of an equilibrium that is returned [N]."""
_ROUNDING = 1e-9  # of a drive that just holds a dead weight [1]
_FARTHEST = 1e6  # beyond it a position is taken for a mistake of units or of a sensor [m]
_LEAST_COMPLIANCE = 1e-9  # strain per tension below which rounding would be more than stretch


@dataclass(frozen=True, slots=True)
class Cone:
    """What friction allows: T[i+1] from T[i]·exp(−pulling) − force to T[i]·exp(releasing) + force."""

    pulling: Vector
    """[n+1] Exponent while the contact slides towards the proximal end, >= 0 [1]."""
    releasing: Vector
    """[n+1] Exponent while it slides towards the distal end, >= 0 [1]."""
    force: Vector
    """[n+1] Friction force whatever the tension, >= 0 [N]."""
    drag: Vector
    """[n+1] Friction force for each metre slid in the step, such as viscosity over time, >= 0 [N/m]."""


@dataclass(frozen=True, slots=True)
class Line:
    """The tendon and what it is tied to; no route."""

    compliance: Vector
    """[n] Strain per tension of each bar, 1/EA [1/N]."""
    pretension: float
    """Tension of the state from which elongation counts [N]."""
    load_stiffness: float
    """Spring that the distal end pulls against; 0 for a dead weight, inf for a fixed end [N/m]."""
    compliance_in: float = 0.0
    """Stretch per tension between the drive and the sheath [m/N]."""
    compliance_out: float = 0.0
    """Stretch per tension between the sheath and the load [m/N]."""
    stretches_with_route: bool = True
    """Whether a longer route is a longer path of the same tendon; False: only more of it lies in view."""


def line(rig: Rig, bars: int) -> Line:
    """Return the rig's tendon and load, without anything between the sheath and what it is tied to.

    Raises
    ------
    SettingsError
        Where the tendon does not stretch.
    """
    compliance = rig.tendon.compliance_per_N
    if compliance < _LEAST_COMPLIANCE:
        raise SettingsError(
            f"tendon.compliance_per_N is {compliance:g} 1/N: a tendon of bars has to stretch; "
            f"give at least {_LEAST_COMPLIANCE:g} 1/N"
        )
    return Line(read_only(np.full(bars, compliance)), rig.tendon.pretension_N, rig.load.stiffness_N_per_m)


def coulomb(bed: Bed, friction: float) -> Cone:
    """Return the cone of Coulomb friction with one coefficient [1]."""
    exponent, none = friction * bed.angle, np.zeros(len(bed.angle))  # docs/model.md (41)
    return Cone(exponent, exponent, none, none)


def step(
    state: MaterialState,
    arcs: Arcs,
    rig: Rig,
    *,
    tension_in: float | None = None,
    displacement_in: float | None = None,
) -> MaterialState:
    """Move the drive and the route at once, with the rig's tendon, load and Coulomb friction.

    Parameters
    ----------
    state
        Tension along the tendon before the step.
    arcs
        The route after the step.
    rig
        Tendon, friction and load.
    tension_in, displacement_in
        New total tension [N] or new position [m] of the drive; one of them.

    Raises
    ------
    SettingsError, FitError
        As `advance`.
    """
    bed = lay(state.edge, arcs)
    cone = coulomb(bed, rig.friction.coefficient)
    tendon = line(rig, len(bed.length))
    return advance(state, bed, cone, tendon, tension_in=tension_in, displacement_in=displacement_in)


def advance(
    state: MaterialState,
    bed: Bed,
    cone: Cone,
    tendon: Line,
    *,
    tension_in: float | None = None,
    displacement_in: float | None = None,
    eigenstrain: Vector | None = None,
) -> MaterialState:
    """Return the equilibrium nearest to `state` on the bed, inside the cone, with the drive where it is put.

    Parameters
    ----------
    state
        Tension along the tendon before the step.
    bed, cone
        Route and friction after the step.
    tendon
        Tendon and ends; bars as many as the bed has.
    tension_in, displacement_in
        New total tension [N] or new position [m] of the drive; one of them.
    eigenstrain
        [n] Strain that each bar gains in this step other than by tension, such as creep or heat [1].

    Raises
    ------
    SettingsError
        Where not exactly one drive is given, where it is negative or not finite, or out of balance with a
        dead weight.
    FitError
        Where no equilibrium was found.
    """
    drive, by_force = one_drive(tension_in, displacement_in)
    strain = np.zeros(len(bed.length)) if eigenstrain is None else eigenstrain
    return _equilibrium_at(state, bed, cone, tendon, drive, by_force, strain)


def _equilibrium_at(
    state: MaterialState, bed: Bed, cone: Cone, tendon: Line, drive: float, by_force: bool, strain: Vector
) -> MaterialState:
    amount = drive if by_force else drive - state.displacement_in
    ends = (float(tendon.load_stiffness), float(tendon.compliance_in), float(tendon.compliance_out))
    before = state.length if tendon.stretches_with_route else -1.0
    old = (state.tension, state.slack, state.inelastic)
    friction = (cone.pulling, cone.releasing, cone.force, cone.drag)
    hanging = tendon.load_stiffness == 0.0
    if by_force and hanging:
        _check_balance(drive, state.tension_out, cone)
    held = by_force and drive > 0.0
    tension, loose, gained, slip, whole, moved_in, moved_out, elongation, iterations, residual = _advanced(
        old,
        bed.length,
        before,
        tendon.compliance,
        strain,
        friction,
        ends,
        amount,
        by_force,
        hanging,
        state.slip,
        held,
        tendon.pretension,
    )
    if not residual <= ACCEPTED:
        raise FitError(
            f"no equilibrium of the tendon was found, {residual:.3g} N are left over: take smaller steps"
        )
    for array in (tension, loose, gained, slip):
        array.setflags(write=False)
    return MaterialState(
        edge=state.edge,
        tension=tension,
        slack=loose,
        inelastic=gained,
        slip=slip,
        length=whole,
        displacement_in=state.displacement_in + moved_in if by_force else drive,
        displacement_out=state.displacement_out + moved_out,
        elongation=elongation,
        direction_index=_direction(slip[0], moved_in if by_force else amount, state.direction_index),
        iterations=iterations,
    )


def one_drive(tension_in: float | None, displacement_in: float | None) -> tuple[float, bool]:
    """Return the drive of a step, and whether it is a tension [N] or else a position [m].

    Raises
    ------
    SettingsError
        Where not exactly one is given, or where it is negative or not finite.
    """
    by_force = displacement_in is None
    drive = tension_in if by_force else displacement_in
    if drive is None or (tension_in is not None and not by_force):
        raise SettingsError("a step needs one drive: give tension_in [N] or displacement_in [m], not both")
    if by_force:
        check_tension(drive)
    elif not abs(drive) <= _FARTHEST:
        raise SettingsError(f"displacement_in is {drive:g} m: give a finite position, and check its unit")
    return float(drive), by_force


def _check_balance(drive: float, weight: float, cone: Cone) -> None:
    least, most = range_of_drive(weight, np.exp(-cone.pulling), np.exp(cone.releasing), cone.force)
    if not least * (1 - _ROUNDING) <= drive <= most * (1 + _ROUNDING):
        raise SettingsError(
            f"tension_in is {drive:g} N: a dead weight of {weight:g} N would run away outside of "
            f"{least:.4g} to {most:.4g} N; drive by position, or give the load a stiffness"
        )


def _direction(slip: int, moved: float, before: int) -> int:
    if slip == 0 and moved == 0.0:
        return before
    return 1 if slip > 0 or (slip == 0 and moved > 0.0) else -1


@njit(cache=True, nogil=True, error_model="numpy")
def _advanced(
    old,
    length,
    length_before,
    compliance,
    strain,
    friction,
    ends,
    amount,
    by_force,
    hanging,
    before,
    held,
    pretension,
):
    """Return the bars after a step: tension, slack, inelastic length and slip; numbers; and the residual."""
    chain, gained, whole = _chain(
        old, length, length_before, compliance, strain, friction, ends, amount, by_force
    )
    w, tension, slip, iterations, residual = _solved(chain, hanging, before, held)
    loose, moved_in, moved_out, elongation = _moved(old, chain, gained, w, tension, ends, pretension)
    return tension, loose, gained, slip, whole, moved_in, moved_out, elongation, iterations, residual


@njit(cache=True, nogil=True, error_model="numpy")
def _solved(chain, hanging, before, held):
    """Return what `equilibrium` does, without solving where all hangs loose; `held` by a force it cannot."""
    if not (held or hanging or np.any(chain[4] > 0.0) or np.any(chain[5] > 0.0)):
        loose, w, tension, slip = _loose(chain)
        if loose:
            return w, tension, slip, 1, 0.0
    own = before.copy()  # it refuses writes, unlike those of other callers, for which all is compiled
    return equilibrium(chain, hanging, own, PATIENCE)


@njit(cache=True, nogil=True, error_model="numpy")
def _loose(chain):
    """Return whether the drive lets all tension go; and movements, tensions and slip for that case.

    No tension at one contact is none anywhere, so the tendon hangs loose as soon as its path is no longer
    than it is itself. Each contact moves as little as leaves every bar loose; docs/model.md (46a).
    """
    trial, stiffness, rigid, shift = chain[0], chain[1], chain[6], chain[7]
    n = trial.size - 2
    w, most = np.empty(n + 1), np.empty(n + 1)
    slip, tension = np.zeros(n + 1, dtype=np.int8), np.zeros(n + 2)
    most[n] = 0.0 if rigid[1] else -trial[n + 1] / stiffness[n + 1]
    for i in range(n, 0, -1):
        most[i - 1] = most[i] - trial[i] / stiffness[i]
    if (rigid[0] and shift > most[0]) or stiffness[0] > 0.0:
        return False, w, tension, slip
    least = shift if rigid[0] else -np.inf
    for i in range(n + 1):
        w[i] = min(max(least, 0.0), most[i])
        slip[i] = 1 if w[i] > 0.0 else -1 if w[i] < 0.0 else 0
        if i < n:
            least = w[i] + trial[i + 1] / stiffness[i + 1]
    return True, w, tension, slip


@njit(cache=True, nogil=True, error_model="numpy")
def _chain(old, length, length_before, compliance, strain, friction, ends, amount, by_force):
    """Return the chain of bars that `equilibrium` takes, and the inelastic length of each bar."""
    tension, slack, inelastic = old
    pulling, releasing, force, drag = friction
    load, series_in, series_out = ends
    n = length.size
    whole = np.sum(length)
    growth = 1.0 - length_before / whole if length_before > 0.0 else 0.0  # of the path under each bar
    stiffness, trial, gained = np.zeros(n + 2), tension.copy(), inelastic.copy()
    for j in range(n):
        stiffness[j + 1] = 1.0 / (compliance[j] * length[j])
        gained[j + 1] += strain[j] * length[j]
        stretched = (growth - strain[j]) * length[j] - slack[j + 1]
        trial[j + 1] += stiffness[j + 1] * stretched - growth * tension[j + 1]  # docs/model.md (40)
    rigid = (not by_force and series_in == 0.0, load == np.inf and series_out == 0.0)
    if by_force:
        trial[0] = amount
    elif not rigid[0]:
        stiffness[0] = 1.0 / series_in
        trial[0] += stiffness[0] * (amount - slack[0])
    if load > 0.0 and not rigid[1]:
        stiffness[n + 1] = 1.0 / (1.0 / load + series_out)
        trial[n + 1] -= stiffness[n + 1] * slack[n + 1]
    if rigid[0]:
        trial[0] += trial[1] - tension[1]  # docs/model.md (45)
    if rigid[1]:
        trial[n + 1] += trial[n] - tension[n]
    shift = amount - slack[0] if rigid[0] else 0.0
    return (trial, stiffness, np.exp(-pulling), np.exp(releasing), force, drag, rigid, shift), gained, whole


@njit(cache=True, nogil=True, error_model="numpy")
def _moved(old, chain, gained, w, new, ends, pretension):
    """Return the slack of each bar, the movement of both ends and the elongation in the sheath [m]."""
    tension, slack, _ = old
    trial, stiffness, _, _, _, _, rigid, shift = chain
    _, series_in, series_out = ends
    n = w.size - 1
    loose, elongation = np.zeros(n + 2), 0.0
    for j in range(n + 2):
        if stiffness[j] > 0.0 and new[j] <= 0.0:
            stretch = (w[j - 1] if j > 0 else 0.0) - (w[j] if j <= n else 0.0)
            loose[j] = max(-trial[j] / stiffness[j] - stretch, 0.0)
        if 0 < j <= n:
            elongation += (new[j] - pretension) / stiffness[j] - loose[j] + gained[j]  # docs/model.md (44)
    if rigid[0]:
        loose[0] = max(w[0] - shift, 0.0)
    moved_in = w[0] + series_in * (new[0] - tension[0]) + slack[0] - loose[0]
    moved_out = w[n] - series_out * (new[n + 1] - tension[n + 1]) + loose[n + 1] - slack[n + 1]
    return loose, moved_in, moved_out, elongation
