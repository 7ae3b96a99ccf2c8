"""Awkward variants of two files, a recording of markers and a pull, as laboratories write them."""

import gzip
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
from scipy.io import savemat

BEGIN = datetime(2024, 3, 1, 9, 30, tzinfo=UTC).timestamp()


@dataclass(frozen=True)
class Sheet:
    """A table, and how it is written as text."""

    names: list[str]
    columns: list[np.ndarray | list[str]]
    separator: str = ","
    decimal: str = "."
    quoted: bool = False
    before: str = ""
    under: str = ""
    after_rows: str = ""
    line: str = "\n"
    every: int = 1
    """How often each row is written."""

    def named(self, **names: str) -> "Sheet":
        return replace(self, names=[names.get(name, name) for name in self.names])

    def scaled(self, old: str, new: str, factor: float) -> "Sheet":
        k = self.names.index(old)
        columns = [*self.columns[:k], self.columns[k] * factor, *self.columns[k + 1 :]]
        return replace(self, names=[*self.names[:k], new, *self.names[k + 1 :]], columns=columns)

    def with_column(self, name: str, values: np.ndarray | list[str]) -> "Sheet":
        return replace(self, names=[*self.names, name], columns=[*self.columns, values])

    def rows(self) -> list[list[object]]:
        rows = [list(row) for row in zip(*self.columns, strict=True)]
        return [row for row in rows for _ in range(self.every)]

    def text(self) -> str:
        def cell(value: object) -> str:
            text = value if isinstance(value, str) else repr(float(value)).replace(".", self.decimal)
            return f'"{text}"' if self.quoted else text

        head = self.separator.join(f'"{name}"' if self.quoted else name for name in self.names)
        body = [self.separator.join(map(cell, row)) for row in self.rows()]
        lines = [
            *self.before.splitlines(),
            head,
            *self.under.splitlines(),
            *body,
            *self.after_rows.splitlines(),
        ]
        return self.line.join(lines) + self.line


def markers() -> Sheet:
    """Three frames of twelve markers on a bent route, in mm, in long form."""
    s = np.linspace(0.0, 2.0, 12)
    frames = [80 * np.column_stack([np.sin(s), 1 - np.cos(s), 0.2 * s * (1 + 0.1 * k)]) for k in range(3)]
    points = np.round(np.vstack(frames), 4)
    time = np.repeat([0.0, 0.05, 0.1], 12)
    tension = np.repeat([2.0, 5.5, 8.25], 12)
    return Sheet(["time_s", "x_mm", "y_mm", "z_mm", "tension_in_N"], [time, *points.T, tension])


def run() -> Sheet:
    """A pull and release of sixty samples."""
    time = np.round(np.arange(60) * 0.05, 3)
    pull = np.round(2 + 10 * np.interp(np.arange(60), [0, 30, 59], [0, 1, 0.1]), 4)
    out = np.round(0.7 * pull + 0.2 * np.sign(np.gradient(pull)), 4)
    drive = np.round(1e-3 * pull, 7)
    return Sheet(["time_s", "tension_in_N", "tension_out_N", "displacement_in_m"], [time, pull, out, drive])


def text(ending: str, sheet: Callable[[Sheet], Sheet] = lambda sheet: sheet, encoding: str = "utf-8"):
    def write(folder: Path, base: Sheet) -> Path:
        path = folder / f"data{ending}"
        raw = sheet(base).text().encode(encoding)
        path.write_bytes(gzip.compress(raw) if ending.endswith(".gz") else raw)
        return path

    return write


def lengths(sheet: Sheet, form: str, per_metre: float) -> Sheet:
    """Write lengths in another unit: "{} (cm)"."""
    for name in list(sheet.names):
        quantity, _, unit = name.rpartition("_")
        if unit in ("mm", "m"):
            factor = per_metre / (1000.0 if unit == "mm" else 1.0)
            sheet = sheet.scaled(name, form.format(quantity), factor)
    return sheet


def forces(sheet: Sheet, form: str, per_newton: float) -> Sheet:
    for name in list(sheet.names):
        if name.endswith("_N"):
            sheet = sheet.scaled(name, form.format(name.removesuffix("_N")), per_newton)
    return sheet


def times(sheet: Sheet, name: str, per_second: float, begin: float = 0.0) -> Sheet:
    moved = replace(sheet, columns=[sheet.columns[0] + begin, *sheet.columns[1:]])
    return moved.scaled("time_s", name, per_second)


def iso(sheet: Sheet, form: str = "%Y-%m-%dT%H:%M:%S.%f", name: str = "Timestamp") -> Sheet:
    words = [datetime.fromtimestamp(BEGIN + t, UTC).strftime(form) for t in sheet.columns[0]]
    return replace(sheet, names=[name, *sheet.names[1:]], columns=[words, *sheet.columns[1:]])


def unit_row(sheet: Sheet) -> Sheet:
    units = {"s": "s", "mm": "mm", "m": "m", "N": "N"}
    split = [name.rpartition("_") for name in sheet.names]
    return replace(
        sheet,
        names=[quantity for quantity, _, _ in split],
        under=sheet.separator.join(units[unit] for _, _, unit in split),
    )


LABORATORY = {"time_s": "Time [s]", "tension_in_N": "T_in [N]", "tension_out_N": "T_out [N]"} | {
    "displacement_in_m": "Motor position [m]",
    **{f"{axis}_mm": f"{axis} (mm)" for axis in "xyz"},
}


def laboratory(sheet: Sheet) -> Sheet:
    return sheet.named(**LABORATORY)


def spreadsheet(folder: Path, sheet: Sheet) -> Path:
    from openpyxl import Workbook

    book = Workbook()
    page = book.active
    page.append(["Bench 2", None, "operator", "AB"])
    page.append([])
    for row in [laboratory(sheet).names, *sheet.rows()]:
        page.append([value if isinstance(value, str) else float(value) for value in row])
    book.create_sheet("Notes").append(["nothing here"])
    book.save(folder / "data.xlsx")
    return folder / "data.xlsx"


def structured(folder: Path, sheet: Sheet) -> Path:
    np.save(folder / "data.npy", np.rec.fromarrays(sheet.columns, names=laboratory(sheet).names))
    return folder / "data.npy"


def matlab(folder: Path, sheet: Sheet) -> Path:
    savemat(folder / "data.mat", dict(zip(sheet.names, sheet.columns, strict=True)))
    return folder / "data.mat"


def matlab_matrix(folder: Path, sheet: Sheet) -> Path:
    names = np.array(laboratory(sheet).names, dtype=object)
    savemat(folder / "data.mat", {"log": {"data": np.column_stack(sheet.columns), "names": names}})
    return folder / "data.mat"


def feather(folder: Path, sheet: Sheet) -> Path:
    pyarrow.feather.write_feather(
        pa.table(dict(zip(laboratory(sheet).names, sheet.columns, strict=True))), folder / "data.feather"
    )
    return folder / "data.feather"


PREAMBLE = "Device: LoadFrame 3000\nOperator: AB; 12,5 °C\nDate,2024-03-01\n\n"
COMMENTS = "# bench 2, tendon 0.5 mm\n# 1, 2, 3\n"
VARIANTS: dict[str, Callable[[Path, Sheet], Path]] = {
    "semicolons": text(".csv", lambda s: replace(s, separator=";")),
    "decimal comma": text(".csv", lambda s: replace(s, separator=";", decimal=",")),
    "quotes and decimal comma": text(".csv", lambda s: replace(s, decimal=",", quoted=True)),
    "tabs, byte order mark, CRLF": text(
        ".tsv", lambda s: replace(laboratory(s), separator="\t", line="\r\n"), "utf-8-sig"
    ),
    "UTF-16": text(".txt", lambda s: replace(laboratory(s), separator="\t"), "utf-16"),
    "Windows-1252": text(
        ".csv",
        lambda s: replace(
            laboratory(s).with_column("Temperature [°C]", [21.5] * len(s.columns[0])),
            separator=";",
            decimal=",",
        ),
        "cp1252",
    ),
    "comments": text(".csv", lambda s: replace(s, before=COMMENTS, under="# calibrated")),
    "header in a comment": text(
        ".dat", lambda s: replace(s, separator=" ", before="", names=["# " + s.names[0], *s.names[1:]])
    ),
    "preamble": text(".csv", lambda s: replace(laboratory(s), before=PREAMBLE)),
    "unit row": text(".csv", unit_row),
    "unit row, brackets, decimal comma": text(
        ".txt",
        lambda s: (lambda u: replace(u, under=";".join(f"[{x}]" for x in u.under.split(";"))))(
            unit_row(replace(s, separator=";", decimal=","))
        ),
    ),
    "brackets and parentheses": text(".csv", laboratory),
    "cm and kgf": text(".csv", lambda s: forces(lengths(s, "{} [cm]", 100.0), "{} [kgf]", 1 / 9.80665)),
    "inch and lb": text(
        ".csv", lambda s: forces(lengths(s, "{} (in)", 1 / 0.0254), "{} (lbf)", 1 / 4.4482216152605)
    ),
    "mN and µm": text(".csv", lambda s: forces(lengths(s, "{} (µm)", 1e6), "{}_mN", 1e3)),
    "ms": text(".csv", lambda s: times(s, "t_ms", 1e3)),
    "µs and a trailing separator": text(
        ".csv", lambda s: replace(times(s, "Time (µs)", 1e6), separator=";", line=";\n")
    ),
    "ISO times": text(".csv", iso),
    "ISO times with a blank": text(
        ".txt", lambda s: replace(iso(s, "%d.%m.%Y %H:%M:%S,%f", "Zeit"), separator=";", decimal=",")
    ),
    "epoch in s": text(".csv", lambda s: times(s, "timestamp", 1.0, BEGIN)),
    "epoch in ms": text(".csv", lambda s: times(s, "timestamp", 1e3, BEGIN)),
    "gzip": text(".csv.gz", lambda s: replace(laboratory(s), separator=";")),
    "doubled rows": text(
        ".csv",
        lambda s: replace(
            laboratory(s).with_column("point", list(np.tile(np.arange(1.0, 13), 3)))
            if "x_mm" in s.names
            else s,
            every=2,
        ),
    ),
    "degrees beside, spaces": text(
        ".dat", lambda s: replace(s.with_column("motor_angle_deg", s.columns[0] * 90), separator="   ")
    ),
    "spreadsheet": spreadsheet,
    "structured array": structured,
    "MATLAB columns": matlab,
    "MATLAB matrix with names": matlab_matrix,
    "feather": feather,
    "bars, upper case": text(
        ".txt", lambda s: replace(s, separator="|", names=[name.upper() for name in s.names])
    ),
}
"""Thirty ways of writing each base file."""
