"""A listening socket: who connects is counted and asked for the token."""

from __future__ import annotations

import json
import selectors
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic

from tssgeom.errors import SourceError
from tssgeom.io.network.addresses import Access, Endpoint, resolved
from tssgeom.io.network.channel import READ, Channel

MOST_PEERS = 16
"""Connections to one socket at a time."""
MOST_NEW = 50
"""New connections to one socket in one second."""
PATIENCE = 5.0
"""Time in which a client has to show the token [s]."""

_HELD = 1 << 17  # bytes that the system holds for a client, so that a slow one is noticed
_LONGEST_GREETING = 2048  # bytes in which the token has to come


@dataclass(slots=True)
class Peer:
    """A client that has connected."""

    name: str
    channel: Channel
    since: float
    admitted: bool
    greeting: bytes = b""
    received: Callable[[bytes], object] = field(default=len)
    """What to do with what it sends, once it is admitted."""
    ended: Callable[[], object] = lambda: None
    """What to do when it has closed the connection in order."""


def socket_error(endpoint: Endpoint, error: OSError) -> SourceError:
    """Say that a socket could not be made."""
    what = error.strerror or str(error)
    return SourceError(f"{endpoint.text}: {what}: choose another port, or end what holds it")


class Listener:
    """A socket on which clients connect.

    Parameters
    ----------
    selector
        Calls back what is registered with it.
    endpoint
        Where to listen; port 0 is any that is free.
    allowed
        Who may connect.
    connected
        Called with each client that is admitted; it sets `received`, and `ended` where that matters.
    tell
        Called with a sentence for the user.
    shown
        Finds the token in the first bytes of a client, with what follows it; None as long as it is not whole.
    farewell
        Packs the line that says why a client is cut off, where it is not sent as it is.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        endpoint: Endpoint,
        allowed: Access,
        *,
        connected: Callable[[Peer], object],
        tell: Callable[[str], object],
        shown: Callable[[bytes], tuple[bytes, bytes] | None],
        farewell: Callable[[bytes], bytes] = bytes,
    ) -> None:
        family, address = resolved(endpoint, allowed, socket.SOCK_STREAM)
        try:
            self._socket = socket.create_server(address, family=family, backlog=MOST_PEERS)
        except OSError as error:
            raise socket_error(endpoint, error) from error
        self._socket.setblocking(False)
        self.text = endpoint.at(self._socket.getsockname())
        self.peers = list[Peer]()
        self._selector, self._allowed, self._tell = selector, allowed, tell
        self._connected, self._shown, self._packed = connected, shown, farewell
        self._second, self._new = 0.0, 0
        selector.register(self._socket, READ, self._accept)

    @property
    def admitted(self) -> list[Peer]:
        """The clients that have shown the token, or need none."""
        return [peer for peer in self.peers if peer.admitted]

    def cut(self, peer: Peer, reason: str) -> None:
        """Tell a client, if it listens, and the user why it is cut off, and do it."""
        self._tell(f"{self.text}: {peer.name} cut off: {reason}")
        peer.channel.send(self._farewell(reason))
        peer.channel.close()
        self._forget(peer)

    def tick(self) -> None:
        """Cut off who has not shown the token in time."""
        for peer in [peer for peer in self.peers if not peer.admitted]:
            if monotonic() - peer.since > PATIENCE:
                self.cut(peer, f"no token within {PATIENCE:g} s")

    def close(self) -> None:
        """Close the socket and all connections."""
        self._selector.unregister(self._socket)
        self._socket.close()
        for peer in self.peers:
            peer.channel.close()

    def _accept(self, events: int) -> None:
        try:
            sock, address = self._socket.accept()
        except OSError:  # it has gone again
            return
        name = f"{address[0]}:{address[1]}"
        if reason := self._full():
            self._tell(f"{self.text}: {name} refused: {reason}")
            sock.setblocking(False)
            with suppress(OSError):
                sock.send(self._farewell(reason))
            sock.close()
            return
        with suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _HELD)
        channel = Channel(
            self._selector,
            sock,
            lambda data: self._received(peer, data),
            lambda: self._forget(peer),
            ended=lambda: peer.ended(),
        )
        peer = Peer(name, channel, monotonic(), admitted=not self._allowed.token)
        self.peers.append(peer)
        if peer.admitted:
            self._connected(peer)

    def _full(self) -> str:
        """Say why no further client is let in now; nothing where it is."""
        second = monotonic() // 1.0
        self._new = self._new + 1 if second == self._second else 1
        self._second = second
        if len(self.peers) >= MOST_PEERS:
            return f"{MOST_PEERS} clients are connected, which is the most"
        return f"more than {MOST_NEW} connections in a second" if self._new > MOST_NEW else ""

    def _received(self, peer: Peer, data: bytes) -> None:
        if peer.admitted:
            peer.received(data)
            return
        peer.greeting += data
        found = self._shown(peer.greeting)
        if found is None:
            if len(peer.greeting) > _LONGEST_GREETING:
                self.cut(peer, "the token has to come first, as a line of its own")
            return
        token, rest = found
        if not self._allowed.admits(token):
            self.cut(peer, "wrong token")
            return
        peer.admitted, peer.greeting = True, b""
        self._connected(peer)
        if rest:
            peer.received(rest)

    def _forget(self, peer: Peer) -> None:
        if peer in self.peers:  # a farewell may have found it gone
            self.peers.remove(peer)

    def _farewell(self, reason: str) -> bytes:
        return self._packed(json.dumps({"closed": reason}).encode() + b"\n")


def first_line(greeting: bytes) -> tuple[bytes, bytes] | None:
    """Split the first line from what follows; None as long as it has not ended."""
    line, end, rest = greeting.partition(b"\n")
    return (line, rest) if end else None
