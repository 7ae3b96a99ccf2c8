"""The code blocks of CONTRIBUTING.md, applied to a copy of the code."""

import re
import shutil
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"<!-- apply: (\S+) -->\n```(\w+)\n(.*?)```", TEXT, re.DOTALL)
"""File, language and text of each."""


def changed(text: str, block: str) -> str:
    """Return a file's text with a block of lines that stay, go and come."""
    lines = block.splitlines(keepends=True)
    old = "".join(line[1:] for line in lines if line[0] != "+")
    new = "".join(line[1:] for line in lines if line[0] != "-")
    assert text.count(old) == 1, f"it is not clear where this belongs:\n{block}"
    return text.replace(old, new)


def apply_to_copy(home: Path, names: tuple[str, ...] = ("tssgeom", "pipelines")) -> None:
    """Copy files and folders of the repository, compiled code included, and apply every block to them."""
    for name in names:
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copy2)(ROOT / name, home / name)
    for name, kind, block in BLOCKS:
        path = home / name
        old = path.read_text(encoding="utf-8") if path.exists() else ""
        path.write_text(changed(old, block) if kind == "diff" else old + block, encoding="utf-8")
