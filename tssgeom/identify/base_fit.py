"""The base fit: friction, compliance and the error model about them.

Source: docs/model.md (105), (106).
"""

from __future__ import annotations

from collections.abc import Sequence

from tssgeom.identify.noise_model import Errors, errors_of
from tssgeom.identify.problem import Fit, Point, Problem, refined
from tssgeom.identify.readings import Reading
from tssgeom.identify.stack import FINE, Stack, simulated, stacked
from tssgeom.identify.whitening import weighing
from tssgeom.rig import Rig

_ROUNDS = 2  # in which errors and estimates settle


def base_fit(readings: Sequence[Reading], rig: Rig) -> tuple[Problem, Errors, Fit]:
    """Fit friction and compliance to the runs; errors and bars are those of the last estimate."""
    stack = stacked(readings)
    at = Point(max(rig.friction.coefficient, 1e-3), rig.tendon.compliance_per_N)
    for _ in range(_ROUNDS - 1):
        at = refined(posed(stack, rig, at)[0], at).at
    problem, errors = posed(stack, rig, at)
    return problem, errors, refined(problem, at)


def posed(stack: Stack, rig: Rig, at: Point) -> tuple[Problem, Errors]:
    """Return the problem of some readings, with errors and the correction of bars about a model."""
    here = at.rig(rig)
    errors = errors_of(stack, here, at.effects)
    fine = simulated(stack, here, at.effects, bars=FINE) - simulated(stack, here, at.effects)
    return Problem(stack, weighing(errors), rig, stack.measured - fine), errors
