"""Draw the layers of the code, their sizes and their imports, as they are in the code.

python docs/architecture.py            # writes docs/architecture.png
python docs/architecture.py --check    # is the picture that of the contract, and does the code keep it?
"""

import ast
import json
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

ROOT = Path(__file__).parents[1]
PICTURE = Path(__file__).with_suffix(".png")
INK, GREY, BAND, PALE = "#1d2330", "#5b6474", "#eef2f7", "#ffffff"
SHADES = ("#2f5d8a", "#5f8fbb", "#94b8d8", "#c3d8ea")
UPWARD = "#d55e00"
WIDE, ROW, HEAD = 9.6, 0.38, 1.1  # of the picture, of a row, of what is above them [in]
NAME_AT, BAR_AT, BAR_WIDE, DOTS_AT = 0.15, 3.25, 2.0, 5.95  # where they begin, and the longest bar [in]
LETTER = 0.075  # of a name in a bar, with space around it [in]
SMALL = 100  # lines of a room that shares a row
LONGEST = 52  # characters of a purpose that fit
GENERATED = ("_entries.py", "_declarations.py")  # by the build of the core
CAPTION = (
    "Bars: lines of Python, by package. Dots: how many modules of the row\n"
    "import from the column. Squares: the row itself. Imports go down\n"
    "only, so no dot stands left of a square."
)


def contract() -> dict[str, Any]:
    """Return the contract of the layers, as import-linter reads it."""
    linter = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    return next(each for each in linter["contracts"] if each["type"] == "layers")


def layers() -> list[list[str]]:
    """Return the rooms of each layer from the top down, as the contract has them."""
    return [[room.strip() for room in layer.split("|")] for layer in contract()["layers"]]


def modules() -> dict[str, Path]:
    """Return every module by its name."""
    paths = [path for top in ("pipelines", "tssgeom") for path in sorted((ROOT / top).rglob("*.py"))]
    paths = [path for path in paths if path.name not in GENERATED]
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in paths
    }


def room_of(module: str, rooms: list[str]) -> str | None:
    """Return the room that a module is in; None for `tssgeom` itself, the door to all of them."""
    return next((room for room in rooms if module == room or module.startswith(f"{room}.")), None)


def imports(path: Path) -> Iterator[str]:
    """Yield what a module imports, `from a import b` as a.b."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{name.name}" for name in node.names)


def crossings(rooms: list[str]) -> Counter[tuple[str, str]]:
    """Count the modules of a room that import from another."""
    counts = Counter[tuple[str, str]]()
    for module, path in modules().items():
        here = room_of(module, rooms)
        counts.update(
            {
                (here, there)
                for name in imports(path)
                if here and (there := room_of(name, rooms)) not in (None, here)
            }
        )
    return counts


def sizes(room: str) -> dict[str, int]:
    """Return lines by package within a room, its own files under "" first."""
    counts = Counter[str]({"": 0})
    for module, path in modules().items():
        if room_of(module, [room]):
            parts = path.relative_to(ROOT).parts[room.count(".") + 1 : -1]
            counts[parts[0] if parts else ""] += len(path.read_text(encoding="utf-8").splitlines())
    own = counts.pop("")
    return {"": own, **dict(counts.most_common())}


def purpose(room: str) -> str:
    """Return the description of a room, up to its first stop, or comma if it is long."""
    text = ast.get_docstring(ast.parse(modules()[room].read_bytes())) or ""
    first = text.splitlines()[0].split(":")[0].split(";")[0].split(". ")[0].rstrip(".")
    return (first if len(first) <= LONGEST else first.split(",")[0]).replace("`", "")


def wrong() -> list[str]:
    """Say what in the picture is not in the contract, and what in the code keeps it not."""
    wanted, said = layers(), list[str]()
    rooms = [room for layer in wanted for room in layer]
    level = {room: depth for depth, layer in enumerate(wanted) for room in layer}
    with Image.open(PICTURE) as picture:
        pictured = json.loads(picture.info.get("layers", "[]"))
    if pictured != wanted:
        said.append(
            f"{PICTURE.name} shows {pictured}, the contract has {wanted}: run python docs/architecture.py"
        )
    said += [
        f"{a} imports {b}, which is no layer below it" for a, b in crossings(rooms) if level[a] >= level[b]
    ]
    homeless = [name for name in modules() if name != "tssgeom" and room_of(name, rooms) is None]
    return said + [f"{name} is in no layer of the contract" for name in homeless]


def rows() -> list[list[str]]:
    """Return the rooms of each row; the small ones of a layer share one."""
    return [row for layer in layers() for row in _shared(layer)]


def _shared(layer: list[str]) -> list[list[str]]:
    small = [room for room in layer if sum(sizes(room).values()) < SMALL]
    if len(small) < 2:
        return [[room] for room in layer]
    return [*([room] for room in layer if room not in small), small]


def draw() -> Figure:
    """Draw a row for each room, a band for each layer: name, size, and what it imports."""
    lines = rows()
    high = HEAD + ROW * len(lines) + 0.05
    figure = Figure(figsize=(WIDE, high), dpi=200)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, WIDE), ylim=(high, 0.0))
    axes.axis("off")
    top = HEAD
    for layer in layers():
        deep = ROW * len(_shared(layer))
        axes.add_patch(Rectangle((0.05, top + 0.015), WIDE - 0.1, deep - 0.03, color=BAND, lw=0))
        top += deep
    axes.text(NAME_AT, HEAD - 0.1, CAPTION, size=8, color=GREY, va="bottom", linespacing=1.5)
    scale = BAR_WIDE / max(_lines(row) for row in lines)
    for k, row in enumerate(lines):
        _row(axes, HEAD + ROW * k, row, scale)
    _dots(axes, lines)
    return figure


def _lines(row: list[str]) -> int:
    return sum(sum(sizes(room).values()) for room in row)


def _row(axes: Axes, top: float, row: list[str], scale: float) -> None:
    name, middle = ", ".join(room.rpartition(".")[2] for room in row), top + 0.5 * ROW
    if len(row) == 1:
        axes.text(NAME_AT, top + 0.12, name, weight="bold", size=9, color=INK, va="center")
        axes.text(NAME_AT, top + 0.27, purpose(row[0]), size=7, color=GREY, va="center")
    else:
        axes.text(NAME_AT, middle, name, weight="bold", size=7, color=INK, va="center")
    at, parts = BAR_AT, sizes(row[0]) if len(row) == 1 else {"": _lines(row)}
    for shade, (part, lines) in enumerate(parts.items()):
        wide = lines * scale
        colour = SHADES[min(shade, len(SHADES) - 1)]
        axes.add_patch(Rectangle((at, top + 0.08), wide, ROW - 0.16, fc=colour, lw=0))
        axes.plot([at + wide] * 2, [top + 0.08, top + ROW - 0.08], color=BAND, lw=0.8)
        if wide > LETTER * len(part) > 0.0:
            ink = INK if shade > 1 else PALE
            axes.text(at + wide / 2, middle, part, size=7, color=ink, ha="center", va="center")
        at += wide
    number = f"{_lines(row):,}".replace(",", " ")
    axes.text(at + 0.06, middle, number, size=7.5, color=GREY, va="center")


def _dots(axes: Axes, lines: list[list[str]]) -> None:
    count, step = Counter[tuple[int, int]](), (WIDE - 0.2 - DOTS_AT) / len(lines)
    row_of = {room: k for k, row in enumerate(lines) for room in row}
    for (a, b), modules_ in crossings(list(row_of)).items():
        count[row_of[a], row_of[b]] += modules_
    for k, row in enumerate(lines):
        x, y = DOTS_AT + step * k, HEAD + ROW * k
        name = row[0].rpartition(".")[2] + " …" * (len(row) > 1)
        axes.text(x, HEAD - 0.1, name, size=8, color=INK, rotation=90, ha="center", va="bottom")
        axes.add_patch(Rectangle((x - 0.05, y + 0.5 * ROW - 0.05), 0.1, 0.1, color="#c8d0dc", lw=0))
    for (row, column), modules_ in count.items():
        if row != column:
            colour = SHADES[0] if column > row else UPWARD
            x, y = DOTS_AT + step * column, HEAD + ROW * (row + 0.5)
            axes.scatter(x, y, s=3.0 + 1.6 * modules_, color=colour, lw=0)


def main() -> int:
    """Write the picture, or check it."""
    if sys.argv[1:] == ["--check"]:
        said = wrong()
        sys.stderr.write("".join(f"{line}\n" for line in said))
        return int(bool(said))
    draw().savefig(PICTURE, metadata={"layers": json.dumps(layers()), "Software": ""})
    return 0


if __name__ == "__main__":
    sys.exit(main())
