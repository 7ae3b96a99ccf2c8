"""Content of a Rerun recording, read back by Rerun's own reader."""

import subprocess
from pathlib import Path

import rerun_cli
from rerun.chunk import RrdReader


def columns(path: Path, entity: str, *, timed: bool, timeline: str = "time") -> dict[str, list]:
    """Columns of an entity's rows, without or with time."""
    values: dict[str, list] = {}
    for chunk in RrdReader(str(path)).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if (timeline in batch.schema.names) == timed:
            for name in batch.schema.names:
                values.setdefault(name, []).extend(batch.column(name).to_pylist())
    return values


def entities(path: Path) -> set[str]:
    chunks = RrdReader(str(path)).stream()
    return {str(chunk.entity_path) for chunk in chunks if not str(chunk.entity_path).startswith("/__")}


def timelines(path: Path) -> set[str]:
    return {name for chunk in RrdReader(str(path)).stream() for name in chunk.timeline_names}


def views(path: Path) -> list[str]:
    """Kinds of the views in the layout of a recording."""
    return _of_layout(path, "ViewBlueprint:class_identifier")


def axes(path: Path) -> list[list[float]]:
    """Lower and upper ends of the vertical axes that the layout of a recording fixes."""
    return _of_layout(path, "ScalarAxis:range")


def spans(path: Path) -> list[tuple[float, float]]:
    """First and last time [s] of the plots whose range the layout of a recording fixes."""
    ranges = _of_layout(path, "TimeAxis:view_range")
    return [(1e-9 * one["start"], 1e-9 * one["end"]) for one in ranges]


def _of_layout(path: Path, column: str) -> list:
    reader = RrdReader(str(path))
    values = list[object]()
    for entry in reader.blueprints():
        for chunk in reader.stream(store=entry):
            batch = chunk.to_record_batch()
            if column in batch.schema.names:
                values += [value for row in batch.column(column).to_pylist() for value in row or []]
    return values


def verify(path: Path) -> None:
    """Let Rerun itself check a recording."""
    binary = Path(rerun_cli.__file__).parent / "rerun"
    subprocess.run([binary, "rrd", "verify", path], check=True, capture_output=True)
