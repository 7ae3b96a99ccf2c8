"""A Rerun file that grows while frames come in, and stays readable when the disk is full."""

from __future__ import annotations

import os
import struct
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

import rerun as rr

from tssgeom.atomic import replacing
from tssgeom.errors import SourceError, require_replaceable
from tssgeom.view.scene.viewer import binary

_START = b"RRF2\x00)\x00\x00\x01\x02\x00\x00"  # of every file: format, version, messages in protobuf
_MESSAGE = struct.Struct("<QQ")  # kind and bytes that follow
_END = 0  # kind of the message that ends a file, before its table of contents
_FLUSHED = 10.0  # s
_TIDY = 256 << 20  # bytes of a file that is put in order when it is finished
_TIDIED = 20.0  # s


class GrowingFile:
    """A recording that is written piece by piece beside its place, and moved there when it is finished.

    Rerun's own file sink blocks for ever once the disk is full; here what was written before stays whole.
    Where there is no room even to put it in order, it has no table of contents, and can be read all the same.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._part = path, path.with_name(f".{path.stem}.part{path.suffix}")
        try:
            require_replaceable(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._part.open("wb", buffering=0)
        except OSError as error:
            raise self._unwritten(error) from error
        self.recording = rr.RecordingStream(f"tssgeom: {path.stem}", recording_id=uuid4())
        self._stream = self.recording.binary_stream()
        self.recording.send_recording_name(path.stem)
        self._size, self._full = 0, False

    def write(self) -> None:
        """Write what was logged since the last time.

        Raises
        ------
        SourceError
            Where the disk refuses; from then on nothing is written.
        """
        data = logged(self._stream.read(flush_timeout_sec=_FLUSHED) or b"")
        if self._full:
            return
        try:
            self._append(data)
        except OSError as error:
            self._full = True
            raise self._unwritten(error) from error

    def finish(self) -> None:
        """Write the rest and put the file in its place.

        Raises
        ------
        SourceError
            Where the disk refuses.
        """
        try:
            self.write()
        finally:
            self._file.close()
            if self._size:
                self._tidy()
                os.replace(self._part, self._path)
            else:
                self._part.unlink(missing_ok=True)

    def _append(self, data: bytes) -> None:
        """Write messages; of those that find no room, none is written in part."""
        data, begin = (data, 0) if self._size else (_START + data, len(_START))
        written = 0
        try:
            with memoryview(data) as view:
                while written < len(view):
                    written += self._file.write(view[written:]) or 0
        except OSError:
            written = max((end for end in _ends(data, begin) if end <= written), default=0)
            with suppress(OSError):
                self._file.truncate(self._size + written)
            raise
        finally:
            self._size += written

    def _tidy(self) -> None:
        """Join the many small pieces and add a table of contents; a failure leaves the file as it is."""
        if self._size > _TIDY:
            return
        with suppress(SourceError, subprocess.SubprocessError), replacing(self._part) as draft:
            command = [binary(), "rrd", "optimize", str(self._part), "-o", str(draft)]
            subprocess.run(command, check=True, capture_output=True, timeout=_TIDIED)

    def _unwritten(self, error: OSError) -> SourceError:
        what = error.strerror or str(error)
        return SourceError(f"{self._path}: the recording ends here, it cannot be written ({what}): make room")


def logged(data: bytes) -> bytes:
    """Return what is logged in one reading of a binary stream of Rerun, without its start and its end.

    Each reading is a file of its own; what lies between start and end of all of them makes one file, which
    needs no table of contents.
    """
    return data[len(_START) : max(_ends(data, len(_START)), default=0)]


def _ends(data: bytes, at: int) -> Iterator[int]:
    """Yield where each of the messages that begin at `at` ends, up to what ends a file."""
    while at + _MESSAGE.size <= len(data):
        kind, size = _MESSAGE.unpack_from(data, at)
        if kind == _END:
            return
        at += _MESSAGE.size + size
        yield at
