"""What a command does not need is not imported, so that it starts at once."""

import subprocess
import sys
from pathlib import Path

import pytest

from pipelines.cli import COMMANDS

SAMPLES = Path(__file__).parents[1] / "sample_shapes"
SHAPE, CAMPAIGN = SAMPLES / "half_circle.csv", SAMPLES / "campaign_hidden_bend"
HEAVY = ("cv2", "matplotlib", "numba", "pandas", "pyarrow", "rerun", "scipy", "trimesh")
"""Libraries that the analysis of one shape does not need."""
FOLLOWING = "tssgeom.adapt"
"""The package that follows a rig, which a rig that is not followed does not need."""
ARITHMETIC = ("msgspec", "numpy")

_HALF_CIRCLE = """
import numpy, tssgeom
angle = numpy.linspace(0.0, 3.0, 40)
points = numpy.column_stack([numpy.cos(angle), numpy.sin(angle), 0.0 * angle])
"""
_COMMAND = """
from pipelines.cli import main
try: main({words!r})
except SystemExit as ended: assert not ended.code, ended.code
"""


def imported(code: str, names: tuple[str, ...]) -> tuple[list[str], str]:
    """Return those of the modules that some code imports, and what else it prints."""
    code += f"\nimport sys; print(*[name for name in {names!r} if name in sys.modules], sep=',')"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    *printed, last = ended.stdout.splitlines()
    return [name for name in last.split(",") if name], "\n".join(printed)


def test_the_package_alone_imports_nothing():
    assert imported("import tssgeom", HEAVY + ARITHMETIC)[0] == []


@pytest.mark.parametrize(
    "call",
    [
        "tssgeom.analyse(points)",
        "list(tssgeom.process([tssgeom.Frame(points)], tssgeom.Rig(), tension_in=15.0))",
    ],
)
def test_an_analysis_imports_nothing_heavy(call):
    assert imported(_HALF_CIRCLE + call, (*HEAVY, FOLLOWING))[0] == []


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_the_command_analyse_of_one_shape_imports_nothing_heavy(options):
    names, printed = imported(_COMMAND.format(words=["analyse", str(SHAPE), *options]), (*HEAVY, FOLLOWING))
    assert names == []
    assert "half_circle" in printed


def test_the_command_check_of_a_shape_imports_nothing_heavy():
    assert imported(_COMMAND.format(words=["check", str(SHAPE)]), (*HEAVY, FOLLOWING))[0] == []


@pytest.mark.parametrize(
    ("options", "unneeded"),
    [
        ([], ("cv2", "scipy", "trimesh", FOLLOWING)),
        (["--no-pictures"], ("cv2", "matplotlib", "rerun", "scipy", "trimesh", FOLLOWING)),
    ],
)
def test_a_batch_without_lumen_imports_no_meshes_and_without_pictures_nothing_that_draws(
    options, unneeded, tmp_path
):
    words = ["batch", str(SHAPE), "--out", str(tmp_path / "out"), "--quiet", *options]
    assert imported(_COMMAND.format(words=words), unneeded)[0] == []


def test_the_command_simulate_imports_nothing_that_fits(tmp_path):
    words = ["simulate", str(CAMPAIGN / "route_half_circle.csv"), "--drive", str(CAMPAIGN / "half_slow.csv")]
    words += ["--out", str(tmp_path / "out"), "--quiet"]
    unneeded = ("cv2", "scipy", "trimesh", FOLLOWING, "tssgeom.identify.fit")
    assert imported(_COMMAND.format(words=words), unneeded)[0] == []


def test_help_of_every_command_imports_no_arithmetic():
    code = "".join(
        _COMMAND.format(words=words) for words in (["--help"], *([name, "--help"] for name in COMMANDS))
    )
    names, printed = imported(code, HEAVY + ARITHMETIC)
    assert names == []
    assert [name for name in COMMANDS if f"tssgeom {name} " not in printed] == []
