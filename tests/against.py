"""Compare this tree with an earlier revision: every command on every sample, number by number.

    python -m tests.against REVISION             # exit status 1 where an output differs
    python -m tests.against REVISION --keep DIR  # keep both sets of outputs

A change of structure changes no result. Both revisions run the same commands in processes of their own; every
JSON object, table and rig that they write is compared. Numbers agree where they differ by at most `RELATIVE`
of their size or by `ABSOLUTE`, since two compilations may fuse a sum in different ways; text agrees exactly,
and keys may be added.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

ROOT = Path(__file__).parents[1]
RELATIVE, ABSOLUTE = 1e-6, 1e-12
SAMPLES = "sample_shapes"
SHAPES = " ".join(
    f"{SAMPLES}/{name}"
    for name in (
        "half_circle.csv",
        "setup_a.csv",
        "setup_b.csv",
        "helix.csv",
        "colon_markers.csv",
        "colon_fibre.csv",
    )
)
HIDDEN, SLACK = f"{SAMPLES}/campaign_hidden_bend", f"{SAMPLES}/campaign_slack_take_up"
CHAIN, RIG = f"{HIDDEN}/route_chain.csv", f"{HIDDEN}/rig.toml"
COMMANDS = {
    "analyse": f"analyse {SHAPES} {SAMPLES}/colon_fibre.csv {SAMPLES}/insertion.jsonl --json",
    "analyse_out": f"analyse {SAMPLES}/helix.csv --out OUT --export mrk.json,ply,csv --quiet",
    "batch": f"batch {SAMPLES} --out OUT --no-pictures --quiet",
    "check": f"check {SAMPLES}/half_circle.csv {SAMPLES}/insertion.jsonl {HIDDEN}/rig.toml --json",
    "simulate": f"simulate {CHAIN} --drive {HIDDEN}/chain.csv --rig {RIG} --out OUT",
    "simulate_moving": f"simulate {SAMPLES}/insertion.jsonl --drive {HIDDEN}/chain.csv --out OUT",
    "compensate": f"compensate {CHAIN} --target {HIDDEN}/chain.csv --out OUT",
    "calibrate": f"calibrate {HIDDEN}/chain.csv --shape {CHAIN} --out OUT/rig.toml",
    "discover_hidden": f"discover {HIDDEN} --out OUT",
    "discover_slack": f"discover {SLACK} --out OUT",
    "remedy": f"remedy --shape {SAMPLES}/setup_a.csv --json",
    "paper": "paper --out OUT --json",
    "live": "live --source replay:sample_shapes/insertion.jsonl?speed=100 --sink -",
}
IGNORED = {
    "latency_us",
    "dropped",
    "stale",
    "took_s",
    "seconds",
    "created",
    "version",
    "started",
    "finished",
    "program",
}


def ran(tree: Path, out: Path) -> dict[str, str]:
    """Run every command in a tree; return what each printed, its exit status first."""
    printed = {}
    env = {**os.environ, "PYTHONPATH": str(tree)}
    for name, line in COMMANDS.items():
        folder = out / name
        folder.mkdir(parents=True)
        words = [word.replace("OUT", str(folder)) for word in line.split()]
        done = subprocess.run(
            [sys.executable, "-m", "pipelines.cli", *words] if (tree / "pipelines/__main__.py").exists() else
            [sys.executable, "-c", "from pipelines.cli import main; main()", *words],
            cwd=tree, env=env, capture_output=True, text=True, check=False, timeout=1800,
        )  # fmt: skip
        printed[name] = f"{done.returncode}\n{done.stdout}"
        sys.stderr.write(f"{tree.name}: {name}: exit status {done.returncode}\n{done.stderr[-500:]}\n")
    return printed


def objects(name: str, printed: str) -> Any:
    """Return what a command printed as JSON where it is JSON, else its lines."""
    status, _, text = printed.partition("\n")
    try:
        return [status, json.loads(text)]
    except json.JSONDecodeError:
        lines = text.splitlines()
    if name == "live":
        return [status, [json.loads(line) for line in lines]]
    return [status]


def held(path: Path) -> Any:
    """Return what a file holds, or None where it is compared by no number (pictures, pages)."""
    if path.suffix == ".json":
        return json.loads(path.read_text(encoding="utf-8"))
    if path.suffix == ".toml":
        return tomllib.loads(path.read_text(encoding="utf-8"))
    if path.suffix == ".parquet":
        return pq.read_table(path).to_pylist()
    if path.suffix == ".ply":  # binary
        return path.read_bytes().hex()
    return path.read_text(encoding="utf-8").split() if path.suffix == ".csv" else None


def differences(where: str, one: Any, other: Any) -> Iterator[str]:
    """Yield each path at which two objects differ."""
    if isinstance(one, dict) and isinstance(other, dict):
        if lost := one.keys() - other.keys():
            yield f"{where}: keys are lost: {sorted(lost)}"
        for key in one.keys() & other.keys() - IGNORED:
            yield from differences(f"{where}.{key}", one[key], other[key])
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            yield f"{where}: {len(one)} and {len(other)} entries"
        for i, (a, b) in enumerate(zip(one, other, strict=False)):
            yield from differences(f"{where}[{i}]", a, b)
    elif isinstance(one, float) and isinstance(other, float):
        if not math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE) and not one != one != other:
            yield f"{where}: {one!r} and {other!r}"
    elif one != other:
        yield f"{where}: {one!r} and {other!r}"


def main() -> int:
    """Run both trees and print what differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("revision", help="a git revision, or a folder with an earlier tree")
    parser.add_argument("--keep", type=Path)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        before = Path(chosen.revision).resolve()
        if not before.is_dir():
            before = Path(folder) / "before"
            subprocess.run(["git", "clone", "-q", ROOT, before], check=True)
            subprocess.run(["git", "-C", before, "checkout", "-q", chosen.revision], check=True)
        kept = chosen.keep or Path(folder) / "out"
        old, new = ran(before, kept / "before"), ran(ROOT, kept / "now")
        results = [
            line
            for name in COMMANDS
            for line in differences(name, objects(name, old[name]), objects(name, new[name]))
        ]
        for path in sorted((kept / "before").rglob("*")):
            twin = kept / "now" / (inner := path.relative_to(kept / "before"))
            if not path.is_file() or (one := held(path)) is None:
                continue
            results += (
                [f"{inner}: missing"] if not twin.exists() else differences(str(inner), one, held(twin))
            )
    sys.stdout.write("".join(f"{line}\n" for line in results[:200]))
    sys.stdout.write(f"{len(COMMANDS)} commands, {len(results)} differences\n")
    return int(bool(results))


if __name__ == "__main__":
    sys.exit(main())
