"""Sound files changed inside their containers: what checksums and archives hide from turned bits."""

from __future__ import annotations

import gzip
import json
import re
import sqlite3
import tempfile
import warnings
import zipfile
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import feather, parquet
from scipy.io import savemat

from tests.attack.mutations import mutated

_KINDS = (
    "<f8",
    ">f4",
    "<f2",
    "<i8",
    ">i2",
    "u1",
    "?",
    "<c16",
    "<U3",
    "S4",
    "<M8[ns]",
    "<m8[s]",
    "<f16",
    "V8",
)
_NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e300, 5e-324, 1e18, -1.0, 0.0)
_NAMES = (
    "points",
    "time_s",
    "unit",
    "s",
    "point",
    "x_mm",
    "y_mm",
    "z_mm",
    "x_m",
    "tension_in_N",
    "kappa_x_per_m",
)
_VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        0,
        -1,
        10**30,
        1e300,
        -1e-300,
        float("nan"),
        float("inf"),
        "",
        "x",
        "1",
        "mm",
        "\ud800",
        "é" * 99,
    ),
    *(
        [],
        {},
        [[]],
        [[1.0]],
        [1.0, 2.0, 3.0],
        [[1, 2, 3]] * 6,
        {"x": 1},
        [None, None, None],
        [["1", "2", "3"]],
    ),
)
_CODES = ("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp1252", "cp037", "utf-7", "shift_jis")
_ATTRIBUTE = re.compile(rb'"[^"<>]*"')


def rebuilt(name: str, raw: bytes, random: np.random.Generator) -> bytes:
    """Change what a file holds, and write it again in its format; one without a way is changed as bytes."""
    kind = name.rpartition(".")[2]
    with suppress(
        ValueError, TypeError, OverflowError, NotImplementedError, pa.ArrowException, sqlite3.Error
    ):
        if kind == "gz":
            return gzip.compress(mutated(gzip.decompress(raw), random))
        if kind in ("npz", "xlsx"):
            return _archive(raw, random)
        if kind == "npy":
            return _array(random)
        if kind in ("parquet", "feather", "mat"):
            return _columns(kind, random)
        if kind in ("json", "jsonl"):
            lines = [json.loads(line) for line in (raw.splitlines() if kind == "jsonl" else [raw])]
            return "\n".join(json.dumps(_object(line, random)) for line in lines).encode()
        if kind in ("vtp", "fcsv"):
            return _attributes(raw, random)
        if kind == "db3":
            return _database(raw, random)
        if kind in ("csv", "tsv", "txt", "toml", "obj"):
            return _text(raw.decode(), random)
    return mutated(raw, random)


def _one(of: tuple[Any, ...] | list[Any], random: np.random.Generator) -> Any:
    return of[int(random.integers(len(of)))]


def _strange(random: np.random.Generator) -> np.ndarray:
    """Return an array of any kind and shape, with numbers that hurt in it."""
    shape = tuple(int(n) for n in random.choice([0, 1, 2, 3, 3, 6, 12], int(random.integers(0, 4))))
    values = np.asarray(random.normal(size=shape) * _one((1.0, 100.0, 1e18), random))
    for _ in range(int(random.integers(3)) if values.size else 0):
        values.flat[random.integers(values.size)] = _one(_NUMBERS, random)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        array = values.astype(np.dtype(_one(_KINDS, random)))
    return np.asfortranarray(array) if random.integers(4) == 0 else array


def _array(random: np.random.Generator) -> bytes:
    file = BytesIO()
    np.save(file, _strange(random))
    return file.getvalue()


def _archive(raw: bytes, random: np.random.Generator) -> bytes:
    """Change, double, rename or leave out one member of an archive."""
    made = BytesIO()
    with zipfile.ZipFile(BytesIO(raw)) as old, zipfile.ZipFile(made, "w") as new, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        chosen, way = _one(old.namelist(), random), int(random.integers(5))
        for each in old.namelist():
            content = old.read(each)
            if each == chosen:
                if way == 0:
                    continue
                each = f"{_one(_NAMES, random)}.npy" if way == 1 else each
                replaced = way == 2 and each.endswith(".npy")
                content = _array(random) if replaced else mutated(content, random) if way > 1 else content
            for _ in range(1 + (each == chosen and way == 3)):
                new.writestr(
                    each,
                    content,
                    _one(
                        (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA),
                        random,
                    ),
                )
    return made.getvalue()


def _columns(kind: str, random: np.random.Generator) -> bytes:
    """Write a table or variables, sound coordinates among them or not."""
    sound = {f"{axis}_mm": np.linspace(0.0, 50.0, 6) ** power for power, axis in enumerate("xyz", start=1)}
    columns: dict[str, Any] = sound if random.integers(4) else {}
    for _ in range(int(random.integers(1, 4))):
        columns[_one(_NAMES, random)] = _strange(random) if random.integers(2) else _one(_VALUES, random)
    file = BytesIO()
    if kind == "mat":
        kept = {name: "" if value is None else value for name, value in columns.items()}
        savemat(file, kept, do_compression=bool(random.integers(2)))
        return file.getvalue()
    rows = 6
    made = [
        pa.array(np.resize(value, rows) if isinstance(value, np.ndarray) else [value] * rows)
        for value in columns.values()
    ]
    table = pa.table(dict(zip(columns, made, strict=True)))
    if kind == "parquet":
        parquet.write_table(table, file, row_group_size=int(random.integers(1, 9)))
    else:
        feather.write_feather(table, file, compression=_one(("uncompressed", "zstd", "lz4"), random))
    return file.getvalue()


def _object(value: Any, random: np.random.Generator) -> Any:
    """Change, take out or double some part of an object of JSON."""
    if not isinstance(value, dict | list) or not value or random.integers(5) == 0:
        return _one(_VALUES, random)
    way = int(random.integers(6))
    if isinstance(value, dict):
        key = _one(sorted(value), random)
        if way == 0:
            return {name: each for name, each in value.items() if name != key}
        return value | {_one(_NAMES, random) if way == 1 else key: _object(value[key], random)}
    at = int(random.integers(len(value)))
    middle = [] if way == 0 else [_object(value[at], random)]
    return [*value[:at], *middle, *value[at + (way != 1) :]]


def _attributes(raw: bytes, random: np.random.Generator) -> bytes:
    """Exchange two quoted texts of a file, or give one of them another's number."""
    quoted = list(_ATTRIBUTE.finditer(raw))
    if not quoted:
        return mutated(raw, random)
    one = _one(quoted, random)
    word = (
        _one(quoted, random)[0]
        if random.integers(2)
        else b'"%d"' % _one((0, -1, 1, 3, 7, 2**31, 2**63, 10**30), random)
    )
    return raw[: one.start()] + word + raw[one.end() :]


def _database(raw: bytes, random: np.random.Generator) -> bytes:
    """Set a column of a table of SQLite to a value of any type."""
    with tempfile.TemporaryDirectory() as home, closing(sqlite3.connect(Path(home, "x"))) as base:
        base.deserialize(raw)
        table = _one(
            [each[0] for each in base.execute("select name from sqlite_master where type='table'")], random
        )
        column = _one([each[1] for each in base.execute(f"pragma table_info({table})")], random)
        blob = random.bytes(int(random.integers(0, 300)))
        base.execute(
            f"update {table} set {column}=?", (_one((None, -1, 2**62, 1e300, "", "x\n", blob), random),)
        )
        base.commit()
        return base.serialize()


def _text(text: str, random: np.random.Generator) -> bytes:
    """Write a text in another encoding, with other separators, or its columns or lines in another order."""
    way = int(random.integers(6))
    if way == 0:
        return text.encode(_one(_CODES, random), "replace")
    if way == 1:
        return text.replace("\n", _one(("\r", "\r\n", "\n\n", "\x0b", "\u2028", "\x85"), random)).encode()
    if way == 2:
        return (
            text.replace(",", _one((";", "\t", " ", "|", ", "), random))
            .replace(".", _one((",", "."), random))
            .encode()
        )
    lines = [line.split(",") for line in text.splitlines()]
    if way == 3:
        order = random.permutation(max(map(len, lines)))
        lines = [[line[k] for k in order if k < len(line)] for line in lines]
    elif way == 4:
        lines = [_one(lines, random) for _ in lines]
    else:
        lines[0][int(random.integers(len(lines[0])))] = _one(_NAMES, random)
    return "\n".join(map(",".join, lines)).encode()
