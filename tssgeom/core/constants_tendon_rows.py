"""Where the numbers of a plant and of a memory lie in what the core takes: once for C, once for Python."""

from typing import NamedTuple


class LawRows(NamedTuple):
    """Rows of the laws of b = k + 1 bars, and of the k contacts between them, whose last column is unused.

    The numbers are derived: they count the rows.
    """

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
    """Numbers that follow the rows of `LawRows`; the last four are 0 or 1. Derived: they count."""

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
    """Rows of what one step leaves to the next, of b = k + 1 bars or of k contacts (last column unused).

    The numbers are derived: they count the rows.
    """

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
    """Numbers that follow the rows of `MemoryRows`: what effects keep of the drive. Derived: they count."""

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
