"""Compare this tree with an earlier revision: every command on every sample, number by number.

    python -m tests.against REVISION             # exit status 1 where an output differs
    python -m tests.against REVISION --keep DIR  # keeps both sets of outputs; the earlier one is used again
    python -m tests.against REVISION --only calibrate,live --relative 1e-6

A change of structure changes no result. Both revisions run the same commands in processes of their own, with
the same interpreter and libraries. Every JSON object, table, rig and sample that they write is compared;
pictures and recordings are not. Numbers agree where they differ by at most `--relative` of their size, since
two compilations may fuse a sum in different ways. Text agrees exactly, and keys may be added.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

ROOT = Path(__file__).parents[1]
RELATIVE, ABSOLUTE = 1e-13, 1e-18
S, M = "sample_shapes", "INPUTS"
ONES = ("half_circle", "setup_a", "setup_b", "setup_a_remedy", "helix", "colon_markers", "colon_fibre")
SHAPES = " ".join(f"{S}/{name}.csv" for name in ONES)
HIDDEN, SLACK = f"{S}/campaign_hidden_bend", f"{S}/campaign_slack_take_up"
CHAIN, RIG, DRIVE = f"{HIDDEN}/route_chain.csv", f"{HIDDEN}/rig.toml", f"{HIDDEN}/chain.csv"
TWO, JOINT = f"{M}/shape.csv", f"--rig {M}/rig.toml --out OUT"
LIVE = f"live --source replay:{S}/insertion.jsonl?speed=100 --sink -"
COMMANDS = {
    "analyse": f"analyse {SHAPES} {S}/insertion.jsonl --json",
    "analyse_table": f"analyse {SHAPES}",
    "analyse_out": f"analyse {S}/helix.csv --out OUT --export mrk.json,ply,csv,vtp --quiet",
    "analyse_lumen": f"analyse {S}/colon_fibre.csv --lumen {S}/colon_lumen.ply --tube-mm 12 --json",
    "analyse_same": f"analyse {S}/colon_fibre.csv {S}/colon_markers.csv --same --json",
    "batch": f"batch {S} --out OUT --no-pictures --quiet",
    "check": f"check {S}/half_circle.csv {S}/insertion.jsonl {RIG} {DRIVE} {HIDDEN} --json",
    "simulate": f"simulate {CHAIN} --drive {DRIVE} --rig {RIG} --out OUT --json",
    "simulate_moving": f"simulate {S}/insertion.jsonl --drive {DRIVE} --out OUT",
    "simulate_adapt": f"simulate {CHAIN} --drive {DRIVE} --rig {RIG} --adapt --out OUT",
    "simulate_machine": f"simulate {TWO} --drive {M}/drive.csv {JOINT} --json",
    "compensate": f"compensate {CHAIN} --target {DRIVE} --out OUT --json",
    "compensate_machine": f"compensate {TWO} --target {M}/target.csv {JOINT}",
    "calibrate": f"calibrate {DRIVE} --shape {CHAIN} --out OUT --json",
    "calibrate_angle": f"calibrate {DRIVE} --angle-from-run --rig {RIG} --out OUT/rig.toml --json --force",
    "calibrate_pieces": f"calibrate {DRIVE} --shape {CHAIN} --rig {RIG} --every 20 --out OUT --json",
    "calibrate_machine": f"calibrate {M}/run.csv --shape {TWO} --rig {M}/unknown.toml --out OUT --json",
    "discover_hidden": f"discover {HIDDEN} --out OUT",
    "discover_propose": f"discover {SLACK} --out OUT --propose 1 --json",
    "remedy": f"remedy --shape {S}/setup_a.csv --json",
    "paper": "paper --out OUT --json",
    "samples": "samples --out OUT",
    "live": LIVE,
    "live_adapt": f"{LIVE} --adapt --write-rig OUT/rig.toml --state OUT/state.json",
}
"""Options by command; `OUT` is a folder of its own, `INPUTS` that of `machine_inputs`."""
IGNORED = {
    *("latency_us", "dropped", "stale", "took_s", "seconds", "created", "version", "started", "finished"),
    *("program", "sha256", "path", "file", "files", "command", "host", "machine", "python"),
}
MACHINE = """
tendon = {pretension_N = 6}
drive = {kind = "pair", radius_m = 0.01}
end = {kind = "joint", radius_m = 0.008, stiffness_Nm_per_rad = 0.2}
route = {length_m = 0.5, angle_rad = 3.0}
"""


def machine_inputs(folder: Path) -> None:
    """Write a rig of two tendons and a joint, a shape, and runs for it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rig.toml").write_text(MACHINE)
    (folder / "unknown.toml").write_text(MACHINE.replace("pretension_N = 6", 'pretension_N = "unknown"'))
    turn, time = [i / 40 for i in range(121)], [i / 10 for i in range(241)]
    motor = [0.9 * math.sin(t) * (0.8 + 0.2 * math.sin(t / 4)) for t in time]
    arc = [(math.sin(a) / 6, (1 - math.cos(a)) / 6, 0.0) for a in turn]
    slip = [math.tanh(8 * math.cos(t)) for t in time]
    joint = [0.7 * a + 0.05 * way for a, way in zip(motor, slip, strict=True)]
    torque = [0.15 * a + 0.03 * way for a, way in zip(motor, slip, strict=True)]
    tables = {
        "shape": dict(zip(("x_m", "y_m", "z_m"), zip(*arc, strict=True), strict=True)),
        "drive": {"time_s": time, "motor_angle_rad": motor},
        "target": {"time_s": time, "joint_angle_deg": [20 * math.sin(t) for t in time]},
        "run": {
            "time_s": time,
            "motor_angle_rad": motor,
            "joint_angle_rad": joint,
            "motor_torque_Nm": torque,
        },
    }
    for name, columns in tables.items():
        rows = [columns, *zip(*columns.values(), strict=True)]
        (folder / f"{name}.csv").write_text("".join(",".join(map(str, row)) + "\n" for row in rows))


def ran(tree: Path, out: Path, names: Sequence[str]) -> dict[str, str]:
    """Run the commands in a tree; return what each printed, its exit status first."""
    printed = {}
    env = {**os.environ, "PYTHONPATH": str(tree), "COLUMNS": "120"}
    for name in names:
        folder = out / name
        folder.mkdir(parents=True)
        line = COMMANDS[name].replace("INPUTS", str(out.parent / "inputs")).replace("OUT", str(folder))
        done = subprocess.run(
            [sys.executable, "-c", "from pipelines.cli import main; main()", *line.split()],
            cwd=tree, env=env, capture_output=True, text=True, check=False, timeout=1800,
        )  # fmt: skip
        printed[name] = f"{done.returncode}\n{done.stdout}"
        lines = [line for line in done.stderr.splitlines() if not line.startswith("[")]
        sys.stderr.write("\n".join((f"{out.name}: {name}: {done.returncode}", *lines[-3:], "")))
    return printed


def objects(printed: str) -> Any:
    """Return what a command printed as JSON, as JSON lines, or else as words."""
    status, _, text = printed.partition("\n")
    for read in (json.loads, lambda lines: [json.loads(line) for line in lines.splitlines()]):
        try:
            return [status, read(text)]
        except json.JSONDecodeError:
            continue
    return [status, text.split()]


def held(path: Path, root: Path) -> Any:
    """Return what a file holds, or None where it is compared by no number (pictures, pages, recordings)."""
    if path.suffix in (".json", ".jsonl"):
        return objects(f"\n{path.read_text(encoding='utf-8').replace(str(root), '')}")
    if path.suffix == ".toml":
        return tomllib.loads(path.read_text(encoding="utf-8"))
    if path.suffix == ".parquet":
        return pq.read_table(path).to_pylist()
    if path.suffix in (".ply", ".glb", ".vtp"):  # binary
        return path.read_bytes().hex()
    return path.read_text(encoding="utf-8").split() if path.suffix in (".csv", ".md") else None


def differences(where: str, one: Any, other: Any, relative: float) -> Iterator[str]:
    """Yield each path at which two objects differ."""
    if isinstance(one, dict) and isinstance(other, dict):
        if lost := one.keys() - other.keys():
            yield f"{where}: keys are lost: {sorted(lost)}"
        for key in one.keys() & other.keys() - IGNORED:
            yield from differences(f"{where}.{key}", one[key], other[key], relative)
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            yield f"{where}: {len(one)} and {len(other)} entries"
        for i, (a, b) in enumerate(zip(one, other, strict=False)):
            yield from differences(f"{where}[{i}]", a, b, relative)
    elif isinstance(one, float) and isinstance(other, float):
        if not math.isclose(one, other, rel_tol=relative, abs_tol=ABSOLUTE) and not one != one != other:
            yield f"{where}: {one!r} and {other!r}"
    elif one != other:
        yield f"{where}: {str(one)[:80]!r} and {str(other)[:80]!r}"


def compared(
    before: Path, now: Path, old: dict[str, str], new: dict[str, str], relative: float
) -> Iterator[str]:
    """Yield what differs between two sets of outputs, command by command."""
    for name in new:
        one, other = (text.replace(str(root), "") for text, root in ((old[name], before), (new[name], now)))
        yield from differences(name, objects(one), objects(other), relative)
        for path in sorted((before / name).rglob("*")):
            twin = now / (inner := path.relative_to(before))
            if path.is_file() and not twin.exists():
                yield f"{inner}: missing"
            elif path.is_file() and (one := held(path, before)) is not None:
                yield from differences(str(inner), one, held(twin, now), relative)


def main() -> int:
    """Run both trees and print what differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("revision", help="a git revision, or a folder with an earlier tree")
    parser.add_argument("--keep", type=Path, help="folder for both sets of outputs")
    parser.add_argument("--only", help="names of commands, with commas")
    parser.add_argument("--relative", type=float, default=RELATIVE, help="difference of numbers that agree")
    chosen = parser.parse_args()
    names = chosen.only.split(",") if chosen.only else list(COMMANDS)
    with tempfile.TemporaryDirectory() as folder:
        kept = (chosen.keep or Path(folder) / "out").resolve()
        before, now, printed = kept / "before", kept / "now", kept / "before.json"
        old: dict[str, str] = json.loads(printed.read_text()) if printed.exists() else {}
        machine_inputs(kept / "inputs")
        if missing := [name for name in names if name not in old]:
            tree = Path(chosen.revision).resolve()
            if not tree.is_dir():
                tree = Path(folder) / "tree"
                subprocess.run(["git", "clone", "-q", ROOT, tree], check=True)
                subprocess.run(["git", "-C", tree, "checkout", "-q", chosen.revision], check=True)
            old |= ran(tree, before, missing)
            printed.write_text(json.dumps(old))
        shutil.rmtree(now, ignore_errors=True)
        results = list(compared(before, now, old, ran(ROOT, now, names), chosen.relative))
    sys.stdout.write("".join(f"{line}\n" for line in results[:200]))
    sys.stdout.write(f"{len(names)} commands, {len(results)} differences\n")
    return int(bool(results))


if __name__ == "__main__":
    sys.exit(main())
