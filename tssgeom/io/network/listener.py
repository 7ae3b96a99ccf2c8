"""A listening socket: clients are counted, and admitted by their token."""

from __future__ import annotations

import json
import math
import re
import selectors
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic

from tssgeom.errors import SourceError
from tssgeom.io.network.addresses import LONGEST_TOKEN, Access, Endpoint, resolved
from tssgeom.io.network.channel import READ, Channel


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of one listening socket, so that no client disturbs the others."""

    peers: int = 16
    """Connections at a time; chosen: displays and recorders of one experiment."""
    new_per_second: int = 50
    """New connections in one second; chosen: a client that reconnects at once is refused."""
    silent_s: float = 5.0
    """Time in which a client has to send its token, and silence after which a sender gives way to a new one
    where no more are admitted [s]; chosen."""
    send_buffer_bytes: int = 1 << 17
    """Bytes that the system buffers for a client; chosen: small, so that a slow client is detected."""


LIMITS = ConnectionLimits()

# how a request begins, and neither a token nor a frame does
_HTTP = re.compile(rb"\s*[A-Za-z]{3,20} (?:[/*]|\S+ HTTP/)")


@dataclass(slots=True)
class Peer:
    """A client that has connected."""

    name: str
    channel: Channel
    since: float
    admitted: bool
    greeting: bytes = b""
    """Its first bytes, up to the end of the token or of the first line."""
    received: Callable[[bytes], object] = field(default=len)
    """Called with its bytes once it is admitted."""
    ended: Callable[[], object] = lambda: None
    """Called when it has closed the connection in order."""
    gone: Callable[[], object] = lambda: None
    """Called when the connection is closed, by whichever side."""
    has_to_wait: Callable[[], bool] = lambda: False
    """Whether others come first: what it has sent is not read yet."""
    heard: float = -math.inf
    """When its last bytes came [s]."""
    greeted: bool = False
    """Whether its first line is complete and no request of HTTP."""


def socket_error(endpoint: Endpoint, error: OSError) -> SourceError:
    """Return the error to raise where a socket could not be made."""
    what = error.strerror or str(error)
    return SourceError(f"{endpoint.text}: {what}: choose another port, or end the program that holds it")


class Listener:
    """A socket on which clients connect.

    Parameters
    ----------
    selector
        Calls the functions that are registered with it.
    endpoint
        Address of the socket; port 0 is any free port.
    allowed
        Permission to connect.
    connected
        Called with each client that is admitted; it sets `received` and, if needed, `ended`.
    report
        Called with a sentence for the user.
    split_token
        Splits the first bytes of a client into token and rest; None as long as the token is incomplete.
    purpose
        What a client has to do, for one that takes it for a web server.
    pack
        Packs the line with the reason for which a client is cut off.
    longest_silence
        Time [s] after which the client that is silent for longest gives way to a new one, where no more are
        admitted.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        endpoint: Endpoint,
        allowed: Access,
        *,
        connected: Callable[[Peer], object],
        report: Callable[[str], object],
        split_token: Callable[[bytes], tuple[bytes, bytes] | None],
        purpose: str,
        pack: Callable[[bytes], bytes] = bytes,
        longest_silence: float = math.inf,
    ) -> None:
        self._longest_silence, self._purpose = longest_silence, purpose
        family, address = resolved(endpoint, allowed, socket.SOCK_STREAM)
        try:
            self._socket = socket.create_server(address, family=family, backlog=LIMITS.peers)
        except OSError as error:
            raise socket_error(endpoint, error) from error
        self._socket.setblocking(False)
        self.text = endpoint.at(self._socket.getsockname())
        self.peers = list[Peer]()
        self._selector, self._allowed, self._report = selector, allowed, report
        self._connected, self._split_token, self._pack = connected, split_token, pack
        self._second, self._new = 0.0, 0
        selector.register(self._socket, READ, self._accept)

    @property
    def admitted(self) -> list[Peer]:
        """The clients that have sent the token, or need none."""
        return [peer for peer in self.peers if peer.admitted]

    def cut(self, peer: Peer, reason: str) -> None:
        """Close the connection of a client; it and the user get the reason."""
        self._report(f"{self.text}: {peer.name} cut off: {reason}")
        peer.channel.send(self._farewell(reason))
        peer.channel.close(drain=True)
        self._forget(peer)

    def tick(self) -> None:
        """Cut off clients that have not sent the token in time."""
        for peer in [peer for peer in self.peers if not peer.admitted]:
            if monotonic() - peer.since > LIMITS.silent_s:
                self.cut(peer, f"no token within {LIMITS.silent_s:g} s")

    def close(self) -> None:
        """Close the socket and all connections."""
        self._selector.unregister(self._socket)
        self._socket.close()
        for peer in self.peers:
            peer.channel.close()

    def _accept(self, events: int) -> None:
        try:
            sock, address = self._socket.accept()
        except OSError:  # the client has closed it again
            return
        name = f"{address[0]}:{address[1]}"
        self._make_room()
        if reason := self._full():
            self._report(f"{self.text}: {name} refused: {reason}")
            sock.setblocking(False)
            with suppress(OSError):
                sock.send(self._farewell(reason))
            sock.close()
            return
        with suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, LIMITS.send_buffer_bytes)
        channel = Channel(
            self._selector,
            sock,
            lambda data: self._received(peer, data),
            lambda: self._forget(peer),
            ended=lambda: peer.ended(),
            has_to_wait=lambda: peer.has_to_wait(),
        )
        peer = Peer(name, channel, monotonic(), admitted=not self._allowed.token)
        self.peers.append(peer)
        if peer.admitted:
            self._connected(peer)

    def _make_room(self) -> None:
        """Where no more clients are admitted, cut off the one that is silent for longest, if for too long."""
        if len(self.peers) < LIMITS.peers:
            return
        silent = min(self.peers, key=lambda peer: max(peer.heard, peer.since))
        if monotonic() - max(silent.heard, silent.since) > self._longest_silence:
            self.cut(
                silent, f"silent for {self._longest_silence:g} s, and another client needs its connection"
            )

    def _full(self) -> str:
        """Return why no further client is admitted now; empty where one is."""
        second = monotonic() // 1.0
        self._new = self._new + 1 if second == self._second else 1
        self._second = second
        if len(self.peers) >= LIMITS.peers:
            return f"{LIMITS.peers} clients are connected, which is the most"
        most = LIMITS.new_per_second
        return f"more than {most} connections in a second" if self._new > most else ""

    def _received(self, peer: Peer, data: bytes) -> None:
        peer.heard = monotonic()
        if not (peer.greeted and peer.admitted):
            peer.greeting += data
        if not peer.greeted:
            peer.greeted = b"\n" in peer.greeting.lstrip() or len(peer.greeting) > 2 * LONGEST_TOKEN
            if _HTTP.match(peer.greeting):  # nothing of it is read, and its body is no frame
                if peer.greeted:
                    self.cut(peer, f"this is no web server: {self._purpose}")
                return
        if peer.admitted:
            peer.received(data)
            return
        parts = self._split_token(peer.greeting)
        if parts is None:
            if len(peer.greeting) > 2 * LONGEST_TOKEN:
                self.cut(peer, "the token has to come first, as a line of its own")
            return
        token, rest = parts
        if not self._allowed.admits(token):
            self.cut(peer, "wrong token")
            return
        peer.admitted, peer.greeting = True, b""
        self._connected(peer)
        if rest:
            peer.received(rest)

    def _forget(self, peer: Peer) -> None:
        if peer in self.peers:  # sending the reason may have failed and removed it
            self.peers.remove(peer)
            peer.gone()

    def _farewell(self, reason: str) -> bytes:
        return self._pack(json.dumps({"closed": reason}).encode() + b"\n")


def first_line(greeting: bytes) -> tuple[bytes, bytes] | None:
    """Split the first line from what follows; None as long as it has not ended."""
    line, end, rest = greeting.partition(b"\n")
    return (line, rest) if end else None
