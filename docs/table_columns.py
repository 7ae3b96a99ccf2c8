"""The page of the columns of tables."""

from collections.abc import Iterator
from typing import Any

from docstrings import cell, wrapped

from tssgeom.io.results import exports, followed, tables


def page() -> Iterator[str]:
    """Yield the parts of the page."""
    yield "# Columns of the tables\n\n"
    text = (
        "What commands write as Parquet, or as CSV where the name of the file ends so. Each field of a "
        "Parquet file has its unit and its meaning as metadata too. "
        "[formats.md](../formats.md#what-batch-writes) describes the files. Tables of a machine have a "
        "column for each [channel](../machines.md#channels); `paper.csv` has the keys of "
        "[JSON](json.md#paper-json)."
    )
    yield f"{wrapped(text)}\n"
    for file, schema, row in (
        ("summary.parquet", tables.SUMMARY, "A row for each input."),
        ("frames/NAME.parquet", tables.FRAMES, "A row for each frame."),
        (
            "segments/NAME.parquet",
            tables.SEGMENTS,
            "A row for each piece of constant curvature of each good frame.",
        ),
        (
            "simulate.parquet",
            _with_reading(tables.SIMULATE, "CHANNEL", "the channel as its sensor reads it"),
            "A row for each row of the run. Columns that begin with `read_` are written where effects of the "
            "rig distort sensors.",
        ),
        (
            "compensate.parquet",
            tables.COMPENSATE.append(tables.READING),
            "A row for each row of the run. The last column is written where effects of the rig distort it.",
        ),
        ("adapt.parquet", followed.FOLLOWED, "A row for each row of the run."),
        ("adapt_numbers.parquet", _numbers(), "A row for each of some thousand times of the run."),
        ("adapt_alerts.parquet", followed.ALERTS, "A row for each disagreement."),
        ("NAME_tension.csv", _exported(), "What `analyse --export csv` writes: a row for each node."),
    ):
        yield f"\n## {file}\n\n{wrapped(row)}\n\n| column | type | unit | meaning |\n|---|---|---|---|\n"
        for field in schema:
            unit, meaning = (field.metadata[key].decode() for key in (b"unit", b"meaning"))
            yield f"| `{field.name}` | {field.type} | {unit} | {cell(meaning)} |\n"


def _with_reading(schema: Any, name: str, meaning: str) -> Any:
    return schema.append(tables.field(f"read_{name}", meaning, unit="that of the channel"))


def _numbers() -> list[Any]:
    endings = followed.NUMBERS.items()
    each = [tables.field(f"KEY_{ending}", meaning, unit="that of the key") for ending, meaning in endings]
    return [tables.field("time_s", "time of the run"), *each]


def _exported() -> list[Any]:
    axes = [("s", "arc length"), *((axis, "position of the node") for axis in "xyz")]
    first = [tables.field(f"{name}_mm", f"{text}; `{name}_m` for a source in m") for name, text in axes]
    units = {name: f"1/{name.rpartition('_per_')[2]}" for name in exports.VALUES if "_per_" in name}
    return first + [tables.field(name, text, unit=units.get(name)) for name, text in exports.VALUES.items()]
