"""`run.json`: how results came about, and what an earlier run left in a folder."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from tssgeom.errors import SourceError
from tssgeom.io.formats.files import RESULTS_MARK
from tssgeom.io.formats.names import split
from tssgeom.io.storage import Folder
from tssgeom.rig import Rig


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What the user chose."""

    tension_in_N: float
    unit: str | None
    rig_file: str | None
    rig: Rig
    geometry_only: bool = False
    pictures: bool = True
    tube_radius_m: float = 0.0


class Input(msgspec.Struct, frozen=True, kw_only=True):
    """One input that was done."""

    name: str
    source: str
    sha256: str
    kind: str
    unit: str
    frames: int
    rejected: int


class Rejection(msgspec.Struct, frozen=True, kw_only=True):
    """One input that was rejected, or what went wrong beside one that was done."""

    source: str
    reason: str


class RunRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Everything in `run.json`."""

    version: str
    settings: Settings
    inputs: Sequence[Input]
    rejected: Sequence[Rejection]
    files: Sequence[str]
    """What the run wrote, relative to its folder."""

    @property
    def counts(self) -> dict[str, int]:
        """Inputs and frames, done and rejected."""
        return {
            "inputs": len(self.inputs),
            "inputs_rejected": len(self.rejected),
            "frames": sum(item.frames for item in self.inputs),
            "frames_rejected": sum(item.rejected for item in self.inputs),
        }


def write_run(folder: Folder, record: RunRecord) -> None:
    """Write `run.json`, whole or not at all.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    content: dict[str, Any] = {**msgspec.to_builtins(record), "counts": record.counts}
    text = msgspec.json.format(msgspec.json.encode(content), indent=2).decode()
    with folder.replacing(RESULTS_MARK) as draft:
        draft.write_text(text + "\n", encoding="utf-8", newline="\n")


def remove_earlier_run(folder: Folder) -> None:
    """Remove the files that `run.json` of an earlier run lists, and `run.json` itself; nothing else.

    Raises
    ------
    SourceError
        Where there is a `run.json` that is no record of a run, or the disk refuses.
    """
    text = folder.read(RESULTS_MARK)
    if text is None:
        return
    try:
        record = msgspec.json.decode(text, type=RunRecord)
    except msgspec.MsgspecError as error:
        raise SourceError(
            f"{folder.address}/{RESULTS_MARK}: no record of a run ({error}): remove it yourself"
        ) from error
    folder.remove([*record.files, RESULTS_MARK])


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits; of a part, that of its file.

    Of a folder, it is that of a list of its files, each with its own SHA-256, in the order of names.

    Raises
    ------
    SourceError
        Where the file cannot be read.
    """
    file, _ = split(path)
    try:
        if not file.is_dir():
            return _sha256(file)
        listed = [(each.relative_to(file).as_posix(), each) for each in file.rglob("*") if each.is_file()]
        lines = "".join(f"{_sha256(each)}  {name}\n" for name, each in sorted(listed))
        return hashlib.sha256(lines.encode()).hexdigest()
    except OSError as error:
        raise SourceError(f"{file}: cannot be read ({error.strerror}): check the path") from error


def _sha256(file: Path) -> str:
    with file.open("rb") as held:
        return hashlib.file_digest(held, "sha256").hexdigest()
