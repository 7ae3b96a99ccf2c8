"""Files that declare or unpack to more than there is, and special files where a file is expected."""

from __future__ import annotations

import gzip
import json
import os
import socket
import struct
import zipfile
import zlib
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq

from tests.attack.mutations import CORPUS

_MANY = 60_000_000  # rows; the bomb of the first attack
_ZEROS = 1 << 28  # B that zlib packs into 260 kB
SOUND = CORPUS / "points.csv"
RUN = CORPUS / "settings" / "run.csv"


def _parquet(path: Path, columns: dict[str, float], *, rows: int = _MANY) -> None:
    """Write columns of one value each, a row group at a time."""
    schema = pa.schema([(name, pa.float64()) for name in columns])
    with papq.ParquetWriter(path, schema, compression="zstd") as file:
        group = rows // 20
        table = pa.table({name: np.full(group, value) for name, value in columns.items()})
        for _ in range(20):
            file.write_table(table, row_group_size=group)


def _array(shape: tuple[int, ...], held: bytes = b"", *, fortran: bool = False) -> bytes:
    """Return an .npy file that declares a shape, whatever it holds."""
    head = f"{{'descr': '<f8', 'fortran_order': {fortran}, 'shape': {shape}, }}".encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + held


def _npz(path: Path, arrays: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in arrays.items():
            archive.writestr(f"{name}.npy", content)


def _saved(array: object) -> bytes:
    file = BytesIO()
    np.save(file, np.asarray(array))
    return file.getvalue()


def _vtp(path: Path, *, pieces: int, size: int) -> None:
    """Write poly lines whose points are zeros, packed by zlib."""
    packed = zlib.compress(bytes(size))
    counts = np.array([1, size, size, len(packed)], np.uint32).tobytes()
    text = (b64encode(counts) + b64encode(packed)).decode()
    array = '<DataArray type="Float64" format="binary" NumberOfComponents="3">'
    lines = '<Lines><DataArray type="Int64" Name="{0}" format="ascii">0 1 2 3</DataArray>{1}</Lines>'
    other = '<DataArray type="Int64" Name="offsets" format="ascii">4</DataArray>'
    piece = f"<Piece><Points>{array}{text}</DataArray></Points>{lines.format('connectivity', other)}</Piece>"
    path.write_text(
        '<VTKFile type="PolyData" byte_order="LittleEndian" compressor="vtkZLibDataCompressor"><PolyData>'
        + piece * pieces
        + "</PolyData></VTKFile>"
    )


def _sheet(path: Path, cells: str) -> None:
    """Write a workbook whose one sheet has these rows; take the rest of it from the sample."""
    with zipfile.ZipFile(CORPUS / "points.xlsx") as sample, zipfile.ZipFile(path, "w", 8) as made:
        for member in sample.namelist():
            content = sample.read(member)
            if "worksheets/sheet" in member:
                head, _, rest = content.partition(b"<sheetData>")
                content = (
                    head
                    + b"<sheetData>"
                    + cells.encode()
                    + b"</sheetData>"
                    + rest.partition(b"</sheetData>")[2]
                )
            made.writestr(member, content)


def _mat(path: Path, size: int) -> None:
    packed = zlib.compress(struct.pack("<II", 14, size) + bytes(size))
    path.write_bytes(b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(packed)) + packed)


def _markups(path: Path, points: str) -> None:
    path.write_text('{"markups":[{"type":"Curve","controlPoints":[' + points + "]}]}")


def _write(content: bytes | str) -> Callable[[Path], object]:
    raw = content.encode() if isinstance(content, str) else content
    return lambda path: path.write_bytes(raw)


_BOARD = ("--calibrate", "--board", "9x6", "--square-mm", "30")
_POINTS = _saved(np.random.default_rng(1).normal(size=(20, 3)))
_LINE = "x_mm,y_mm,z_mm\n"
BOMBS: dict[str, Callable[[Path], object]] = {
    "rows.parquet": lambda path: _parquet(path, {"x_mm": 1.0, "y_mm": 2.0, "z_mm": 3.0}),
    "one_time.parquet": lambda path: _parquet(path, dict.fromkeys(("time_s", "x_mm", "y_mm", "z_mm"), 1.0)),
    "numbered.parquet": lambda path: _parquet(
        path, dict.fromkeys(("time_s", "point", "x_mm", "y_mm", "z_mm"), 1.0)
    ),
    "foreign.parquet": lambda path: _parquet(path, dict.fromkeys(("t", "a", "b"), 1.0)),
    "run.parquet": lambda path: _parquet(
        path, dict.fromkeys(("time_s", "tension_in_N", "tension_out_N"), 1.0)
    ),
    "points.vtp": lambda path: _vtp(path, pieces=1, size=_ZEROS),
    "pieces.vtp": lambda path: _vtp(path, pieces=50, size=1 << 25),
    "laughs.vtp": _write(
        '<!DOCTYPE v [<!ENTITY a "'
        + "x" * 1000
        + '">'
        + "".join(f'<!ENTITY {b} "{f"&{a};" * 100}">' for a, b in zip("abcde", "bcdef", strict=True))
        + "]><VTKFile>&f;</VTKFile>"
    ),
    "declared.npz": lambda path: _npz(path, {"points": _array((10**9, 100, 3)), "unit": _saved("mm")}),
    "negative.npz": lambda path: _npz(path, {"points": _array((-5, 4, 3)), "unit": _saved("mm")}),
    "columns.npz": lambda path: _npz(
        path, {"points": _array((_ZEROS // 24, 3), bytes(_ZEROS), fortran=True), "unit": _saved("mm")}
    ),
    "one_frame.npz": lambda path: _npz(
        path, {"points": _array((_ZEROS // 24, 3), bytes(_ZEROS)), "unit": _saved("mm")}
    ),
    "foreign.npz": lambda path: _npz(
        path, {"points": _POINTS, "unit": _saved("mm"), "film": _array((_ZEROS // 8,), bytes(_ZEROS))}
    ),
    "time.npz": lambda path: _npz(
        path, {"points": _POINTS, "unit": _saved("mm"), "time_s": _array((_ZEROS // 8,), bytes(_ZEROS))}
    ),
    "unit.npz": lambda path: _npz(path, {"points": _POINTS, "unit": _array((10**12,))}),
    "declared.npy": _write(_array((10**10, 3))),
    "packed.csv.gz": _write(gzip.compress(_LINE.encode() + b"1,2,3\n" * (_ZEROS // 6), 6)),
    "zeros.tsv.gz": _write(gzip.compress(bytes(_ZEROS), 6)),
    "sheet.xlsx": lambda path: _sheet(path, '<row r="1"><c r="A1"><v>1</v></c></row>' * (1 << 22)),
    "corner.xlsx": lambda path: _sheet(
        path,
        '<row r="1"><c r="A1"><v>1</v></c></row><row r="1048576"><c r="XFD1048576"><v>1</v></c></row>',
    ),
    "packed.mat": lambda path: _mat(path, _ZEROS),
    "deep.mrk.json": _write('{"markups":' + "[" * 1_000_000),
    "points.mrk.json": lambda path: _markups(path, "{}," * 15_000_000 + "{}"),
    "deep.jsonl": _write('{"points":' + "[" * 500_000 + "\n"),
    "endless.jsonl": _write(b'{"unit":"mm","points":[' + b"[1,2,3]," * 4_000_000),
    "endless.csv": _write(_LINE.encode() + b"1" * (1 << 25)),
    "names.csv": _write(b"a" * (1 << 20) + b"_mm,y_mm,z_mm\n1,2,3\n"),
    "field.jsonl": _write(
        b'{"unit":"mm","' + b"k" * 900_000 + b'":1,"points":[[1,2,3],[1,2,4],[1,2,5],[1,2,6]]}\n'
    ),
    "commas.csv": _write(b"," * (1 << 23) + b"\n"),
    "lines.csv": _write(_LINE.encode() + b"\n" * (1 << 24)),
    "quotes.csv": _write(_LINE.encode() + b'"' * (1 << 22)),
    "lumen.ply": _write(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\n"
        b"property float y\nproperty float z\nelement face 1\n"
        b"property list uchar int vertex_indices\nend_header\n"
    ),
    "lumen.stl": _write(bytes(80) + struct.pack("<I", 0xFFFFFFFF)),
    "lumen.glb": _write(b"glTF" + struct.pack("<IIII", 2, 1 << 31, 1 << 30, 0x4E4F534A)),
    "lumen.obj": _write("v 0 0 0\n" * 3 + "f 1 2 999999999\n"),
    "rig.toml": _write("a = " + "[" * 500_000),
    "long_rig.toml": _write("#" * (1 << 26)),
    "huge_rig.toml": _write("[friction]\ncoefficient = 1e300\n"),
    "deep.toml": _write("[" + "a." * 200_000 + "b]\nx=1\n"),
    "cameras.json": _write("[" * 1_000_000),
    "state.json": _write(json.dumps({"k" * 1_000_000: 1})),
}
"""Writers of a file, by its name."""


def bombs(
    folder: Path, chosen: Mapping[str, Callable[[Path], object]]
) -> Iterator[tuple[str, list[str | Path]]]:
    """Yield the name and the commands of each file, written to `folder`."""
    for name, write in chosen.items():
        path = folder / name
        write(path)
        for command in _commands(path, folder):
            yield f"{command[0]} {name}", command
        path.unlink()


def _commands(path: Path, folder: Path) -> Iterator[list[str | Path]]:
    yield ["check", path]
    if "rig" in path.name:
        yield ["analyse", SOUND, "--rig", path, "--json"]
    elif "lumen" in path.name:
        yield ["analyse", SOUND, "--lumen", path, "--json"]
    else:
        yield ["analyse", path, "--unit", "mm", "--json"]
    if path.suffix in (".parquet", ".csv", ".gz"):
        yield ["simulate", SOUND, "--drive", path, "--out", folder / "out", "--quiet"]


def make_special(folder: Path) -> dict[str, Path]:
    """Make a pipe, a socket, devices, circular and broken links, and a folder with the ending of a file."""
    made = {
        name: folder / f"{name}.csv"
        for name in ("pipe", "socket", "zero", "null", "terminal", "circle", "broken", "folder", "closed")
    }
    os.mkfifo(made["pipe"])
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(made["socket"]))
    for name, target in (("zero", "/dev/zero"), ("null", "/dev/null"), ("terminal", "/dev/ptmx")):
        made[name].symlink_to(target)
    made["circle"].symlink_to(made["circle"])
    made["broken"].symlink_to(folder / "nothing")
    made["folder"].mkdir()
    made["closed"].write_text(_LINE)
    made["closed"].chmod(0)
    return made


def specials(folder: Path) -> Iterator[tuple[str, list[str | Path]]]:
    """Yield the name and the commands with a special file as each input."""
    out, campaign, track = folder / "out", folder / "campaign", folder / "track.jsonl"
    for name, path in make_special(folder).items():
        yield f"check {name}", ["check", path]
        yield f"analyse {name}", ["analyse", path, "--unit", "mm"]
        yield f"batch {name}", ["batch", path, "--out", out, "--no-pictures"]
        yield f"--rig {name}", ["analyse", SOUND, "--rig", path]
        yield f"--lumen {name}", ["analyse", SOUND, "--lumen", _named(path, ".ply")]
        yield f"--drive {name}", ["simulate", SOUND, "--drive", path, "--out", out]
        yield f"--target {name}", ["compensate", SOUND, "--target", path, "--out", out]
        yield f"shapes {name}", ["simulate", path, "--drive", RUN, "--out", out]
        yield f"calibrate {name}", ["calibrate", path, "--shape", SOUND, "--out", folder / "rig.toml"]
        yield f"--shape {name}", ["calibrate", RUN, "--shape", path, "--out", folder / "rig.toml"]
        yield f"remedy {name}", ["remedy", "--shape", path]
        yield (
            f"--calibration {name}",
            ["track", _named(path, ".mp4"), "--blobs", "bright", "--calibration", path, "--out", track],
        )
        yield (
            f"images {name}",
            ["track", _named(path, "", "1.png").parent, *_BOARD, "--out", folder / "c.toml"],
        )
        yield f"--token-file {name}", ["live", "--sink", "none", "--token-file", path]
        yield f"view {name}", ["view", _named(path, ".rrd"), "--screenshot", folder / "a.png"]
        campaign.mkdir(exist_ok=True)
        (campaign / "campaign.toml").write_text(
            f'[[run]]\ndata = "../{path.name}"\nshape = "../{path.name}"\n'
        )
        yield f"discover {name}", ["discover", campaign, "--out", folder / "result"]
        yield (
            f"campaign {name}",
            ["discover", _named(path, "", "campaign.toml").parent, "--out", folder / "result"],
        )


def _named(path: Path, ending: str, name: str = "") -> Path:
    """Return a link to a special file under another name."""
    link = path.parent / path.stem / name if name else path.with_suffix(ending)
    link.parent.mkdir(exist_ok=True)
    if not link.is_symlink():
        link.symlink_to(path)
    return link
