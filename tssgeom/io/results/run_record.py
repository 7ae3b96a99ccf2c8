"""Records of a batch: `run.json` of a whole run, and a note of each input, so that a stopped run goes on."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from tssgeom.errors import SourceError, unreadable, unwritable
from tssgeom.io.formats.files import RESULTS_MARK, UNFINISHED_MARK
from tssgeom.io.formats.paths import kept_while_unchanged, reading, split
from tssgeom.io.storage import Folder
from tssgeom.rig import Rig

if TYPE_CHECKING:
    from filelock import FileLock

HIDDEN = UNFINISHED_MARK
"""Folder of the notes, inside that of the results."""
ANY_SIZE = -1
"""Replaces the size of a file that differs slightly each time it is written."""
_NOTES = f"{HIDDEN}/done"
Note = TypeVar("Note")


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """Options that the user chose."""

    tension_in_N: float
    """Proximal tension where a file brings none [N]."""
    unit: str | None
    """Unit of files that state none; null where it is not given."""
    rig_file: str | None
    """File of the rig; null for the defaults."""
    rig: Rig
    """The rig, with the keys of its file."""
    geometry_only: bool = False
    """True with `--geometry-only`."""
    pictures: bool = True
    """False with `--no-pictures`."""
    tube_radius_m: float = 0.0
    """Outer radius of the tube [m]."""
    columns: dict[str, str] = {}
    """Columns that are renamed, with `--columns`."""


class Input(msgspec.Struct, frozen=True, kw_only=True):
    """One analysed input."""

    name: str
    """Name of the outputs."""
    source: str
    """The input, relative to the working folder."""
    sha256: str
    """SHA-256 of its content."""
    kind: str
    """Format."""
    unit: str
    """Unit of length in the file."""
    frames: int
    """Frames [1]."""
    rejected: int
    """Frames that could not be used [1]."""


class Rejection(msgspec.Struct, frozen=True, kw_only=True):
    """One rejected input, or a failure beside the tables of an analysed one."""

    source: str
    """The input, relative to the working folder."""
    reason: str
    """Why."""


class Counts(msgspec.Struct, frozen=True):
    """Inputs and frames, analysed and rejected."""

    inputs: int
    """Inputs that were analysed [1]."""
    inputs_rejected: int
    """Inputs that were rejected, and failures [1]."""
    frames: int
    """Frames of the analysed inputs [1]."""
    frames_rejected: int
    """Frames of them that could not be used [1]."""


class RunRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Everything in `run.json`."""

    version: str
    """Version of tssgeom."""
    settings: Settings
    """Options that the user chose."""
    inputs: Sequence[Input]
    """Inputs that were analysed."""
    rejected: Sequence[Rejection]
    """Inputs that were rejected, and failures."""
    files: Sequence[str]
    """Files that the run wrote, relative to its folder."""
    sha256: Mapping[str, str] = {}
    """SHA-256 of each of them but the recordings, which differ slightly each time they are written."""
    left_out: Mapping[str, int] = {}
    """Files in folders of the inputs that no reader takes [1], by their endings."""


class RunFile(RunRecord, frozen=True, kw_only=True):
    """The record of a batch."""

    counts: Counts
    """Sums over all inputs."""


def write_run(folder: Folder, record: RunRecord) -> None:
    """Write `run.json`; raises SourceError where the disk refuses."""
    frames, refused = (sum(getattr(each, key) for each in record.inputs) for key in ("frames", "rejected"))
    counts = Counts(len(record.inputs), len(record.rejected), frames, refused)
    content = RunFile(**msgspec.structs.asdict(record), counts=counts)
    text = msgspec.json.format(msgspec.json.encode(content), indent=2).decode()
    with folder.replacing(RESULTS_MARK) as draft:
        draft.write_text(text + "\n", encoding="utf-8", newline="\n")


def remove_earlier_run(folder: Folder) -> None:
    """Remove the files that `run.json` of an earlier run lists, and `run.json` itself; nothing else.

    Raises SourceError where there is a `run.json` that is no record of a run, or the disk refuses.
    """
    record = earlier_run(folder)
    if record is not None:
        folder.remove([*record.files, RESULTS_MARK])


def earlier_run(folder: Folder) -> RunRecord | None:
    """Return the record in a folder; None where there is no `run.json`.

    Raises SourceError where `run.json` is no record of a run.
    """
    text = folder.read(RESULTS_MARK)
    if text is None:
        return None
    try:
        return msgspec.json.decode(text, type=RunRecord)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise SourceError(
            f"{folder.address}/{RESULTS_MARK}: no record of a run ({error}): remove it yourself"
        ) from error


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits; of a part, that of its file.

    Of a folder, it is that of a list of its files, each with its own SHA-256, in the order of names.

    Raises SourceError where the file cannot be read.
    """
    file, _ = split(path)
    try:
        if not file.is_dir():
            return _sha256(file)
        listed = [(each.relative_to(file).as_posix(), each) for each in file.rglob("*") if each.is_file()]
        lines = "".join(f"{_digest(each)}  {name}\n" for name, each in sorted(listed))
        return hashlib.sha256(lines.encode(errors="surrogateescape")).hexdigest()
    except OSError as error:
        raise unreadable(file, error) from error


def _digest(file: Path) -> str:
    with reading(file), file.open("rb") as held:
        return hashlib.file_digest(held, "sha256").hexdigest()


_sha256 = kept_while_unchanged(_digest)


class Done(msgspec.Struct, frozen=True, kw_only=True):
    """The note of one input whose files are written, with its parts of summary, output and report."""

    key: str
    """Digest of the input and of everything else that the results depend on."""
    input: Input
    row: dict[str, Any]
    """Its row in the summary."""
    printed: dict[str, Any] = msgspec.field(name="told")
    """Its object in JSON."""
    lines: Sequence[str]
    """Messages about its rejected frames, a line each."""
    reading: Sequence[str] = ()
    """How the file was read, where its names are not those of the formats."""
    unused: Sequence[str] = ()
    """Names of `--map` that the file does not have."""
    failures: Sequence[str]
    """Failures beside the tables, a line each."""
    report: dict[str, Any]
    """Its part of the report."""
    files: Mapping[str, int]
    """Written files with their sizes [B] or `ANY_SIZE`."""
    sha256: Mapping[str, str] = {}
    """SHA-256 of each of them whose size is noted."""
    figures: Mapping[str, int] = {}
    """The same in the folder for figures, where there is one."""


class _Begun(msgspec.Struct, frozen=True):
    """What a note has from the beginning on: the files that there may be."""

    files: Mapping[str, int] = {}


def key_of(parts: Mapping[str, Any]) -> str:
    """Return a digest of everything that the results of an input depend on."""
    return hashlib.sha256(msgspec.json.encode(parts, order="deterministic")).hexdigest()


def noted(folder: Folder, name: str) -> Done | None:
    """Return the note of an input that is done; None where there is none that can be read."""
    return _noted(folder, name, Done)


def _noted(folder: Folder, name: str, kind: type[Note]) -> Note | None:
    text = folder.read(f"{_NOTES}/{name}.json")
    try:
        return None if text is None else msgspec.json.decode(text, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None


def intact(folder: Folder, files: Mapping[str, int], sha256: Mapping[str, str]) -> bool:
    """Whether the files of an input exist, each with the size and the SHA-256 that it had when written."""
    sizes = {name: folder.size(name) for name in files}
    return all(
        sizes[name] is not None and size in (ANY_SIZE, sizes[name]) for name, size in files.items()
    ) and not damaged(folder, sha256)


def damaged(folder: Folder, sha256: Mapping[str, str]) -> list[str]:
    """Return the files whose SHA-256 is not as it was when they were written."""
    return [name for name, digest in sha256.items() if folder.sha256(name) != digest]


def note(folder: Folder, name: str, done: Done) -> None:
    """Note an input whose files are all written; raises SourceError where the disk refuses."""
    with folder.replacing(f"{_NOTES}/{name}.json") as draft:
        draft.write_bytes(msgspec.json.encode(done))


def begin(folder: Folder, name: str, files: Sequence[str]) -> None:
    """Remove what an earlier batch wrote of an input, and note the files that are about to be written.

    Raises SourceError where the disk refuses.
    """
    forget(folder, name)
    with folder.replacing(f"{_NOTES}/{name}.json") as draft:
        draft.write_bytes(msgspec.json.encode(_Begun(dict.fromkeys(files, ANY_SIZE))))


def forget(folder: Folder, name: str) -> None:
    """Remove the files of an input, finished or not, then its note, so that no file of it remains."""
    before = _noted(folder, name, _Begun)
    folder.remove([] if before is None else list(before.files))
    folder.remove([f"{_NOTES}/{name}.json"])


def forget_all(folder: Folder, but: Collection[str] = ()) -> None:
    """Remove the files and the notes of every input, but of those with a name in `but`."""
    for file in folder.names(_NOTES):
        if (name := PurePosixPath(file).name.removesuffix(".json")) not in but:
            forget(folder, name)


@contextmanager
def locked(folder: Folder) -> Iterator[None]:
    """Lock a folder against other runs; the end of a process frees it. A folder elsewhere has no lock.

    Raises SourceError where another run writes there, or where the folder cannot be made.
    """
    if folder.here is None:
        yield
        return
    notes = folder.here / HIDDEN
    lock = _acquired(folder, notes)
    try:
        yield
    finally:
        lock.release()
        _remove_if_empty(notes, folder.here)


def _acquired(folder: Folder, notes: Path) -> FileLock:
    from filelock import FileLock, Timeout  # here: only a batch takes the lock

    try:
        notes.mkdir(parents=True, exist_ok=True)
        lock = FileLock(notes / "lock", timeout=0)
        lock.acquire()
    except Timeout as error:
        raise SourceError(
            f"{folder.address}: another batch is writing there: wait for it, or give another --out"
        ) from error
    except OSError as error:
        raise unwritable(folder.address, error) from error
    return lock


def _remove_if_empty(notes: Path, folder: Path) -> None:
    """Remove a folder to which no run has written."""
    if notes.is_dir() and {file.name for file in notes.iterdir()} <= {"lock"}:
        with suppress(OSError):
            (notes / "lock").unlink(missing_ok=True)
            notes.rmdir()
            folder.rmdir()
