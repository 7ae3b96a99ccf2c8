"""Where results go to: standard output, TCP clients and a UDP address. None of them is ever waited for."""

from __future__ import annotations

import selectors
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from tssgeom.io.network.addresses import Access, Endpoint, resolved
from tssgeom.io.network.channel import BACKLOG, Pipe
from tssgeom.io.network.listener import Listener, Peer, first_line
from tssgeom.stream import FrameResult

_LARGEST = 65_507  # bytes that a datagram carries
_SLOW = f"it has not read {BACKLOG} bytes of results (1 MiB) that wait for it"


class Sink(Protocol):
    """What a sink can do."""

    text: str
    """Its address, as it is told to the user."""

    @property
    def unsent(self) -> int:
        """Lines that found no room."""
        ...

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Send one line; `result` is what it tells, where it is the answer to a good frame."""
        ...

    def tick(self) -> None:
        """Do what is to be done once a while."""
        ...

    @property
    def waiting(self) -> bool:
        """Whether something is still to be sent."""
        ...

    @property
    def broken(self) -> bool:
        """Whether nobody can read from it any more."""
        ...

    def close(self) -> None:
        """Let go of sockets."""
        ...


class StandardOutput:
    """A line each on standard output; where it is not read, lines that find no room are given up."""

    text = "-"

    def __init__(self, selector: selectors.BaseSelector, fd: int = 1) -> None:
        self._pipe = Pipe(selector, fd)
        self.unsent = 0

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Write a line, or count it as not sent."""
        self.unsent += not self._pipe.send(line)

    def tick(self) -> None:
        """Nothing."""

    @property
    def waiting(self) -> bool:
        """Whether lines wait for the reader."""
        return self._pipe.waiting

    @property
    def broken(self) -> bool:
        """Whether the reader has gone."""
        return self._pipe.closed

    def close(self) -> None:
        """Nothing; the descriptor belongs to the process."""


class Nowhere:
    """Answers that nobody reads."""

    text = "none"
    unsent = 0
    waiting = broken = False

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Nothing."""

    def tick(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


class TcpSink:
    """Every line to each client, from its connection on; who does not read is cut off."""

    broken = False

    def __init__(
        self,
        selector: selectors.BaseSelector,
        endpoint: Endpoint,
        allowed: Access,
        tell: Callable[[str], object],
        *,
        shown: Callable[[bytes], tuple[bytes, bytes] | None] = first_line,
        farewell: Callable[[bytes], bytes] = bytes,
    ) -> None:
        self._listener = Listener(
            selector,
            endpoint,
            allowed,
            connected=lambda peer: None,
            tell=tell,
            shown=shown,
            farewell=farewell,
        )
        self.text = self._listener.text
        self.unsent = 0
        self.tick, self.close = self._listener.tick, self._listener.close

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Send a line to every client."""
        self.send(line, self._listener.admitted)

    def send(self, data: bytes, peers: list[Peer]) -> None:
        """Send to some clients, and cut off those who have left too much unread."""
        for peer in peers:
            if not peer.channel.send(data):
                self.unsent += 1
                if peer.channel.open:
                    self._listener.cut(peer, _SLOW)

    @property
    def peers(self) -> list[Peer]:
        """The clients that are admitted."""
        return self._listener.admitted

    @property
    def waiting(self) -> bool:
        """Whether a client still has to take something."""
        return any(peer.channel.waiting for peer in self._listener.admitted)


class UdpSink:
    """A line in each datagram; nobody knows whether it arrives."""

    broken = waiting = False

    def __init__(self, endpoint: Endpoint, allowed: Access) -> None:
        family, self._address = resolved(endpoint, allowed, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.text, self.unsent = endpoint.at(self._address), 0

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Send a datagram, or count it as not sent."""
        with suppress(OSError):
            if len(line) <= _LARGEST:
                self._socket.sendto(line, self._address)
                return
        self.unsent += 1

    def tick(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
