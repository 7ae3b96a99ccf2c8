"""The picture of the machines and the table of what is assumed are those of the code."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parents[1] / "docs"
FILES = ("machines.py", "panel.py", "machines.md", "machines.png")


def checked(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, folder / "machines.py", "--check"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_picture_and_table_are_those_of_the_code():
    done = checked(DOCS)
    assert (done.returncode, done.stderr) == (0, "")


def test_unknown_names_an_old_picture_and_another_table_are_reported(tmp_path):
    for name in FILES:
        shutil.copy(DOCS / name, tmp_path)
    script, page = tmp_path / "machines.py", tmp_path / "machines.md"
    text = script.read_text("utf-8").replace('"drive.gear"', '"drive.ratio"')
    script.write_text(text.replace('"joint_torque_Nm"', '"joint_moment_Nm"'), "utf-8")
    page.write_text(page.read_text("utf-8").replace("| 0.15 |", "| 0.16 |"), "utf-8")
    done = checked(tmp_path)
    assert done.returncode == 1
    for part in ("drive.ratio is no key", "joint_moment_Nm is no channel", "other names", "another table"):
        assert part in done.stderr


def test_the_picture_knows_its_names_by_itself():
    with Image.open(DOCS / "machines.png") as picture:
        names = json.loads(picture.info["names"])
    assert {"drive.radius_m", "end.radius_m", "tendon.pretension_N"} <= set(names["keys"])
    assert {"motor_angle_rad", "joint_angle_rad", "tension_in_1_N"} <= set(names["channels"])
