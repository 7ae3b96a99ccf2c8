"""Code blocks that are executed when the pages are built, with what they print and draw below them.

    ```{run} sh
    :lines: 12
    :picture: figures/half_circle_tension.svg What the picture shows
    tssgeom analyse sample_shapes/half_circle.csv
    ```

The blocks of a page run in the order of the page, in one folder with `sample_shapes` in it; those of Python
share their names. A block that fails is a warning, and so ends the build. The page does not show a block with
`:hidden:`; with `:code: FOLDER` the package is that in a folder beside the samples.
"""

import contextlib
import io
import os
import shutil
import subprocess
import sys
import traceback
import warnings
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

SAMPLES = Path(__file__).parents[2] / "sample_shapes"
TIME_LIMIT = 300.0
"""Of one block [s]. Chosen: `discover` takes 40 s on two cores."""
WIDTH = 100
"""Columns of the terminal [1]. Chosen: a page shows as many."""
LOG = logging.getLogger(__name__)
_names: dict[str, dict[str, Any]] = {}
"""Of the blocks of Python, by page."""


class Run(SphinxDirective):
    """A block of `sh` or `python` that is executed."""

    has_content = True
    required_arguments = 1
    option_spec = {  # noqa: RUF012 - as docutils has it
        "code": directives.unchanged_required,
        "hidden": directives.flag,
        "lines": directives.nonnegative_int,
        "picture": directives.unchanged,
        "status": directives.nonnegative_int,
    }

    def run(self) -> list[nodes.Node]:
        """Execute the block; return it with what it prints and draws."""
        language, code = self.arguments[0], "\n".join(self.content)
        folder = folder_of(self.env.docname, Path(self.env.app.doctreedir))
        printed, pictures = (_python if language == "python" else _shell)(self, code, folder)
        if "hidden" in self.options:
            return []
        out = [_literal(code, language)]
        if printed.strip():
            text = _first(printed, self.options.get("lines", 0))
            out.append(_literal(text, "text", "output", *_width(text)))
        if "picture" in self.options:
            name, _, alt = self.options["picture"].partition(" ")
            pictures.append((folder / name, alt))
        for path, alt in pictures:
            if not path.exists():
                self.warn(f"there is no picture {path.name}")
            else:
                out.append(self.image(path, alt))
        return out

    def image(self, path: Path, alt: str) -> nodes.image:
        """Return the node of a picture."""
        here = (Path(self.env.srcdir) / self.env.docname).parent
        return nodes.image(uri=os.path.relpath(path, here), alt=alt, classes=["run-picture"])

    def warn(self, text: str) -> None:
        """Report a fault with its line."""
        LOG.warning(text, location=self.get_location())


def folder_of(page: str, doctrees: Path) -> Path:
    """Return the folder in which the blocks of a page run."""
    return doctrees / "run" / page.replace("/", "-")


def _shell(block: Run, code: str, folder: Path) -> tuple[str, list[tuple[Path, str]]]:
    here = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}", "COLUMNS": str(WIDTH)}
    if "code" in block.options:
        here["PYTHONPATH"] = str(folder / block.options["code"])
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", code],
        cwd=folder,
        env={**os.environ, **here, "NO_COLOR": "1", "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=TIME_LIMIT,
        check=False,
    )
    if done.returncode != block.options.get("status", 0):
        block.warn(f"exit status {done.returncode} of:\n{code}\n{done.stdout}{done.stderr}")
    return done.stdout, []


def _python(block: Run, code: str, folder: Path) -> tuple[str, list[tuple[Path, str]]]:
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot

    names, out = _names.setdefault(block.env.docname, {"__name__": "__main__"}), io.StringIO()
    mpl.rcParams.update(
        mpl.rcParamsDefault, backend="agg"
    )  # scripts of the gallery have a style of their own
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            exec(compile(code, f"{block.env.docname}, line {block.lineno}", "exec"), names)
        except Exception:
            block.warn(f"error in:\n{code}\n{traceback.format_exc()}")
    figures = list[tuple[Path, str]]()
    for number in pyplot.get_fignums():
        path = folder / f"line_{block.lineno}_{number}.svg"
        pyplot.figure(number).savefig(path, bbox_inches="tight")
        figures.append((path, "Figure of the code above"))
    pyplot.close("all")
    return out.getvalue(), figures


def _first(text: str, lines: int) -> str:
    """Return the first lines of an output, all where `lines` is 0."""
    rows = text.rstrip().splitlines()
    return "\n".join([*rows[:lines], "…"] if 0 < lines < len(rows) else rows)


def _width(text: str) -> list[str]:
    """Return the class of a printed table by its letters, for which site.css has sizes."""
    letters = max((len(line.rstrip()) for line in text.splitlines() if _RULE in line), default=0)
    return [name for name, least in _WIDE.items() if letters > least][-1:]


_RULE, _WIDE = "───", {"wide": 80, "widest": 108}


def _literal(text: str, language: str, *classes: str) -> nodes.Node:
    block = nodes.literal_block(text, text, language=language)
    if not classes:
        return block
    return nodes.container("", block, classes=list(classes), literal_block=False)


def clear(app: Sphinx, page: str, source: list[str]) -> None:
    """Empty the folder and the names of a page that is read anew."""
    folder = folder_of(page, Path(app.doctreedir))
    shutil.rmtree(folder, ignore_errors=True)
    _names.pop(page, None)
    if "{run}" in source[0]:
        folder.mkdir(parents=True)
        (folder / "sample_shapes").symlink_to(SAMPLES)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive to Sphinx."""
    app.add_directive("run", Run)
    app.connect("source-read", clear)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
