"""`tssgeom live`: shapes in as they are sensed, tension and elongation out within a millisecond."""

from __future__ import annotations

import gc
import json
import math
import os
import selectors
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from pipelines.live_numbers import StatusLine
from pipelines.live_session import Beside, Session
from pipelines.live_warm import warm_up
from pipelines.live_workers import Allowance, Artists, Keeper, Worker, await_ready, finished
from pipelines.work import Options
from tssgeom.errors import require_replaceable
from tssgeom.io.formats.states import read_state
from tssgeom.io.network.addresses import Access, Endpoint
from tssgeom.io.network.channel import READ, Pipe
from tssgeom.io.network.mailbox import Mailbox
from tssgeom.io.network.sinks import Nowhere, Sink, StandardOutput, TcpSink, UdpSink
from tssgeom.io.network.sources import Replay, Source, StandardInput, TcpSource, UdpSource
from tssgeom.stream import process

_RECORDED = (100.0, 200.0)  # pictures in a recording: so many a second, so many at once
_VIEWED = (25.0, 50.0)


@dataclass(frozen=True, slots=True)
class Stream:
    """What the user asked for."""

    sources: Sequence[Endpoint]
    sinks: Sequence[Endpoint]
    access: Access
    stale_after: float
    """Time without a good frame after which that is said [s]."""
    spin: bool
    """Whether to await the next frame without sleep while frames come fast, which takes a core."""
    stats: bool
    """Whether the numbers are told once a second as JSON on stderr."""
    state: Path | None = None
    """Where the tendon's state is kept from one start to the next."""
    record: Path | None = None
    """Recording to write."""
    view_port: int | None = None
    """Port at which viewers may connect; None: no picture."""


def run(stream: Stream, chosen: Options) -> int:
    """Answer frames until the sources end or the process is told to; return the exit status.

    Raises
    ------
    SettingsError, ShapeError, SourceError
        Where a source, a sink or a file cannot be opened.
    """
    for path in filter(None, (stream.state, stream.record)):
        require_replaceable(path)
    with selectors.DefaultSelector() as selector:
        errors = Pipe(selector, 2)
        tell = _teller(errors)
        mailbox = Mailbox()
        session = Session(
            selector,
            mailbox,
            [_source(one, selector, mailbox, stream.access, chosen.unit, tell) for one in stream.sources],
            [_sink(one, selector, stream.access, tell) for one in stream.sinks],
            stream.stale_after,
            lambda: None,
            spin=stream.spin and (os.cpu_count() or 1) > 1,
        )
        state = read_state(stream.state) if stream.state is not None and stream.state.exists() else None
        if state is not None and math.isfinite(state.time):
            session.time = state.time
        besides, workers = _besides(stream, selector, tell)
        session.besides = besides
        session.ticked, finish = _told(session, workers, errors, stats=stream.stats)
        try:
            warm_up(chosen.rig)
            await_ready(selector, workers)
            _stopped_by_signals(session)
            gc.collect()  # before ready is said: it takes longer than many frames
            gc.freeze()
            gc.disable()
            errors.send(f"ready: {_addresses(session, workers)}\n".encode())
            for result in process(session.frames(), chosen.rig, tension_in=chosen.tension_in, state=state):
                session.answer(result)
        finally:
            session.close()
            sound = finished(selector, workers)
        finish()
    return 0 if sound else 1


def _besides(
    stream: Stream, selector: selectors.BaseSelector, tell: Callable[[str], None]
) -> tuple[list[Beside], list[Worker]]:
    """Start the processes beside the stream."""
    besides = list[Beside]()
    if stream.state is not None:
        besides.append(Keeper(Worker(selector, "save", str(stream.state), tell)))
    artists = list[tuple[Worker, Allowance]]()
    if stream.record is not None:
        artists.append((Worker(selector, "record", str(stream.record), tell), Allowance(*_RECORDED)))
    if stream.view_port is not None:
        artists.append((Worker(selector, "view", str(stream.view_port), tell), Allowance(*_VIEWED)))
    if artists:
        besides.append(Artists(artists))
    keepers = [one.worker for one in besides if isinstance(one, Keeper)]
    return besides, [*keepers, *(worker for worker, _ in artists)]


def _addresses(session: Session, workers: Sequence[Worker]) -> str:
    sources = (f"source {source.text}" for source in session.sources)
    sinks = (f"sink {sink.text}" for sink in session.sinks)
    views = (f"view {worker.address}" for worker in workers if worker.address)
    return ", ".join([*sources, *sinks, *views])


def _teller(errors: Pipe) -> Callable[[str], None]:
    def tell(sentence: str) -> None:
        errors.send(f"tssgeom: {sentence}\n".encode())

    return tell


def _source(
    endpoint: Endpoint,
    selector: selectors.BaseSelector,
    mailbox: Mailbox,
    access: Access,
    unit: str | None,
    tell: Callable[[str], None],
) -> Source:
    if endpoint.scheme == "tcp":
        return TcpSource(selector, mailbox, endpoint, access, unit, tell)
    if endpoint.scheme == "udp":
        return UdpSource(selector, mailbox, endpoint, access, unit)
    if endpoint.scheme == "igtl":
        from tssgeom.io.network.igtl_peers import IgtlSource  # here, since few need it

        return IgtlSource(selector, mailbox, endpoint, access, tell)
    if endpoint.scheme == "replay":
        return Replay(mailbox, endpoint, unit)
    return StandardInput(selector, mailbox, unit)


def _sink(
    endpoint: Endpoint, selector: selectors.BaseSelector, access: Access, tell: Callable[[str], None]
) -> Sink:
    if endpoint.scheme == "tcp":
        return TcpSink(selector, endpoint, access, tell)
    if endpoint.scheme == "udp":
        return UdpSink(endpoint, access)
    if endpoint.scheme == "igtl":
        from tssgeom.io.network.igtl_peers import IgtlSink

        return IgtlSink(selector, endpoint, access, tell)
    return Nowhere() if endpoint.scheme == "none" else StandardOutput(selector)


def _told(
    session: Session, workers: Sequence[Worker], errors: Pipe, *, stats: bool
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return what tells the numbers once a second, and what ends that."""
    status = StatusLine() if sys.stderr.isatty() and not stats else None

    def ticked() -> None:
        counts = {
            "dropped": session.mailbox.dropped,
            "unsent": sum(sink.unsent for sink in session.sinks),
        } | {f"{worker.role}_lost": worker.lost for worker in workers}
        numbers = session.numbers.told(counts)
        if stats:
            errors.send(json.dumps(numbers).encode() + b"\n")
        if status is not None:
            status.show(numbers)

    def finish() -> None:
        ticked()
        if status is not None:
            status.close()

    return ticked, finish


def _stopped_by_signals(session: Session) -> None:
    """Let SIGTERM and Ctrl-C end the stream; the second of them ends it at once."""
    woken, wake = socket.socketpair()
    woken.setblocking(False)
    wake.setblocking(False)
    session.selector.register(woken, READ, lambda events: woken.recv(64))
    signal.set_wakeup_fd(wake.detach(), warn_on_full_buffer=False)

    def stop(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        session.stop()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
