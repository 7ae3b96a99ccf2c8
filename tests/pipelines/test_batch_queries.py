"""The example queries of docs/batch.md give what the tables hold."""

import math
import re
from pathlib import Path
from typing import Any

import pandas
import pyarrow.parquet as papq
import pytest

duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs/batch.md").read_text("utf-8")


def example(library: str) -> str:
    (block,) = re.findall(rf"```\{{run\}} python\n((?:(?!```).)*import {library}\n.*?)```", TEXT, re.DOTALL)
    return block


@pytest.fixture
def results(run, tmp_path: Path, recording: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Results of a pull and release and of a helix, in the folder that the examples name."""
    out = tmp_path / "results"
    helix = ROOT / "sample_shapes/helix.csv"
    run("batch", recording, helix, "--out", out, "--no-pictures", "--csv", "--workers", "1", "--quiet")
    monkeypatch.chdir(tmp_path)
    return out


def test_duckdb_finds_the_least_tension_of_each_recording(results: Path) -> None:
    names: dict[str, Any] = {}
    exec(example("duckdb"), names)
    result = names["least"]
    assert [row[0] for row in result] == ["helix", "pull"]
    rows = papq.read_table(results / "frames/pull.parquet").to_pylist()
    pulled = [row for row in rows if row["rejected"] is None and row["direction_index"] == 1]
    least = min(pulled, key=lambda row: row["tension_out_N"])
    assert result[1][1] == least["tension_out_N"]
    assert result[1][2] == pytest.approx(math.degrees(least["total_angle_rad"]), rel=1e-12)  # rounding


def test_pandas_finds_the_share_of_sharp_bends(results: Path) -> None:
    names: dict[str, Any] = {"pandas": pandas}
    exec(example("pandas"), names)
    assert names["share"].to_dict() == pytest.approx({"helix": 1.0, "pull": 0.0})


def test_every_field_that_is_written_is_named_in_the_documents(results: Path) -> None:
    text = TEXT + (ROOT / "docs/formats.md").read_text("utf-8")
    for table in (
        results / "summary.parquet",
        results / "frames/pull.parquet",
        results / "segments/pull.parquet",
    ):
        schema = papq.read_schema(table)
        assert [field.name for field in schema if f"`{field.name}`" not in text] == []
        assert all({b"unit", b"meaning"} <= field.metadata.keys() for field in schema)
