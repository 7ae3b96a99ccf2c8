"""Tuned numbers of the tendon, and the rows of what it hands to the core: once for C, once for Python."""

from typing import NamedTuple


class ProfileLimits(NamedTuple):
    """A tension profile as a list of corners."""

    slack: float = -2000.0
    """Stands for ln 0, so that every corner is finite: exp(−2000) is zero in float64 [1]."""
    resolution: float = 1e-12
    """Differences of ln T that count as rounding and not as motion [1]; chosen."""
    slides: float = 1e-6
    """Of ln T on the slope of sliding [1]; derived: bars are solved to 1e-10, corners are within 1e-9."""
    series_below: float = 1e-2
    """Fall of ln T over a run below which its moment is better from the series [1]; chosen."""
    most_log_tension: float = 700.0
    """Beyond it float64 ends: 1e304 N stands for out of reach [1]."""


PROFILE = ProfileLimits()


class RouteComparison(NamedTuple):
    """When two sensed routes count as one that has not moved; at eight even shares of the length."""

    sigmas: float = 3.0
    """Standard errors of a difference that still count as noise [1]; chosen: 99.7 % of normal errors."""
    rounding: float = 1e-9
    """Difference of lengths [1] and angles [rad] that is rounding; chosen."""


SAME_ROUTE = RouteComparison()


class SolverTolerances(NamedTuple):
    """How exactly the balance of a chain of bars is solved."""

    accuracy: float = 1e-10
    """Residual that ends the iteration, of the greatest tension [1]; chosen: rounding, with room."""
    accepted: float = 1e-7
    """Largest residual of an equilibrium that is returned [N]; chosen: below what any sensor resolves."""
    converged: float = 1e-8
    """Greatest change of any tension in the last pass over curved laws [N]; chosen: a tenth of `accepted`."""
    passes: int = 90
    """Passes over curved laws before a step is given up [1]; chosen."""
    full_passes: int = 15
    """Passes that go all the way, the others half of it [1]; chosen."""
    dead_weight: float = 1e-9
    """Room at the ends of the range of drives that hold a dead weight [1]; chosen: rounding."""
    motion: float = 1e-3
    """Weight of movement against force [1]; chosen: so small that contacts stop before they turn round."""
    rounding: float = 2e-15
    """Residual that the solve itself leaves, of stiffness times movement [1]; derived: ten roundings."""
    markings: int = 10
    """Times that slack bars are marked anew before the movements are relaxed [1]; chosen."""
    rounds: int = 7
    """Rounds of relaxation, each four times as long as the one before [1]; chosen."""
    from_before: int = 6
    """Newton iterations from what slid last [1]; chosen: few steps need more."""
    from_guess: int = 10
    """Newton iterations from what would slide on a fixed route [1]; chosen."""
    secants: int = 40
    """Steps towards the proximal tension that belongs to a position on a fixed route [1]; chosen."""


SOLVER = SolverTolerances()


class SweepTolerances(NamedTuple):
    """How exactly one sweep over the contacts of a fixed route finds a position."""

    trials: int = 80
    """Tensions tried for a position [1]; derived: bisection alone would need some 60."""
    close: float = 1e-14
    """Distance from a position that ends the search [m]; chosen: rounding of a metre, with room."""
    accepted: float = 1e-10
    """Greatest distance from a position that is returned [m]; chosen: an atom."""
    load: float = 1e-7
    """Change of an exponent by the load that ends its iteration [1]; chosen: the next error is its square."""
    turns: int = 20
    """Most iterations of an exponent by the load [1]; chosen: Newton's method needs a few."""


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
    """A step without a time, and the first one of a stream, is taken to last so long [s]."""
    answers: float = 1e-7
    """Of the greater end's tension, or N: bars are balanced to so much [1]; chosen."""
    close: float = 1e-15
    """Of a tension in the search for the one before a contact [1]; chosen: rounding."""
    searches: int = 60
    """Most iterations of that search [1]; chosen."""
    straight: float = 1e-9
    """Exponent below which a contact does not show what friction does [1]; chosen."""


BAR = BarLimits()


class LawRows(NamedTuple):
    """Rows of the laws of b = k + 1 bars, and of the k contacts between them, whose last column is unused."""

    soft: int = 0
    """Stretch per tension [m/N]."""
    toe: int = 1
    """Stretch of the toe [m]."""
    toe_scale: int = 2
    """Scale of the toe [N]."""
    saved: int = 3
    """Path saved when taut [m]."""
    creep_soft: int = 4
    """Creep per tension in the end [m/N]."""
    warm: int = 5
    """Stretch by heat [m/K]."""
    rest: int = 6
    """Stretch under the pretension, before the run and on its first route [m]."""
    pulling: int = 7
    """Exponent of the cone on a pull, before load, wear and speed [1]."""
    releasing: int = 8
    """The same on a release [1]."""
    fitting: int = 9
    """Exponent whatever load, wear and speed [1]."""
    low: int = 10
    """exp(−pulling − fitting): least T[i+1] over T[i], where nothing changes it [1]."""
    high: int = 11
    """exp(releasing + fitting): greatest T[i+1] over T[i] [1]."""
    force: int = 12
    """Constant friction [N]."""
    drag: int = 13
    """Friction per speed [N·s/m]."""


LAW = LawRows()


class PlantNumbers(NamedTuple):
    """Numbers that follow the rows of `LawRows`; the last four are 0 or 1."""

    pretension: int = 0
    """[N]"""
    load: int = 1
    """Stiffness of the load: 0 a dead weight, inf a fixed end [N/m]."""
    saved_scale: int = 2
    """[N]"""
    clearance: int = 3
    """Path saved for each radian when taut [m/rad]."""
    creep_time: int = 4
    """[s]"""
    load_exponent: int = 5
    load_reference: int = 6
    """[N]"""
    wear_gain: int = 7
    wear_travel: int = 8
    """[m]"""
    speed_gain: int = 9
    speed_reference: int = 10
    """[m/s]"""
    backlash: int = 11
    """[m]"""
    friction: int = 12
    """Coulomb coefficient μ [1]."""
    asymmetry: int = 13
    """Share by which friction is greater on a pull and less on a release [1]."""
    curvature_gain: int = 14
    """[m]"""
    curved: int = 15
    """Stretch is no straight line over tension."""
    by_rate: int = 16
    """Friction depends on the speed of sliding."""
    varied: int = 17
    """The cone depends on tension, travel or speed."""
    swift: int = 18
    """Nothing but the drive moves the tendon: one sweep gives the answer."""


PLANT = PlantNumbers()


class MemoryRows(NamedTuple):
    """Rows of what one step leaves to the next, of b = k + 1 bars or of k contacts (last column unused)."""

    tension: int = 0
    """Of each bar [N]."""
    creep: int = 1
    """Of each bar [m]."""
    rest: int = 2
    """Stretch of each bar where no contact is displaced; 0 with effects [m]."""
    displacement: int = 3
    """Of each contact since the pretensioned state [m]."""
    speed: int = 4
    """Of each contact in the last step [m/s]."""
    travel: int = 5
    """Path that each contact slid so far, either way [m]."""
    slip: int = 6
    """What each contact did last: +1 slid on a pull, 0 stuck, −1 slid on a release."""


MEMORY = MemoryRows()


class DriveNumbers(NamedTuple):
    """Numbers that follow the rows of `MemoryRows`: what effects remember of the drive."""

    drive: int = 0
    """Last drive [N] or [m]."""
    warmth: int = 1
    """[K]"""
    engaged: int = 2
    """Position past the backlash [m]."""
    lag: int = 3
    """[m]"""
    shift: int = 4
    """[m]"""
    rate: int = 5
    """Of the drive [N/s] or [m/s]."""


HELD = DriveNumbers()
