"""Tuned numbers of the tendon: once for C, once for Python."""

import math
from typing import NamedTuple


class ProfileLimits(NamedTuple):
    """A tension profile as a list of corners."""

    slack: float
    """Stands for ln 0, so that every corner is finite [1]: far below the logarithm of the least float64."""
    slides: float
    """Of ln T on the slope of sliding [1]: the rounding of a corner, with room for that of bars."""
    most_log_tension: float
    """Stands for out of reach [1]: near the logarithm of the greatest float64."""


PROFILE = ProfileLimits(
    slack=3.0 * math.log(2.0**-1074), slides=2.0 ** (32 - 52), most_log_tension=math.log(2.0**1010)
)


class SolverTolerances(NamedTuple):
    """How exactly the balance of a chain of bars is solved."""

    accuracy: float = 1e-10
    """Residual that ends the iteration, of the greatest tension [1]; chosen: rounding, with room."""
    accepted: float = 1e-7
    """Largest residual of an equilibrium that is returned, and error of its tensions [N]; angle of a joint
    that a command may miss [rad]; chosen: below what any sensor resolves. Above 107 N it grows with the
    tension; docs/model.md (250). The last pass over curved laws moves no tension by a tenth of it."""
    trials: int = 80
    """Most trials in a search for one number, and passes over curved laws before a step is given up [1];
    derived: bisection alone would need some 60."""
    reach: float = 0.05
    """First step to where the force on a joint that turns over is the other way, then twice as far [rad];
    chosen: below the angle between the two rests of such a joint; (335)."""
    full_passes: int = 15
    """Passes that go all the way, the others half of it [1]; chosen."""
    speeds: float = 1e-5
    """How far the speeds at which friction that follows late is taken may be from those that it follows, over
    the highest of its table [1]; chosen: no joint turns by a hundredth of what sensors resolve; (313)."""
    speed_share: float = 10.0
    """Most that the secant adds of a difference of these speeds, and one over the least [1]; chosen: friction
    that falls lets go soon after."""
    motion: float = 1e-3
    """Weight of movement against force [1]; chosen: so small that contacts stop before they turn round."""
    rounds: int = 7
    """Rounds of relaxation, each four times as long as the one before [1]; chosen."""
    from_before: int = 6
    """Newton iterations from what slid last [1]; chosen: few steps need more."""
    from_guess: int = 10
    """Newton iterations from what would slide on a fixed route, and times that slack bars are marked anew
    before the movements are relaxed [1]; chosen."""


SOLVER = SolverTolerances()


class SweepTolerances(NamedTuple):
    """How exactly one sweep over the contacts of a fixed route finds a position."""

    close: float = 1e-14
    """Distance from a position that ends the search [m]; chosen: rounding of a metre, with room."""
    accepted: float = 1e-10
    """Greatest distance from a position that is returned [m]; chosen: an atom."""


SWEEP = SweepTolerances()


class BarLimits(NamedTuple):
    """Small numbers in the laws of bars and contacts, and in the march through a run."""

    least_load: float = 1e-3
    """Below this tension load-dependent friction depends on the load no more [N]; chosen."""
    turn: float = 2e-7
    """Path over which backlash opens when only the tension is known [m]; chosen: noise is less."""
    least_time: float = 1e-9
    """Shortest time of a step [s]; chosen."""
    untimed: float = 1.0
    """A step without a time, and the first one of a stream, is taken to last so long [s]; chosen."""


BAR = BarLimits()
