"""A tendon in cells as contact mechanics would write it: the reference of the times in `benchmarks.speed`.

Implicit finite volumes and Tresca's iteration: with the friction that each face can hold taken from the last
pass, who slides is found by an active set, from all faces sliding with the drive. It shares no code with
`tssgeom.tendon`; a face holds a coefficient times the mean of its two tensions, so that no exponential stands
anywhere. Compiled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from tssgeom.arrays import Vector

_TOLERANCE = 1e-10  # of the greatest tension
_PASSES = 4  # for each face, before a step is halved
_LEAST = 2.0**-12  # of a step


@dataclass(frozen=True, slots=True)
class Cells:
    """Tension in the cells, drive and load at both ends, and the faces between."""

    tension: Vector
    """[n+2] N."""
    turn: Vector
    """[n+1] Friction coefficient times the angle from the middle of one cell to that of the next [1]."""


@dataclass(frozen=True, slots=True)
class Rod:
    """What the cells are made of."""

    length: float
    """m."""
    compliance: float
    """Strain per tension [1/N]."""
    friction: float
    """Coulomb coefficient [1]."""
    pretension: float
    """N."""
    load_stiffness: float
    """N/m."""


def turns(rod: Rod, cells: int, length: Vector, angle: Vector) -> Vector:
    """Return μΔφ of each face [n+1] on a route of pieces of the given lengths [m] and angles [rad]."""
    middle = (np.arange(cells) + 0.5) / cells
    share = np.concatenate(([0.0], np.cumsum(length))) / length.sum()
    phi = np.interp(middle, share, np.concatenate(([0.0], np.cumsum(angle))))
    return rod.friction * np.diff(phi, prepend=0.0, append=angle.sum())


def at_rest(rod: Rod, turn: Vector) -> Cells:
    """Return the pretensioned tendon."""
    return Cells(np.full(len(turn) + 1, rod.pretension), turn)


def pulled(rod: Rod, state: Cells, turn: Vector, tension_in: float) -> Cells:
    """Return the equilibrium after one step of drive and route.

    Raises
    ------
    ArithmeticError
        Where none is found.
    """
    cells = len(turn) - 1
    stiffness = np.full(cells + 2, cells / (rod.compliance * rod.length))
    stiffness[0], stiffness[-1] = 0.0, rod.load_stiffness
    tension, parts = _pulled(state.tension, state.turn, turn, stiffness, tension_in)
    if parts == 0:
        raise ArithmeticError(f"no equilibrium of {cells} cells at {tension_in:g} N")
    return Cells(tension, turn)


def elongation(rod: Rod, state: Cells) -> float:
    """Return the elongation above the pretensioned state [m]."""
    return rod.compliance * rod.length * float(np.mean(state.tension[1:-1]) - rod.pretension)


@njit(cache=True, nogil=True, error_model="numpy")
def _pulled(tension, turn_before, turn_after, stiffness, drive):
    """Return tension and the number of parts the step was cut into; 0 where it failed."""
    done, part, parts = 0.0, 1.0, 0
    start = tension[0]
    while done < 1.0:
        goal = min(done + part, 1.0)
        turn = turn_before + goal * (turn_after - turn_before)
        found, new = _balanced(tension, turn, stiffness, start + goal * (drive - start))
        if found:
            tension, done, parts = new, goal, parts + 1
        else:
            part *= 0.5
            if part < _LEAST:
                return tension, 0
    return tension, parts


@njit(cache=True, nogil=True, error_model="numpy")
def _balanced(old, turn, stiffness, drive):
    """Guess who slides and how much friction each face holds, solve, and repeat until both stay."""
    faces = turn.size
    slides, w = np.full(faces, np.int8(np.sign(drive - old[0]))), np.zeros(faces)
    tension, force, limit = old.copy(), np.empty(faces), np.zeros(faces)
    tension[0] = drive
    for i in range(faces):
        force[i] = tension[i] - tension[i + 1]
    start = force.copy()
    enough = _TOLERANCE * max(drive, old.max())
    for _ in range(_PASSES * faces):
        worst, turned = 0.0, False
        for i in range(faces):
            new = max(0.5 * turn[i] * (tension[i] + tension[i + 1]), 0.0)
            worst, limit[i] = max(worst, abs(new - limit[i])), new
            side = slides[i]
            if side == 0:
                side = 1 if force[i] > new + enough else -1 if force[i] < -new - enough else 0
            elif w[i] * side < 0.0:
                side = 0
            turned |= side != slides[i]
            slides[i] = side
        if worst <= enough and not turned:
            return True, tension
        _moves(start, slides, limit, stiffness, w)
        for k in range(1, faces):
            tension[k] = old[k] + stiffness[k] * (w[k - 1] - w[k])
        tension[faces] = old[faces] + stiffness[faces] * w[faces - 1]
        for i in range(faces):
            force[i] = tension[i] - tension[i + 1]
    return False, tension


@njit(cache=True, nogil=True, error_model="numpy")
def _moves(start, slides, limit, stiffness, w):
    """Solve for the movements w [m] of the faces that slide, each at its limit, by elimination."""
    faces = w.size
    behind, last = np.empty(faces), 0.0
    for i in range(faces):
        w[i], behind[i] = 0.0, 0.0
        if slides[i] != 0:
            near = stiffness[i]
            diagonal = near + stiffness[i + 1] - (near * behind[i - 1] if i > 0 else 0.0)
            w[i] = (start[i] - slides[i] * limit[i] + near * last) / diagonal
            behind[i] = stiffness[i + 1] / diagonal
        last = w[i]
    for i in range(faces - 2, -1, -1):
        w[i] += behind[i] * w[i + 1]
