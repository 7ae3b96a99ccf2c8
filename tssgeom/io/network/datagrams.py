"""A source of frames in datagrams; each sender has a queue of its own, in the system and in the mailbox."""

from __future__ import annotations

import selectors
import socket
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from time import monotonic, perf_counter_ns

from tssgeom.engine import Track
from tssgeom.io.formats.jsonl import frame_or_refusal
from tssgeom.io.network.addresses import Access, Endpoint, resolved
from tssgeom.io.network.channel import READ
from tssgeom.io.network.listener import socket_error
from tssgeom.io.network.mailbox import LIMITS as FRAMES
from tssgeom.io.network.mailbox import Mailbox, Sender
from tssgeom.io.network.sources import Source

_LOST = 40  # SO_RXQ_OVFL of Linux: counts the datagrams without room


@dataclass(frozen=True, slots=True)
class DatagramLimits:
    """Limits of a socket that receives datagrams."""

    reading_ns: int = 250_000
    """Time after which a socket is left for others while datagrams still wait there [ns]; derived: a
    twentieth of the 5 ms in which frames are to be answered, and enough for some 25 datagrams."""
    senders: int = 64
    """Senders whose clocks are kept; chosen."""


DATAGRAMS = DatagramLimits()
_LARGEST = 1 << 16  # bytes of a datagram: its length is a field of 16 bits (RFC 768)
_OF_ONE = FRAMES.waiting * _LARGEST  # bytes of the buffer of one sender: as many as its mailbox keeps
_OF_ALL = 4 * _OF_ONE  # bytes of the buffer of all others together


@dataclass(slots=True, eq=False)
class _Socket:
    """A socket, whose turn it is when datagrams are there, and how many of them the system has dropped."""

    sock: socket.socket
    of: Sender
    """The sender that it receives from; of the common one, the newest."""
    lost: int = 0


@dataclass(slots=True, eq=False)
class _Peer:
    """One address that sends."""

    sender: Sender = field(default_factory=Sender)
    heard: float = 0.0
    """When its last datagram came [s]."""
    own: _Socket | None = None
    """The socket that receives from it alone."""


class UdpSource(Source):
    """A frame as JSON in each datagram; a required token is its first line.

    On Linux a sender that goes on gets a socket of its own, connected to it: the flood of another one then
    fills another buffer.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        mailbox: Mailbox,
        endpoint: Endpoint,
        allowed: Access,
        unit: str | None,
    ) -> None:
        family, address = resolved(endpoint, allowed, socket.SOCK_DGRAM)
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.bind(address)
        except OSError as error:
            sock.close()
            raise socket_error(endpoint, error) from error
        self._linux = sys.platform == "linux"
        self.text = endpoint.at(sock.getsockname())
        self._mailbox, self._allowed, self._unit = mailbox, allowed, unit
        self._selector = selector
        self._peers = dict[tuple, _Peer]()
        self._common = self._watched(sock, Sender(), _OF_ALL)

    def close(self) -> None:
        """Close the sockets."""
        for peer in self._peers.values():
            self._forget(peer)
        self._forget(_Peer(own=self._common))

    def _watched(self, sock: socket.socket, of: Sender, size: int) -> _Socket:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
        if self._linux:
            sock.setsockopt(socket.SOL_SOCKET, _LOST, 1)
        watched = _Socket(sock, of)
        self._selector.register(sock, READ, partial(self._ready, watched))
        return watched

    def _ready(self, of: _Socket, events: int) -> None:
        if self._linux and self._mailbox.is_behind(of.of):
            return
        begun, sender = perf_counter_ns(), None
        while perf_counter_ns() - begun < DATAGRAMS.reading_ns:
            try:
                data, about, _, address = of.sock.recvmsg(_LARGEST, 64 if self._linux else 0)
            except OSError:  # nothing waits, or the socket was closed for a newer sender
                break
            self._count_lost(of, about)
            sender = self._received(data, address) or sender
        if sender is not None:  # the time that a flood takes to be read is its own too
            self._mailbox.charge(sender, 1e-9 * (perf_counter_ns() - begun))

    def _count_lost(self, of: _Socket, about: list[tuple[int, int, bytes]]) -> None:
        """Count the datagrams without room in the system's buffer as dropped."""
        for _, kind, value in about:
            if kind == _LOST:
                lost = int.from_bytes(value[:4], sys.byteorder)
                self._mailbox.skip((lost - of.lost) & 0xFFFFFFFF)
                of.lost = lost

    def _received(self, data: bytes, address: tuple) -> Sender | None:
        """Take in a datagram, and return its sender; None where it counts for nothing."""
        if self._allowed.token:
            token, _, data = data.partition(b"\n")
            if not self._allowed.admits(token):
                return None  # a sender without the token gets no answer and no count
        if not (data := data.strip()):
            return None
        peer = self._peers.get(address)
        if peer is None:
            peer = self._begun(address)
        elif peer.own is None and self._linux:
            with suppress(OSError):  # it shares the common one then
                peer.own = self._connected(address, peer.sender)
        peer.heard = monotonic()
        self._mailbox.post(peer.sender, partial(frame_or_refusal, data, self._unit))
        return peer.sender

    def _begun(self, address: tuple) -> _Peer:
        """Make a new sender; where more are known than are kept, the one that is silent for longest goes."""
        if len(self._peers) >= DATAGRAMS.senders:
            silent = min(self._peers, key=lambda one: self._peers[one].heard)
            gone = self._peers.pop(silent)
            self._forget(gone)
            self._mailbox.forget(gone.sender)
        before, peer = self._common.of, _Peer()
        if before.arrived == 1 and not before.pending:  # a program that sends each frame from another port
            peer.sender.track, before.track = before.track, Track()
        self._peers[address] = peer
        self._common.of = peer.sender
        return peer

    def _connected(self, address: tuple, sender: Sender) -> _Socket:
        """Make a socket for one sender; only while it is made may another one be bound to the port."""
        common = self._common.sock
        sock = socket.socket(common.family, socket.SOCK_DGRAM)
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            common.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(common.getsockname())
            sock.connect(address)
        except OSError:
            sock.close()
            raise
        finally:
            common.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
        return self._watched(sock, sender, _OF_ONE)

    def _forget(self, peer: _Peer) -> None:
        if peer.own is not None:
            self._selector.unregister(peer.own.sock)
            peer.own.sock.close()
