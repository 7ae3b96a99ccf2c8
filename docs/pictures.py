"""Take the pictures of README and docs again, from the samples, as a user would.

    python docs/pictures.py      # needs a Vulkan driver: apt-get install mesa-vulkan-drivers

It runs `machines.py` and `architecture.py` as well. The site makes its own figures at each build.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).parent
SAMPLES = DOCS.parent / "sample_shapes"


def main() -> None:
    """Analyse three samples, and write a picture of one recording and one of two side by side."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        shapes = [SAMPLES / f"{name}.csv" for name in ("colon_fibre", "setup_a", "setup_b")]
        tssgeom("analyse", *shapes, "--out", out, "--quiet")
        recordings = [out / f"{shape.stem}.rrd" for shape in shapes]
        for name, of in (("tension_map", recordings[:1]), ("compare", recordings[1:])):
            tssgeom("view", *of, "--screenshot", DOCS / f"{name}.png", "--clean")
    for script in ("machines.py", "architecture.py"):
        subprocess.run([sys.executable, DOCS / script], check=True)


def tssgeom(*arguments: object) -> None:
    """Run the command that is installed beside this Python."""
    command = Path(sys.executable).with_name("tssgeom")
    subprocess.run([command, *map(str, arguments)], check=True)


if __name__ == "__main__":
    main()
