"""The picture of the layers in README is that of the contract, and the code keeps it."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from tests.view.layout import faults

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "docs" / "architecture.py"


def checked(script: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True, check=False)


def a_copy(folder: Path, contract: str, code: str) -> Path:
    """Write a project of one upper and one lower room beside the picture of this one."""
    (folder / "docs").mkdir()
    (folder / "tssgeom").mkdir()
    (folder / "pyproject.toml").write_text(contract)
    (folder / "tssgeom" / "upper.py").write_text("")
    (folder / "tssgeom" / "lower.py").write_text(code)
    script = folder / "docs" / SCRIPT.name
    script.write_bytes(SCRIPT.read_bytes())
    return script


CONTRACT = """
[[tool.importlinter.contracts]]
type = "layers"
layers = ["tssgeom.upper", "tssgeom.lower"]
ignore_imports = []
"""


def test_the_picture_shows_the_layers_of_the_contract_and_the_code_keeps_them():
    done = checked(SCRIPT)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_picture_of_other_layers_and_an_import_upwards_are_reported(tmp_path):
    script = a_copy(tmp_path, CONTRACT, "from tssgeom import upper\n")
    (script.parent / "architecture.png").write_bytes(SCRIPT.with_suffix(".png").read_bytes())
    done = checked(script)
    assert done.returncode == 1
    assert "the contract has [['tssgeom.upper'], ['tssgeom.lower']]" in done.stderr
    assert "tssgeom.lower imports tssgeom.upper, which is no layer below it" in done.stderr


GENERATED = {"_declarations.py", "_entries.py"}


@pytest.mark.parametrize("folder", ["tssgeom", "pipelines", "benchmarks", "docs", "tests"])
def test_no_file_of_code_has_more_than_350_lines(folder):
    files = [path for kind in ("*.py", "*.c", "*.h", "*.inl") for path in (ROOT / folder).rglob(kind)]
    lines = {path: path.read_text("utf-8").count("\n") for path in files if path.name not in GENERATED}
    assert {path: count for path, count in lines.items() if count > 350} == {}


def test_the_picture_knows_its_layers_by_itself():
    with Image.open(SCRIPT.with_suffix(".png")) as picture:
        assert json.loads(picture.info["layers"])[-1] == ["tssgeom.errors"]


def test_no_text_of_the_picture_overlaps_another_or_leaves_it():
    spec = importlib.util.spec_from_file_location("architecture", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert [fault for fault in faults(module.draw()) if "is empty" not in fault] == []
