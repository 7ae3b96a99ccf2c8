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
BAR_AT, BAR_WIDE = 3.55, 3.2  # where bars begin, and the longest one, in rows
GENERATED = ("_entries.py", "_declarations.py")  # by the build of the core
DOTS_AT, STEP = 7.45, 0.31  # where dots begin, and from one column to the next
CAPTION = (
    "Bars: lines of code, by package. Dots: how many modules import from the room above.\n"
    "Squares: the room itself. Imports go down only, so no dot stands left of a square."
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
    """Return the description of a room, up to its first full stop, colon or semicolon."""
    text = ast.get_docstring(ast.parse(modules()[room].read_bytes())) or ""
    first = text.splitlines()[0]
    return first.split(":")[0].split(";")[0].split(". ")[0].rstrip(".")


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


def draw() -> Figure:
    """Draw a row for each room, a band for each layer: name, size, and what it imports."""
    wanted = layers()
    rooms = [room for layer in wanted for room in layer]
    figure = Figure(figsize=(9.0, 6.9), dpi=200)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, 13.2), ylim=(len(rooms) + 0.35, -1.35))
    axes.axis("off")
    top = 0
    for layer in wanted:
        axes.add_patch(Rectangle((0.15, top + 0.04), 12.9, len(layer) - 0.08, color=BAND, lw=0))
        top += len(layer)
    axes.text(0.35, -0.7, CAPTION, size=6.5, color=GREY, va="center", linespacing=1.5)
    scale = BAR_WIDE / max(sum(sizes(room).values()) for room in rooms)
    for row, room in enumerate(rooms):
        _row(axes, row, room, scale)
    _dots(axes, rooms)
    return figure


def _row(axes: Axes, row: int, room: str, scale: float) -> None:
    name, middle = room.rpartition(".")[2], row + 0.5
    axes.text(0.35, row + 0.34, name, weight="bold", size=9, color=INK, va="center")
    axes.text(0.35, row + 0.72, purpose(room), size=5.6, color=GREY, va="center")
    at, parts = BAR_AT, sizes(room)
    for shade, (part, lines) in enumerate(parts.items()):
        wide = lines * scale
        colour = SHADES[min(shade, len(SHADES) - 1)]
        axes.add_patch(Rectangle((at, row + 0.22), wide, 0.56, fc=colour, lw=0))
        axes.plot([at + wide] * 2, [row + 0.22, row + 0.78], color=BAND, lw=0.8)
        if wide > 0.068 * len(part):
            axes.text(
                at + wide / 2,
                middle,
                part,
                size=5.6,
                color=INK if shade > 1 else PALE,
                ha="center",
                va="center",
            )
        at += wide
    axes.text(
        at + 0.08, middle, f"{sum(parts.values()):,}".replace(",", " "), size=6.5, color=GREY, va="center"
    )


def _dots(axes: Axes, rooms: list[str]) -> None:
    count = crossings(rooms)
    for row, room in enumerate(rooms):
        axes.text(DOTS_AT + STEP * row, -0.12, room.rpartition(".")[2], size=6.5, color=INK, rotation=45)
        axes.add_patch(
            Rectangle((DOTS_AT + STEP * row - 0.06, row + 0.36), 0.12, 0.28, color="#c8d0dc", lw=0)
        )
    for (a, b), modules_ in count.items():
        row, column = rooms.index(a), rooms.index(b)
        colour = SHADES[0] if column > row else UPWARD
        axes.scatter(DOTS_AT + STEP * column, row + 0.5, s=4.0 + 2.2 * modules_, color=colour, lw=0)


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
