"""Sinks of results: standard output, TCP clients and a UDP address. The stream waits for none of them."""

from __future__ import annotations

import selectors
import socket
from collections.abc import Callable
from contextlib import suppress

from tssgeom.io.network.addresses import Access, Endpoint, resolved
from tssgeom.io.network.channel import BACKLOG, Pipe
from tssgeom.io.network.listener import Listener, Peer, first_line, socket_error
from tssgeom.stream import FrameResult

_LARGEST_DATAGRAM = 65_507  # bytes of UDP over IPv4
_SLOW = f"it has not read {BACKLOG} bytes of results (1 MiB) that wait for it"


class Sink:
    """Answers to one address; the default methods discard them."""

    text: str = "none"
    """Its address, as the user reads it."""
    unsent: int = 0
    """Lines without room."""

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Send one line; `result` is the result that it holds, if it answers a good frame."""

    def tick(self) -> None:
        """Do periodic work."""

    @property
    def waiting(self) -> bool:
        """Whether bytes are still to be sent."""
        return False

    @property
    def broken(self) -> bool:
        """Whether its reader has closed it for good."""
        return False

    @property
    def failure(self) -> str:
        """Why the system refused to write to it; empty where it did not."""
        return ""

    def close(self) -> None:
        """Close sockets."""


class StandardOutput(Sink):
    """A line each on standard output; lines without room are dropped."""

    text = "-"

    def __init__(self, selector: selectors.BaseSelector, fd: int = 1) -> None:
        self._pipe = Pipe(selector, fd)

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Write a line, or count it as not sent."""
        self.unsent += not self._pipe.send(line)

    @property
    def waiting(self) -> bool:
        """Whether lines wait for the reader."""
        return self._pipe.waiting

    @property
    def broken(self) -> bool:
        """Whether the reader has closed it."""
        return self._pipe.closed

    @property
    def failure(self) -> str:
        """Why the system refused to write to it; empty where it did not."""
        return self._pipe.failure


class TcpSink(Sink):
    """Every line to each client, from its connection on; a slow client is cut off."""

    def __init__(
        self,
        selector: selectors.BaseSelector,
        endpoint: Endpoint,
        allowed: Access,
        report: Callable[[str], object],
        *,
        split_token: Callable[[bytes], tuple[bytes, bytes] | None] = first_line,
        pack: Callable[[bytes], bytes] = bytes,
    ) -> None:
        self._listener = Listener(
            selector,
            endpoint,
            allowed,
            connected=lambda peer: None,
            report=report,
            split_token=split_token,
            purpose="connect, and read answers as lines of JSON",
            pack=pack,
        )
        self.text = self._listener.text

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Send a line to every client."""
        self.send(line, self.peers)

    def send(self, data: bytes, peers: list[Peer]) -> None:
        """Send to some clients, and cut off those that have left too much unread."""
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
        """Whether bytes wait for a client."""
        return any(peer.channel.waiting for peer in self.peers)

    def tick(self) -> None:
        """Cut off clients without a token."""
        self._listener.tick()

    def close(self) -> None:
        """Close the socket and all connections."""
        self._listener.close()


class UdpSink(Sink):
    """A line in each datagram; its arrival is not confirmed.

    The socket is connected, so that it is bound to the one interface on which its datagrams leave.
    """

    def __init__(self, endpoint: Endpoint, allowed: Access) -> None:
        family, address = resolved(endpoint, allowed, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.connect(address)
        except OSError as error:
            self._socket.close()
            raise socket_error(endpoint, error) from error
        self._socket.setblocking(False)
        self.text = endpoint.at(address)

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Send a datagram, or count it as not sent."""
        if len(line) > _LARGEST_DATAGRAM:
            self.unsent += 1
            return
        for _ in range(2):  # the first may only report that nobody took the datagram before
            with suppress(OSError):
                self._socket.send(line)
                return
        self.unsent += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
