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
    """Constant friction; its last column, which has no contact, is that of the load alone [N]."""
    drag: int = 13
    """Friction per speed [N·s/m]."""
    creep_soft_2: int = 14
    """As `creep_soft`, of the second element [m/N]."""
    creep_soft_3: int = 15
    """Of the third [m/N]."""
    presliding: int = 16
    """Movement of a contact before it slides; 0 where none gives [m]."""


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
    creep_time_2: int = 15
    """Of the second element of creep [s]."""
    creep_time_3: int = 16
    """Of the third [s]."""
    speed_memory: int = 17
    """Time in which friction follows the speed [s]."""
    presliding_reference: int = 18
    """Tension at which contacts give by as much as their row of `presliding` has [N]."""
    curved: int = 19
    """Stretch is no straight line over tension."""
    by_rate: int = 20
    """Friction depends on the speed of sliding."""
    varied: int = 21
    """The cone depends on tension, travel or speed."""
    swift: int = 22
    """Nothing but the drive moves the tendon: one sweep gives the answer."""


PLANT = PlantNumbers()


class Tables(NamedTuple):
    """Tables that follow the numbers of `PlantNumbers`: laws that are curves and no formula.

    Each has the number of its points, 0 for none, then room for `TABLE.most` arguments, values and slopes.
    The numbers are derived: they count.
    """

    load: int = 0
    """Factor of friction [1] over the tension at the contact [N]."""
    speed: int = 1
    """Over the speed of the contact [m/s]."""
    travel: int = 2
    """Over the path that it has slid [m]."""
    time: int = 3
    """Over the time since the run began [s]."""
    position: int = 4
    """Over how far the tendon was pulled in [m]."""
    curvature: int = 5
    """Over the curvature of the route [1/m]."""
    arc: int = 6
    """Over the arc length [m]."""
    strain: int = 7
    """Stretch inside the sheath beyond the linear one, over the compliance [N], over tension [N]."""
    stretch_in: int = 8
    """Stretch between drive and sheath [m] over tension [N]."""
    stretch_out: int = 9
    """Between sheath and load."""
    load_path: int = 10
    """Movement of the load beyond its linear one [m] over tension [N]."""


CURVE = Tables()


class TableSize(NamedTuple):
    """Room of one table."""

    most: int = 12
    """Points [1]; chosen: more than any law has needed."""
    size: int = 37
    """Numbers of one table [1]; derived: one, and three for each point."""


TABLE = TableSize()


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
    """Path that each contact slid so far, either way [m]; in the last column, which has no contact, the
    tension before the friction of the load [N]."""
    slip: int = 6
    """What each contact did last: +1 slid on a pull, 0 stuck, −1 slid on a release."""
    creep_2: int = 7
    """As `creep`, of the second element [m]."""
    creep_3: int = 8
    """Of the third [m]."""


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
    time: int = 6
    """Since the run began [s]."""


HELD = DriveNumbers()
