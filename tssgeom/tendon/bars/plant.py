"""The laws of bars and contacts of a rig with effects on a route, and what they remember.

Bars 1 … n lie in the sheath, bar 0 between drive and sheath, bar n + 1 between sheath and load, and the load.
Contacts 0 … n stand between neighbours. Source: docs/model.md (50)-(60).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants_tendon_rows import CURVE, HELD, LAW, MEMORY, PLANT, TABLE
from tssgeom.effects.kinds import Setup
from tssgeom.effects.laws import table
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of, discretise, with_bends

_TABLES = TABLE.size * len(CURVE)  # numbers at the end of a plant
_AFTER = len(PLANT) + _TABLES
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # derived: any few neighbours have shares that are spread evenly
_PASSES = 30  # of Newton; derived: from the bend it takes a pass for each 1, and no quantile is above 20
_LEAST = 1e-9  # slack that is taken up leaves this much give, lest its law become a wall [m/N]


class Plant(NamedTuple):
    """What stays the same during a run, of b bars and b − 1 contacts."""

    block: Vector
    """[16·b + 431] Rows of `LawRows`, each b long, numbers of `PlantNumbers`, tables of `Tables`."""

    @property
    def rows(self) -> Matrix:
        """[16, b] The rows of `LawRows`; in those of contacts the last column is unused."""
        return self.block[:-_AFTER].reshape(len(LAW), -1)

    def number(self, which: int) -> float:
        """Return one of the numbers of `PlantNumbers`."""
        return float(self.block[which - _AFTER])

    def set(self, which: int, value: float) -> None:
        """Set one of the numbers of `PlantNumbers`."""
        self.block[which - _AFTER] = value

    @property
    def tables(self) -> Matrix:
        """[tables, numbers] The laws that are curves, in the order of `Tables`."""
        return self.block[-_TABLES:].reshape(len(CURVE), TABLE.size)

    def stretch(self, tension: Vector | float) -> Vector:
        """Return the stretch [b] of taut bars [m] under tensions [b] [N]; docs/model.md (50)."""
        rows = self.rows
        if not self.number(PLANT.curved):
            return rows[LAW.soft] * tension
        toe, scale = rows[LAW.toe], np.where(rows[LAW.toe] == 0.0, 1.0, rows[LAW.toe_scale])
        stretch = rows[LAW.soft] * tension + toe * (1.0 - np.exp(-tension / scale)) + self._curved(tension)
        return stretch + rows[LAW.saved] * (1.0 - np.exp(-tension / self.number(PLANT.saved_scale)))

    def _curved(self, tension: Vector | float) -> Vector:
        """Return the stretch by tables [b] [m]; docs/model.md (186)."""
        pull = np.broadcast_to(np.asarray(tension, dtype=np.float64), self.rows.shape[1:])
        out = np.zeros(len(pull))
        inside, scale = slice(1, -1), self.rows[LAW.soft][1:-1]
        for which, bars, factor in (
            (CURVE.strain, inside, scale),
            (CURVE.stretch_in, slice(0, 1), 1.0),
            (CURVE.stretch_out, slice(-1, None), 1.0),
            (CURVE.load_path, slice(-1, None), 1.0),
        ):
            if self.tables[which, 0]:
                out[bars] += factor * core.tabulated(self.tables[which], np.ascontiguousarray(pull[bars]))
        return out


class Memory(NamedTuple):
    """What one sample leaves to the next, of b bars and b − 1 contacts."""

    block: Vector
    """[9·b + 7] The rows of `MemoryRows`, each b long, then the numbers of `DriveNumbers`."""

    def _row(self, row: int, contacts: bool) -> Vector:
        bars = (len(self.block) - len(HELD)) // len(MEMORY)
        return self.block[row * bars : (row + 1) * bars - contacts]

    @property
    def tension(self) -> Vector:
        """[b] Tension of each bar [N]."""
        return self._row(MEMORY.tension, False)

    @property
    def creep(self) -> Vector:
        """[b] Creep of each bar [m]."""
        return self._row(MEMORY.creep, False)

    @property
    def creep_2(self) -> Vector:
        """[b] Of the second element [m]."""
        return self._row(MEMORY.creep_2, False)

    @property
    def creep_3(self) -> Vector:
        """[b] Of the third [m]."""
        return self._row(MEMORY.creep_3, False)

    @property
    def rest(self) -> Vector:
        """[b] Stretch of each bar without effects where no contact is displaced [m]."""
        return self._row(MEMORY.rest, False)

    @property
    def displacement(self) -> Vector:
        """[b−1] Displacement of each contact since the pretensioned state [m]."""
        return self._row(MEMORY.displacement, True)

    @property
    def speed(self) -> Vector:
        """[b−1] Speed of each contact in the last step [m/s]."""
        return self._row(MEMORY.speed, True)

    @property
    def travel(self) -> Vector:
        """[b−1] Path that each contact slid so far, either way [m]."""
        return self._row(MEMORY.travel, True)

    @property
    def before_load(self) -> float:
        """Tension before the friction of the load [N]."""
        return float(self._row(MEMORY.travel, False)[-1])

    @property
    def slip(self) -> NDArray[np.int8]:
        """[b−1] What each contact did last: +1 slid on a pull, 0 stuck, −1 slid on a release."""
        signs = self._row(MEMORY.slip, True).astype(np.int8)
        signs.setflags(write=False)
        return signs

    @property
    def drive(self) -> Vector:
        """[7] The numbers of `DriveNumbers`."""
        return self.block[-len(HELD) :]


def crept(of: Plant, tension: Vector | float) -> dict[str, Vector]:
    """Return the creep [b] of each element in the end under tensions [b] [N], by the rows of a memory [m]."""
    names = ("creep", "creep_2", "creep_3")
    rows = (LAW.creep_soft, LAW.creep_soft_2, LAW.creep_soft_3)
    return {name: of.rows[row] * tension for name, row in zip(names, rows, strict=True)}


def memory_of(tension: Vector, **rows: Vector) -> Memory:
    """Return a memory of the tensions [b] [N] and of other rows by name; what is left out is 0.

    No friction of the load acts.
    """
    memory = Memory(np.zeros(len(MEMORY) * len(tension) + len(HELD)))
    memory.block[(MEMORY.travel + 1) * len(tension) - 1] = tension[-1]
    for name, values in ({"tension": tension} | rows).items():
        if name == "drive":
            memory.drive[:] = values
        else:
            start = getattr(MEMORY, name) * len(tension)
            memory.block[start : start + len(values)] = values
    return memory


def moved_plant(held: Plant, setup: Setup, arcs: Arcs, edge: Vector) -> Plant:
    """Return the plant on another route: its bars keep their lengths, its contacts do not."""
    fresh = core.plant_on_route(edge, held.block, arcs.length, arcs.angle, bends_of(setup))
    result = Plant(fresh)
    result.set(PLANT.swift, 0.0)
    return result


def plant(setup: Setup, arcs: Arcs, edge: Vector) -> Plant:
    """Return tendon, friction and ends on a route, with bars cut at the fractions `edge`."""
    grid, bars = discretise(edge, with_bends(setup, arcs)), len(edge) + 1
    block = np.zeros(len(LAW) * bars + _AFTER)
    block[-_AFTER:-_TABLES] = _numbers(setup)
    rows, curves = Plant(block).rows, _tables(setup, Plant(block).tables)
    load = 1.0 / setup.load_stiffness if setup.load_stiffness > 0.0 else 0.0
    gives_in = setup.take_up_in_m or CURVE.stretch_in in curves
    gives_out = setup.take_up_out_m or curves & {CURVE.stretch_out, CURVE.load_path}
    first = max(setup.series_in_m_per_N, _LEAST if gives_in else 0.0)
    last = max(setup.series_out_m_per_N + load, _LEAST if gives_out else 0.0)
    more = (*(ratio for ratio, _ in setup.more_creep), 0.0, 0.0)
    for row, values, in_front, behind in (
        (LAW.soft, setup.compliance * grid.length, first, last),
        (LAW.toe, setup.toe_strain * grid.length, setup.take_up_in_m, setup.take_up_out_m),
        (LAW.toe_scale, setup.toe_scale_N, setup.take_up_in_scale_N, setup.take_up_out_scale_N),
        (LAW.creep_soft, setup.creep_ratio * (setup.compliance * grid.length), 0.0, 0.0),
        (LAW.creep_soft_2, more[0] * (setup.compliance * grid.length), 0.0, 0.0),
        (LAW.creep_soft_3, more[1] * (setup.compliance * grid.length), 0.0, 0.0),
        (LAW.warm, setup.expansion_per_K * grid.length, 0.0, 0.0),
    ):
        rows[row, 1:-1], rows[row, 0], rows[row, -1] = values, in_front, behind
    rows[LAW.force, :-1] = setup.straight_friction_N_per_m * grid.span  # docs/model.md (54)
    rows[LAW.drag, :-1] = setup.drag_Ns_per_m2 * grid.span
    if setup.presliding_m:
        rows[LAW.presliding, :-1] = setup.presliding_m * breakaways(bars - 1, setup.presliding_law)
    for row, at_drive, at_load in (
        (LAW.force, setup.fitting_in_N, setup.fitting_out_N),
        (LAW.fitting, setup.fitting_in_exponent, setup.fitting_out_exponent),
    ):
        rows[row, 0] += at_drive
        rows[row, -2] += at_load
    rows[LAW.force, -1] = load_friction(setup)
    rows[LAW.force, -2] += rows[LAW.force, -1]
    result = Plant(core.plant_on_route(edge, block, arcs.length, arcs.angle, bends_of(setup)))
    result.rows[LAW.rest] = result.stretch(float(setup.pretension))
    return result


def load_friction(setup: Setup) -> float:
    """Return the friction of the load [N]; one that is held fast has none. Source: docs/model.md (333)."""
    return setup.load_friction_N if setup.load_stiffness < math.inf else 0.0


def breakaways(count: int, law: str) -> Vector:
    """Return how far each contact gives before it slides, over `distance_m` [count] [1]; docs/model.md (323).

    By Dahl's law neighbours differ: each has another quantile of x e^−x, in the order of the golden ratio.
    """
    if law == "prandtl":
        return np.ones(count)
    share = (np.arange(count) + 0.5) * _GOLDEN % 1.0
    x = np.full(count, 1.0)
    for _ in range(_PASSES):  # 1 − (1 + x) e^−x = share, from its bend
        x += (share - 1.0 + (1.0 + x) * np.exp(-x)) / (x * np.exp(-x))
    return x


def _tables(setup: Setup, tables: Matrix) -> set[int]:
    """Write the laws that are curves into the tables of a plant, and return which there are."""
    given = set()
    for curve in setup.curves:
        if curve.table in CURVE._fields:
            which = CURVE._fields.index(curve.table)
            tables[which] = table(curve)
            given.add(which)
    return given


_OF_STRETCH = {"strain", "stretch_in", "stretch_out", "load_path"}
_OF_CONTACTS = {"load", "speed", "travel", "time", "position"}
_BY_ITSELF = {"travel", "time", "position"}  # friction that may fall where a contact stands


def _numbers(setup: Setup) -> list[float]:
    """Return the numbers of `PlantNumbers`, in their order."""
    tables = {curve.table for curve in setup.curves}
    by_speed = setup.speed_gain != 0.0 or "speed" in tables
    curved = setup.toe_strain or setup.take_up_in_m or setup.take_up_out_m or setup.clearance_m_per_rad
    curved = curved or tables & _OF_STRETCH
    times = (*(time for _, time in setup.more_creep), 0.0, 0.0)
    by_rate = by_speed or setup.drag_Ns_per_m2 != 0.0
    moved = setup.creep_ratio or setup.expansion_per_K or setup.wear_gain < 0.0 or tables & _BY_ITSELF
    alone = not (by_rate or moved or setup.presliding_m)
    numbers = {
        "pretension": setup.pretension,
        "load": setup.load_stiffness,
        "saved_scale": setup.clearance_scale_N,
        "clearance": setup.clearance_m_per_rad,
        "creep_time": setup.creep_time_s,
        "load_exponent": setup.load_exponent,
        "load_reference": setup.load_reference_N,
        "wear_gain": setup.wear_gain,
        "wear_travel": setup.wear_travel_m,
        "speed_gain": setup.speed_gain,
        "speed_reference": setup.speed_reference_m_per_s,
        "speed_memory": setup.speed_memory_s,
        "backlash": setup.backlash_m,
        "friction": setup.friction,
        "asymmetry": setup.asymmetry,
        "curvature_gain": setup.curvature_gain_m,
        "creep_time_2": times[0],
        "creep_time_3": times[1],
        "presliding_reference": setup.presliding_reference_N,
        "curved": bool(curved),
        "by_rate": by_rate,
        "varied": bool(setup.load_exponent or setup.wear_gain or by_speed or tables & _OF_CONTACTS),
        "swift": setup.load_stiffness > 0.0 and alone,
    }
    return [float(numbers[name]) for name in PLANT._fields]
