"""How a Rerun recording is opened and finished: a file written whole, a file that grows, a hosted stream."""

from __future__ import annotations

import os
import re
import socket
import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4
from zlib import crc32

import rerun as rr
import rerun.blueprint as rrb
from rerun_bindings import flush_and_cleanup_orphaned_recordings

from tssgeom.address_space import EACH, require_address_space
from tssgeom.atomic import replacing
from tssgeom.errors import SourceError, require_replaceable
from tssgeom.view.scene.viewer import binary

_START = b"RRF2\x00)\x00\x00\x01\x02\x00\x00"  # of every file: format, version, messages in protobuf
_MESSAGE = struct.Struct("<QQ")  # kind and bytes that follow
_END = 0  # kind of the message that ends a file, before its table of contents
_FLUSH_LIMIT = 10.0  # s, longest wait for what was sent
_OPTIMIZE_LARGEST = 256 << 20  # bytes: a larger file keeps its many small pieces when it is finished
_OPTIMIZE_LIMIT = 20.0  # s, longest wait for the pieces to be joined
_PROGRAM = "tssgeom: "
_HOSTED_MEMORY = "256MiB"  # of frames that a viewer which connects late still gets


@contextmanager
def recording_file(
    path: Path, name: str, layout: rrb.Blueprint, *, application: str | None = None
) -> Iterator[rr.RecordingStream]:
    """Yield a stream into a recording; on leaving, the file replaces an older one.

    Parameters
    ----------
    path
        The `.rrd` file.
    name
        Name of the recording in the viewer.
    layout
        The views that open with it.
    application
        Name under which the viewer remembers a changed layout; `name` after that of the program by default,
        so that each file keeps its camera.

    Raises
    ------
    SourceError
        Where the file cannot be written; SpaceError where the disk is full.
    """
    require_address_space(EACH, "a recording", ", or write no recordings")
    flush_and_cleanup_orphaned_recordings()  # of earlier ones; Rerun keeps their threads and their memory
    remembered = _application(application or f"{_PROGRAM}{name}")
    with replacing(path) as draft, rr.RecordingStream(remembered, recording_id=uuid4()) as recording:
        stream = recording.binary_stream()  # Rerun's own file sink blocks for ever once the disk is full
        send_layout(recording, layout, make_active=False)
        recording.send_recording_name(name)
        yield recording
        draft.write_bytes(stream.read() or b"")


def _application(name: str) -> str:
    """Return the name under which a viewer remembers the layout of a recording, of signs that Rerun takes."""
    plain = re.sub(r"[^A-Za-z0-9 :_-]", "-", name)
    return plain if plain == name else f"{plain}-{crc32(name.encode()):08x}"


def send_layout(recording: rr.RecordingStream, layout: rrb.Blueprint, *, make_active: bool = True) -> None:
    """Send the views of a recording, and let go of the stream by which Rerun sends them.

    That stream and its memory hold each other, so Rerun alone keeps two threads and 0.4 MiB of each layout.
    """
    given = _Layout(layout)
    recording.send_blueprint(given, make_active=make_active)  # pyright: ignore[reportArgumentType]
    given.stream.disconnect()


class _Layout:
    """Views that know the stream by which they are sent."""

    stream: rr.RecordingStream

    def __init__(self, layout: rrb.Blueprint) -> None:
        self._layout = layout

    def to_blueprint(self) -> _Layout:
        return self

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self.stream = stream
        self._layout._log_to_stream(stream)


def hosted(name: str, port: int) -> tuple[rr.RecordingStream, str]:
    """Host a stream to which viewers on this machine may connect; return it with its address.

    Raises SourceError where the port is taken.
    """
    try:  # Rerun itself goes on without a host, and what listens there may show another picture
        socket.create_server(("127.0.0.1", port)).close()
    except OSError as error:
        raise SourceError(
            f"--view: port {port}: {os.strerror(error.errno or 0)}: choose another with --view-port"
        ) from error
    remembered, often = _application(f"{_PROGRAM}{name}"), rr.ChunkBatcherConfig.LOW_LATENCY()
    recording = rr.RecordingStream(remembered, batcher_config=often)
    sink = rr.GrpcServerSink(bind_ip="127.0.0.1", port=port, server_memory_limit=_HOSTED_MEMORY)
    try:
        recording.set_sinks(sink)
    except (RuntimeError, ValueError, OSError) as error:
        raise SourceError(f"--view: port {port}: {error}: choose another with --view-port") from error
    recording.send_recording_name(name)
    return recording, sink.uri


class GrowingFile:
    """A recording that is written piece by piece to a hidden file, which gets its name when it is finished.

    What was written before the disk is full stays whole. Without room to join the pieces, the file has no
    table of contents, and can be read all the same.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._part = path, path.with_name(f".{path.stem}.part{path.suffix}")
        try:
            require_replaceable(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._part.open("wb", buffering=0)
        except OSError as error:
            raise self._unwritten(error) from error
        flush_and_cleanup_orphaned_recordings()  # as above
        self.recording = rr.RecordingStream(_application(f"{_PROGRAM}{path.stem}"), recording_id=uuid4())
        self._stream = self.recording.binary_stream()
        self.recording.send_recording_name(path.stem)
        self._size, self._full = 0, False

    def write(self) -> None:
        """Write what was logged since the last time.

        Raises SourceError where the disk refuses; from then on nothing is written.
        """
        data = logged(self._stream.read(flush_timeout_sec=_FLUSH_LIMIT) or b"")
        if self._full:
            return
        try:
            self._append(data)
        except OSError as error:
            self._full = True
            raise self._unwritten(error) from error

    @property
    def size(self) -> int:
        """Bytes in the file so far."""
        return self._size

    def finish(self) -> None:
        """Write the rest, give the file its name, and put it in order.

        Raises SourceError where the disk refuses.
        """
        self.close()
        self.optimize()

    def close(self) -> None:
        """Write the rest and give the file its name.

        Raises SourceError where the disk refuses, or the file was removed.
        """
        try:
            self.write()
        finally:
            with suppress(OSError):
                os.fsync(self._file.fileno())
            self._file.close()
            self._name()

    def _name(self) -> None:
        """Give the file its name; without content it is removed."""
        try:
            if self._size:
                os.replace(self._part, self._path)
            else:
                self._part.unlink(missing_ok=True)
        except OSError as error:
            raise self._unwritten(error) from error

    def optimize(self) -> None:
        """Join the many small pieces and add a table of contents; a failure leaves the file as it is."""
        if not 0 < self._size <= _OPTIMIZE_LARGEST:
            return
        with suppress(SourceError, subprocess.SubprocessError), replacing(self._path) as draft:
            command = [binary(), "rrd", "optimize", str(self._path), "-o", str(draft)]
            subprocess.run(command, check=True, capture_output=True, timeout=_OPTIMIZE_LIMIT)

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

    def _unwritten(self, error: OSError) -> SourceError:
        what, gone = error.strerror or str(error), isinstance(error, FileNotFoundError)
        hint = "leave the hidden file in which it grows" if gone else "make room"
        return SourceError(f"{self._path}: the recording ends here, it cannot be written ({what}): {hint}")


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
