"""Storage of files and results: on this machine, or at any address of `pyarrow.fs`."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from shutil import copyfileobj
from typing import TYPE_CHECKING, Any

from tssgeom.atomic import remove_drafts, replacing, temporary_folder
from tssgeom.errors import SourceError, first_line, require_utf8, unwritable

if TYPE_CHECKING:
    import pyarrow.fs as pafs

_BLOCK = 1 << 20  # bytes that are copied at a time


def local(address: str) -> Path | None:
    """Return the path of an address on this machine; None for one elsewhere.

    Raises SourceError where the address cannot be reached.
    """
    if "://" not in address:
        return Path(address)
    import pyarrow.fs as pafs

    system, path = _reached(address)
    return Path(path) if isinstance(system, pafs.LocalFileSystem) else None


def _reached(address: str) -> tuple[pafs.FileSystem, str]:
    import pyarrow.fs as pafs

    try:
        return pafs.FileSystem.from_uri(address)
    except (OSError, ValueError, ImportError) as error:
        raise SourceError(f"{address}: cannot be reached ({first_line(error)}): check the address") from error


def files_at(address: str) -> list[tuple[str, int]]:
    """Return address and size [B] of every file at an address elsewhere: itself, or all below a folder.

    Hidden files, and those in hidden folders, are left out.

    Raises SourceError where the address cannot be listed.
    """
    import pyarrow.fs as pafs

    system, path = _reached(address)
    try:
        info = system.get_file_info(path)
        if info.type is pafs.FileType.File:
            return [(address, info.size)]
        below = system.get_file_info(pafs.FileSelector(path, recursive=True))
    except OSError as error:
        raise SourceError(f"{address}: cannot be listed ({error}): check the address") from error
    named = [(PurePosixPath(each.path).relative_to(path), each) for each in below]
    return sorted(
        (f"{address.rstrip('/')}/{name.as_posix()}", each.size)
        for name, each in named
        if each.type is pafs.FileType.File and not any(part.startswith(".") for part in name.parts)
    )


@contextmanager
def fetched(address: str) -> Iterator[Path]:
    """Yield a file on this machine with the content of an address; of one elsewhere, a temporary copy.

    Raises SourceError where it cannot be read.
    """
    here = local(address)
    if here is not None:
        yield here
        return
    system, path = _reached(address)
    with temporary_folder() as folder:
        copy = folder / PurePosixPath(path).name
        try:
            with system.open_input_stream(path) as source, copy.open("wb") as target:
                copyfileobj(source, target, _BLOCK)
        except OSError as error:
            raise SourceError(f"{address}: cannot be read ({error}): check the address") from error
        yield copy


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder for results; its files are complete or absent."""

    address: str
    """An absolute path, or an address."""

    @classmethod
    def of(cls, address: str) -> Folder:
        """Return a folder by its absolute path, which holds for a process with another working folder too."""
        require_utf8(address)
        here = local(address)
        return cls(address.rstrip("/") if here is None else str(here.absolute()))

    @property
    def here(self) -> Path | None:
        """The folder, where it is on this machine."""
        return local(self.address)

    @contextmanager
    def replacing(self, name: str) -> Iterator[Path]:
        """Yield a path to write to; on leaving, its content replaces the file `name`.

        Raises SourceError where it cannot be written; SpaceError where the disk is full.
        """
        if self.here is not None:
            with replacing(self.here / name) as draft:
                yield draft
            return
        with temporary_folder() as folder:
            draft = folder / PurePosixPath(name).name
            yield draft
            self._send(draft, name)

    def _send(self, draft: Path, name: str) -> None:
        system, path = _reached(self.address)
        target = PurePosixPath(path) / name
        unfinished = str(target.with_name(f".{target.name}.part"))
        try:
            system.create_dir(str(target.parent))
            with draft.open("rb") as source, system.open_output_stream(unfinished) as stream:
                copyfileobj(source, stream, _BLOCK)
            system.move(unfinished, str(target))
        except OSError as error:
            raise unwritable(f"{self.address}/{name}", error) from error

    def read(self, name: str) -> bytes | None:
        """Return the content of a file; None where there is none."""
        try:
            if self.here is not None:
                return (self.here / name).read_bytes()
            system, path = _reached(self.address)
            with system.open_input_stream(f"{path}/{name}") as file:
                return file.readall()
        except OSError:
            return None

    def size(self, name: str) -> int | None:
        """Return the size of a file [B]; None where there is none."""
        if self.here is not None:
            file = self.here / name
            return file.stat().st_size if file.is_file() else None
        import pyarrow.fs as pafs

        system, path = _reached(self.address)
        info = system.get_file_info(f"{path}/{name}")
        return info.size if info.type is pafs.FileType.File else None

    def sha256(self, name: str) -> str | None:
        """Return the SHA-256 of a file as hexadecimal digits; None where there is none that can be read."""
        digest = hashlib.sha256()
        try:
            with self._opened(name) as file:
                while block := file.read(_BLOCK):
                    digest.update(block)
        except OSError:
            return None
        return digest.hexdigest()

    def _opened(self, name: str) -> Any:
        if self.here is not None:
            return (self.here / name).open("rb")
        system, path = _reached(self.address)
        return system.open_input_stream(f"{path}/{name}")

    def names(self, below: str) -> list[str]:
        """Return the files in the folder `below`, as names that the other methods take."""
        if self.here is not None:
            inside = self.here / below
            return sorted(f"{below}/{file.name}" for file in inside.iterdir()) if inside.is_dir() else []
        import pyarrow.fs as pafs

        system, path = _reached(self.address)
        inside = pafs.FileSelector(f"{path}/{below}", allow_not_found=True)
        return sorted(f"{below}/{info.base_name}" for info in system.get_file_info(inside))

    def remove(self, names: Iterable[str]) -> None:
        """Remove the files that exist and lie in this folder.

        Raises SourceError where they cannot be removed.
        """
        for name in names:
            if ".." in PurePosixPath(name).parts or name.startswith("/"):
                continue
            try:
                self._remove(name)
            except OSError as error:
                raise SourceError(
                    f"{self.address}/{name}: cannot be removed ({error}): check the folder"
                ) from error

    def _remove(self, name: str) -> None:
        if self.here is not None:
            (self.here / name).unlink(missing_ok=True)
            return
        system, path = _reached(self.address)
        with suppress(FileNotFoundError):
            system.delete_file(f"{path}/{name}")

    def tidy(self, below: Iterable[str]) -> None:
        """Remove the drafts of killed processes from some of its folders, and then empty folders."""
        here = self.here
        if here is None:
            return
        for name in below:
            remove_drafts(here / name)
            with suppress(OSError):
                (here / name).rmdir()  # succeeds only where the folder is empty
