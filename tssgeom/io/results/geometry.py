"""Geometry as tables: sensed points, frames, pieces and nodes; every field has its unit and its meaning."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa

from tssgeom.channel_names import words_of
from tssgeom.io.formats.columns import AXES, BENDS, DIRECTIONS, MEASURED, POINT, TIME
from tssgeom.io.results.tables import SEGMENTS, field, part_of
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route
from tssgeom.stream import Frame, FrameResult, Rejected

Column: TypeAlias = tuple[str, str, Any]
"""Name with its unit, meaning, and values."""


def table_of(columns: Iterable[Column]) -> pa.Table:
    """Return a table of columns; the unit of a number is the end of its name, that of a count is 1."""
    fields, arrays = list[pa.Field](), list[pa.Array]()
    for name, meaning, values in columns:
        array = pa.array(values, from_pandas=True)  # NaN is null
        unit = "1" if name in DIRECTIONS else None
        fields.append(field(name, meaning, array.type, unit))
        arrays.append(array)
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def frames_table(items: Iterable[FrameResult | Rejected]) -> pa.Table:
    """Return the rows of some hundred frames as in `frames/NAME.parquet`, without the name of the input."""
    items = list(items)
    machines = [item.machine for item in items if isinstance(item, FrameResult) and item.machine is not None]
    of_machine = dict.fromkeys(name for machine in machines for name in machine.numbers)
    return pa.Table.from_batches([part_of("", items, 1, tuple(of_machine)).frames]).drop(["name"])


def segments_table(arcs: Arcs) -> pa.Table:
    """Return the pieces of one route as in `segments/NAME.parquet`, without input and frame."""
    values = (np.arange(len(arcs.length)), arcs.s_start, arcs.length, arcs.kappa, arcs.angle, arcs.angle_se)
    schema = pa.schema(list(SEGMENTS)[2:])
    return pa.Table.from_arrays([pa.array(column) for column in values], schema=schema)


def nodes_table(route: Route | None, profile: CurvatureProfile | None) -> pa.Table:
    """Return positions and curvature at the nodes of a route, as far as they are given."""
    columns = list[Column]()
    if route is not None:
        columns = [(f"{axis}_m", f"coordinate {axis}", route.position[:, k]) for k, axis in enumerate(AXES)]
        columns.insert(0, ("s_m", "arc length", route.s))
    elif profile is not None:
        columns = [("s_m", "arc length", profile.s)]
    if profile is not None:
        columns += [
            ("kappa_per_m", "curvature", profile.kappa),
            ("kappa_se_per_m", "standard error of the curvature", profile.kappa_se),
            ("angle_rad", "accumulated curve angle", profile.phi),
            ("angle_se_rad", "standard error of the accumulated curve angle", profile.phi_se),
        ]
    return table_of(columns)


def points_table(frames: Iterable[Frame | Rejected], *, timed: bool) -> pa.Table:
    """Return sensed points as they are read from a table, a row for each; rejected frames are left out."""
    usable = [frame for frame in frames if isinstance(frame, Frame)]
    counts = [len(frame.points) for frame in usable]
    columns = list[Column]()
    if timed:
        columns.append((TIME, "time of the frame", np.repeat([frame.time for frame in usable], counts)))
    numbers = [np.arange(count) for count in counts]
    columns.append(
        (POINT, "number of the point in its frame, from 0", np.concatenate([np.zeros(0, int), *numbers]))
    )
    if any(frame.curvatures is not None for frame in usable):
        bends = [_rows(frame.curvatures, len(frame.points), 2) for frame in usable]
        for name, values in zip(BENDS, np.concatenate(bends).T, strict=True):
            columns.append((f"{name}_per_m", f"curvature towards {name[-1]}", values))
    else:
        points = np.concatenate([np.zeros((0, 3)), *(frame.points for frame in usable)])
        columns += [(f"{axis}_m", f"coordinate {axis}", points[:, k]) for k, axis in enumerate(AXES)]
    if any(frame.stations is not None for frame in usable):
        stations = [_rows(frame.stations, len(frame.points), 1) for frame in usable]
        columns.append(("s_m", "known arc length of the point", np.concatenate(stations)[:, 0]))
    if any(frame.directions is not None for frame in usable):
        tangents = np.concatenate([_rows(frame.directions, len(frame.points), 3) for frame in usable])
        columns += [
            (name, f"sensed unit tangent, {name[-1]}", tangents[:, k]) for k, name in enumerate(DIRECTIONS)
        ]
    for name, (attribute, per_si) in MEASURED.items():
        given = [getattr(frame, attribute) for frame in usable]
        if per_si == 1.0 and any(value is not None for value in given):
            values = [np.nan if value is None else value for value in given]
            columns.append((name, f"{attribute.replace('_', ' ')} of the frame", np.repeat(values, counts)))
    for name in sorted({name for frame in usable for name in frame.of_machine or ()}):
        values = [(frame.of_machine or {}).get(name, np.nan) for frame in usable]
        columns.append((name, f"{words_of(name)} of the frame", np.repeat(values, counts)))
    return table_of(columns)


def _rows(values: np.ndarray | None, count: int, width: int) -> np.ndarray:
    """Return values as rows, NaN where a frame has none."""
    return np.full((count, width), np.nan) if values is None else np.reshape(values, (count, width))
