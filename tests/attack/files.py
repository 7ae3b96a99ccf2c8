"""The attack by files, `python -m tests.attack.files [--long]`. Counts hangs, tracebacks, memory, lost."""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from tests.attack.bombs import BOMBS, RUN, SOUND, bombs, specials
from tests.attack.mutations import CORPUS, mutations
from tests.attack.names import make_named
from tests.attack.trial import attempt

_SHORT = {
    "rows.parquet",
    "points.vtp",
    "one_frame.npz",
    "corner.xlsx",
    "deep.toml",
    "deep.jsonl",
    "names.csv",
}
"""Bombs of the short form: one of each kind."""
_WARM = (
    ["analyse", SOUND, "--json", "--lumen", CORPUS / "settings" / "lumen.ply"],
    ["check", CORPUS / "points.xlsx", CORPUS / "points.mat", CORPUS / "shape.mcap", CORPUS / "settings"],
    ["check", CORPUS / "settings" / "cameras.toml", RUN],
)
"""Commands that import what each case needs, before it is measured."""

Cases = Iterable[tuple[str, list[str | Path]]]


def attacked(cases: Cases, faults: Counter[str], most: int | None = None) -> int:
    """Run each case, print and count its faults; a slow one counts if it is slow twice. Return the number."""
    number = 0
    for number, (name, command) in enumerate(cases, start=1):
        observed = attempt(command).faults()
        if any(fault.startswith("hang") for fault in observed):
            observed = attempt(command).faults()
        for fault in observed:
            faults[fault.split()[0]] += 1
            print(f"{name}: {fault}: tssgeom {' '.join(map(repr, map(str, command)))}")  # noqa: T201
        if number == most:
            break
    return number


def named(folder: Path, faults: Counter[str]) -> int:
    """Analyse shapes under hostile names in one batch; a shape without a result is lost."""
    made = make_named(folder / "in")
    out = folder / "out"
    ending = attempt(["batch", folder / "in", *made, "--out", out, "--no-pictures", "--workers", "1"], 60.0)
    sources = json.loads((out / "run.json").read_text("utf-8"))["inputs"] if ending.status == 0 else []
    faults["lost"] += len(made) - len(sources)
    for fault in ending.faults():
        faults[fault.split()[0]] += 1
    if attempt(["verify", out]).status != 0:
        faults["lost"] += 1
    return len(made)


def warmed() -> None:
    """Import in this process what its forks need, so that it is not measured."""
    for command in _WARM:
        _quietly(command)


def _quietly(command: list[str | Path]) -> None:
    """Run a command in this process, so that its forks have imported what it needs."""
    from pipelines.cli import main as tssgeom

    silence = io.StringIO()
    with (
        contextlib.redirect_stdout(silence),
        contextlib.redirect_stderr(silence),
        contextlib.suppress(SystemExit),
    ):
        tssgeom([str(each) for each in command])


def main() -> int:
    """Run the attack, and return 1 where anything happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--long", action="store_true", help="10 000 mutations, every bomb and special file")
    parser.add_argument("--seed", type=int, default=26)
    parser.add_argument("--mutations", type=int)
    options = parser.parse_args()
    warmed()
    faults, counts = Counter[str](), dict[str, int]()
    with tempfile.TemporaryDirectory() as home:
        folders = [Path(home, name) for name in ("bombs", "special", "mutations", "names/in")]
        for folder in folders:
            folder.mkdir(parents=True)
        chosen = BOMBS if options.long else {name: BOMBS[name] for name in BOMBS if name in _SHORT}
        counts["bombs"] = attacked(bombs(folders[0], chosen), faults)
        counts["special files"] = attacked(specials(folders[1]), faults, None if options.long else 30)
        counts["names"] = named(folders[3].parent, faults)
        many = options.mutations or (10_000 if options.long else 100)
        counts["mutations"] = attacked(mutations(folders[2], many, options.seed), faults)
    print(", ".join(f"{count} {what}" for what, count in counts.items()))  # noqa: T201
    print("faults: " + (", ".join(f"{count} {what}" for what, count in (+faults).items()) or "none"))  # noqa: T201
    return int(bool(+faults))


if __name__ == "__main__":
    raise SystemExit(main())
