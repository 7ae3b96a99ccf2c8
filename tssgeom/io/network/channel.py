"""Bytes out without blocking: those that a peer does not take at once wait in a bounded buffer."""

from __future__ import annotations

import errno
import os
import select
import selectors
import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from itertools import islice

BACKLOG = 1 << 20
"""Largest number of bytes that wait for a peer, 1 MiB; chosen: some 1000 answers."""

_CHUNK = 1 << 18  # bytes that are received at once; chosen
_MOST_AT_ONCE = 64  # messages that are sent at once; chosen, far below the 1024 of the system

READ, WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE


class Channel:
    """A connected socket on a selector.

    Parameters
    ----------
    selector
        Calls the functions that are registered with it.
    sock
        Connected; it is made non-blocking.
    received
        Called with received bytes.
    gone
        Called once, when the peer has closed or broken the connection.
    backlog
        Largest number of bytes that wait for the peer.
    ended
        Called before `gone` where the peer has closed the connection in order, after its last byte.
    has_to_wait
        Whether other peers come first: what this one has sent is not read yet.
    """

    __slots__ = (
        "_backlog",
        "_ended",
        "_gone",
        "_has_to_wait",
        "_length",
        "_received",
        "_selector",
        "_waiting",
        "sock",
    )

    def __init__(
        self,
        selector: selectors.BaseSelector,
        sock: socket.socket,
        received: Callable[[bytes], object],
        gone: Callable[[], object],
        backlog: int = BACKLOG,
        ended: Callable[[], object] = lambda: None,
        has_to_wait: Callable[[], bool] = lambda: False,
    ) -> None:
        sock.setblocking(False)
        self.sock, self._selector = sock, selector
        self._received, self._gone, self._ended, self._has_to_wait = received, gone, ended, has_to_wait
        self._waiting, self._length, self._backlog = deque[bytes | memoryview](), 0, backlog
        selector.register(sock, READ, self._ready)

    @property
    def open(self) -> bool:
        """Whether the socket is still open."""
        return self.sock.fileno() >= 0

    @property
    def waiting(self) -> int:
        """Bytes that the peer has not taken yet."""
        return self._length

    def send(self, data: bytes) -> bool:
        """Send all or nothing of `data`, now or later; return whether there was room for it."""
        if not self.open:
            return False
        if self._length and self._length + len(data) > self._backlog:
            return False
        self._waiting.append(data)
        self._length += len(data)
        if len(self._waiting) == 1:
            self._send_waiting()
            if self._waiting and self.open:
                self._selector.modify(self.sock, READ | WRITE, self._ready)
        return True

    def close(self, *, drain: bool = False) -> None:
        """Close the socket; waiting bytes are lost.

        With `drain`, bytes that came and are not read are read first: a peer whose bytes are not read is
        reset by the system, and may lose the last line that it was sent.
        """
        if self.open:
            if drain:
                with suppress(OSError):
                    self.sock.recv(_CHUNK)
            self._selector.unregister(self.sock)
            self.sock.close()

    def _ready(self, events: int) -> None:
        if events & WRITE and self.open:
            self._send_waiting()
            if not self._waiting and self.open:
                self._selector.modify(self.sock, READ, self._ready)
        if events & READ and self.open and not self._has_to_wait():
            self._read()

    def _read(self) -> None:
        try:
            data = self.sock.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            self._lost()
            return
        if data:
            self._received(data)
        else:
            self._ended()
            self._lost()

    def _send_waiting(self) -> None:
        """Send what the system takes now; messages stay apart, since to join many takes milliseconds."""
        try:
            taken = self.sock.sendmsg(islice(self._waiting, _MOST_AT_ONCE))
        except BlockingIOError:
            return
        except OSError:
            self._lost()
            return
        self._length -= taken
        while self._waiting and taken >= len(self._waiting[0]):
            taken -= len(self._waiting.popleft())
        if taken:
            self._waiting[0] = memoryview(self._waiting[0])[taken:]

    def _lost(self) -> None:
        self.close()
        self._gone()


class Pipe:
    """Standard output or standard error: a pipe, a terminal or a file.

    The descriptor may be shared with other programs, so it stays blocking; it is written only while it polls
    as writable, in pieces that it then takes at once. Lines without room are refused.
    """

    __slots__ = ("_fd", "_poll", "_selector", "_waiting", "closed", "failure")

    def __init__(self, selector: selectors.BaseSelector, fd: int) -> None:
        self._selector, self._fd = selector, fd
        self._waiting = bytearray()
        self._poll = select.poll()
        self._poll.register(fd, select.POLLOUT)
        self.closed = False
        self.failure = ""

    def send(self, line: bytes) -> bool:
        """Write a line now or later; return whether there was room for it."""
        if self.closed or (self._waiting and len(self._waiting) + len(line) > BACKLOG):
            return False
        if self._waiting:
            self._waiting += line
            return True
        taken = self._written(line)
        if taken < len(line) and not self.closed:
            self._waiting += memoryview(line)[taken:]
            self._selector.register(self._fd, WRITE, self._ready)
        return not self.closed

    @property
    def waiting(self) -> bool:
        """Whether lines wait for the reader."""
        return bool(self._waiting) and not self.closed

    def _ready(self, events: int) -> None:
        del self._waiting[: self._written(self._waiting)]
        if not self._waiting or self.closed:
            with suppress(KeyError):
                self._selector.unregister(self._fd)

    def _written(self, data: bytes | bytearray) -> int:
        taken = 0
        with memoryview(data) as view:
            while taken < len(view) and self._poll.poll(0):
                try:
                    taken += os.write(self._fd, view[taken : taken + select.PIPE_BUF])
                except BlockingIOError:
                    break
                except OSError as error:
                    self.closed = True
                    if error.errno != errno.EPIPE:  # else the reader has closed it
                        self.failure = error.strerror or str(error)
                    return len(view)
        return taken
