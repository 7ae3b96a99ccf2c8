"""One stream from start to end: sources, sinks and processes beside it are opened, served and closed."""

from __future__ import annotations

import gc
import json
import math
import os
import select
import selectors
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from pipelines.inputs import RunSettings
from pipelines.live.fits import Fits
from pipelines.live.following import AlertReport, RigFeed
from pipelines.live.kept_files import Rotation, kept_recording, locked
from pipelines.live.processes import PictureFeed, SideProcess, StateFeed, TokenBucket, await_ready, finish_all
from pipelines.live.session import ResultConsumer, Session
from pipelines.live.status import StatusLine
from pipelines.live.warm_up import warm_up
from tssgeom.adapt.follower import Follower
from tssgeom.engine import Engine
from tssgeom.errors import SettingsError
from tssgeom.io.formats.states import origin_of, origin_remark, read_filter, read_state
from tssgeom.io.network.addresses import Access, Endpoint
from tssgeom.io.network.channel import READ, Pipe
from tssgeom.io.network.datagrams import UdpSource
from tssgeom.io.network.mailbox import Mailbox
from tssgeom.io.network.sinks import Sink, StandardOutput, TcpSink, UdpSink
from tssgeom.io.network.sources import Replay, Source, StandardInput, TcpSource
from tssgeom.rig import Rig
from tssgeom.stream import Carried
from tssgeom.tendon.commander import Policy, commander_of
from tssgeom.tendon.machine_saved import require_state_of
from tssgeom.tendon.machine_stream import CarriedMachine
from tssgeom.threads import single_threaded


@dataclass(frozen=True, slots=True)
class PictureRates:
    """Rates of the frames with a picture; all have numbers. Chosen: what a core draws without delay."""

    recorded: tuple[float, float] = (100.0, 200.0)
    """Pictures in a recording: a second [1/s], and at once [1]."""
    viewed: tuple[float, float] = (25.0, 50.0)
    """Pictures for viewers: a second [1/s], and at once [1]."""


_RATES = PictureRates()


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """What the user chose."""

    sources: Sequence[Endpoint]
    sinks: Sequence[Endpoint]
    access: Access
    stale_after: float
    """Time without a good frame after which a stale line is sent [s]."""
    spin: bool
    """Whether to await the next frame without sleep while frames come fast, which takes a core."""
    stats: bool
    """Whether statistics are printed once a second as JSON on stderr."""
    state: Path | None = None
    """File that keeps the tendon's state from one start to the next."""
    record: Path | None = None
    """Recording to write."""
    rotation: Rotation | None = None
    """When it ends and the next one begins; None: never."""
    deadline: float | None = None
    """Time in which an answer has to be out [s]; None: from the rate of the frames."""
    view_port: int | None = None
    """Port at which viewers may connect; None: no picture."""
    tolerance: float | None = None
    """Distance from a target that may be missed [m]."""
    policy: Policy = "cross"
    """What commands do inside the dead zone."""
    adapt: bool = False
    """Whether the rig is followed."""
    write_rig: Path | None = None
    """File to which the rig that is followed is written."""


def run(options: LiveOptions, settings: RunSettings) -> int:
    """Answer frames until the sources end or a signal comes; return the exit status.

    Raises SettingsError, ShapeError or SourceError where a source, a sink or a file cannot be opened, and on
    Windows.
    """
    if not hasattr(select, "poll"):
        raise SettingsError("this system cannot poll standard streams: use Linux, macOS, or tssgeom.Engine")
    if options.write_rig is not None and not options.adapt:
        raise SettingsError("--write-rig writes the rig that --adapt follows: give both")
    if options.rotation is not None and options.record is None:
        raise SettingsError("--record-rotate ends the recording of --record and begins the next: give both")
    with ExitStack() as stack:
        stack.enter_context(locked([*filter(None, (options.state, options.record, options.write_rig))]))
        selector = stack.enter_context(selectors.DefaultSelector())
        errors = Pipe(selector, 2)
        report = _reporter(errors)
        record = options.record and stack.enter_context(kept_recording(options.record, report))
        mailbox = Mailbox()
        session = Session(
            selector,
            mailbox,
            [_source(one, selector, mailbox, options.access, settings, report) for one in options.sources],
            [_sink(one, selector, options.access, report) for one in options.sinks],
            report,
            options.stale_after,
            lambda: None,
            spin=options.spin and (os.cpu_count() or 1) > 1,
        )
        sinks = list(session.sinks)
        state = None
        if options.state is not None and options.state.exists():
            state = read_state(options.state)
            _require_usable(options, settings.rig, state)
            if remark := origin_remark(options.state, settings.rig):
                report(remark)
        if state is not None and math.isfinite(state.time):
            session.time = state.time
            report(f"{options.state}: the tendon goes on from t = {state.time:g} s")
        follower = _follower(options, settings, report) if options.adapt else None
        followed = () if follower is None else settings.rig.adapt
        commander = commander_of(
            settings.rig,
            [one for one in settings.uncertain if one.key not in followed],
            tolerance=options.tolerance,
            policy=options.policy,
            state=None if isinstance(state, CarriedMachine) else state,
        )
        engine = Engine(
            settings.rig, tension_in=settings.tension_in, state=state, commander=commander, follower=follower
        )
        session.fits = Fits(selector, engine, options.deadline, options.stale_after)
        session.consumers, processes = _side_processes(options, record, settings, follower, selector, report)
        said = _assumed(settings, state)
        session.report_statistics, finish = _statistics(session, processes, errors, said, stats=options.stats)
        try:
            warm_up(settings.rig, commander, adapt=options.adapt)
            await_ready(selector, processes, report)
            _stop_on_signals(session)
            gc.collect()  # before the line `ready`: it takes longer than many frames
            gc.freeze()
            gc.disable()
            if options.access.token and options.view_port is not None:
                report("--view: any program on this machine may read the picture, without the token")
            errors.send(f"ready: {_addresses(session, processes)}\n".encode())
            with single_threaded():  # a library's threads would wait for a core while fits beside the stream
                session.run()  # have all of them
        finally:
            session.close()
            all_well = finish_all(selector, processes)
        finish()
        for sink in sinks:
            if sink.failure:
                report(f"--sink {sink.text}: answers cannot be written ({sink.failure}): make room")
                all_well = False
    return 0 if all_well else 1


def _require_usable(options: LiveOptions, rig: Rig, state: Carried) -> None:
    """Refuse a saved state of another kind than the rig has, with a SettingsError."""
    if isinstance(state, CarriedMachine) != rig.is_machine:
        of, needed = ("one tendon", "a machine") if rig.is_machine else ("a machine", "one tendon")
        raise SettingsError(f"{options.state}: the state is of {of}, the stream needs {needed}: remove it")
    if isinstance(state, CarriedMachine):
        try:
            require_state_of(rig, state)
        except SettingsError as error:
            raise SettingsError(f"{options.state}: {error}") from error


def _follower(options: LiveOptions, settings: RunSettings, report: Callable[[str], None]) -> Follower:
    """Return what follows the rig, where a state is kept from where it stood."""
    saved = None
    if options.state is not None and options.state.exists():
        try:
            saved = read_filter(options.state, settings.rig)
        except SettingsError as error:
            report(f"{error}; the rig is followed anew")
    return Follower(settings.rig, saved=saved)


def _side_processes(
    options: LiveOptions,
    record: Path | None,
    settings: RunSettings,
    follower: Follower | None,
    selector: selectors.BaseSelector,
    report: Callable[[str], None],
) -> tuple[list[ResultConsumer], list[SideProcess]]:
    """Start the processes beside the stream; return what feeds them, and them."""
    consumers, processes = list[ResultConsumer](), list[SideProcess]()

    def started(role: str, *arguments: object) -> SideProcess:
        processes.append(SideProcess(selector, role, [*map(str, arguments)], report))
        return processes[-1]

    if options.state is not None:
        consumers.append(StateFeed(started("save", options.state), origin_of(settings.rig), follower))
    if follower is not None:
        consumers.append(AlertReport(report))
        if options.write_rig is not None:
            consumers.append(RigFeed(started("rig", options.write_rig), follower))
    drawing = list[tuple[SideProcess, TokenBucket]]()
    if options.record is not None:
        rotation = options.rotation or Rotation()
        recorder = started("record", record, options.record, rotation.size, rotation.age)
        drawing.append((recorder, TokenBucket(*_RATES.recorded)))
    if options.view_port is not None:
        drawing.append((started("view", options.view_port), TokenBucket(*_RATES.viewed)))
    if drawing:
        consumers.append(PictureFeed(drawing))
    return consumers, processes


def _addresses(session: Session, processes: Sequence[SideProcess]) -> str:
    sources = (f"source {source.text}" for source in session.sources)
    sinks = (f"sink {sink.text}" for sink in session.sinks)
    views = (f"view {one.address}" for one in processes if one.address)
    return ", ".join([*sources, *sinks, *views])


def _reporter(errors: Pipe) -> Callable[[str], None]:
    """Return what prints a sentence on stderr without waiting for it."""

    def report(sentence: str) -> None:
        errors.send(f"tssgeom: {sentence}\n".encode())

    return report


def _source(
    endpoint: Endpoint,
    selector: selectors.BaseSelector,
    mailbox: Mailbox,
    access: Access,
    settings: RunSettings,
    report: Callable[[str], None],
) -> Source:
    unit = settings.unit
    if endpoint.scheme == "tcp":
        return TcpSource(selector, mailbox, endpoint, access, unit, report)
    if endpoint.scheme == "udp":
        return UdpSource(selector, mailbox, endpoint, access, unit)
    if endpoint.scheme == "igtl":
        from tssgeom.io.network.igtl_peers import IgtlSource  # here, since few need it

        return IgtlSource(selector, mailbox, endpoint, access, report)
    if endpoint.scheme == "replay":
        replay = Replay(mailbox, endpoint, unit, settings.columns)
        if replay.notes:
            report(f"{endpoint.path}: {'; '.join(replay.notes)}")
        return replay
    return StandardInput(selector, mailbox, unit)


def _sink(
    endpoint: Endpoint, selector: selectors.BaseSelector, access: Access, report: Callable[[str], None]
) -> Sink:
    if endpoint.scheme == "tcp":
        return TcpSink(selector, endpoint, access, report)
    if endpoint.scheme == "udp":
        return UdpSink(endpoint, access)
    if endpoint.scheme == "igtl":
        from tssgeom.io.network.igtl_peers import IgtlSink

        return IgtlSink(selector, endpoint, access, report)
    return Sink() if endpoint.scheme == "none" else StandardOutput(selector)


def _assumed(settings: RunSettings, state: Carried | None) -> list[str]:
    """Return what to say of the tension of frames without a drive, where nobody gave it."""
    if settings.tension_in_given or state is not None or settings.rig.is_machine:
        return []
    where = "give tension_in_N or displacement_in_m in each frame, or --tension-in"
    return [f"a frame brings neither drive nor target: {settings.tension_in:g} N is assumed; {where}"]


def _statistics(
    session: Session, processes: Sequence[SideProcess], errors: Pipe, assumed: list[str], *, stats: bool
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return what prints the statistics once a second, and what prints them for the last time.

    Once a frame has brought no drive, it says what is `assumed`; once, that all frames are rejected.
    """
    said_rejected = False
    status = StatusLine() if sys.stderr.isatty() and not stats else None

    def report() -> None:
        nonlocal said_rejected
        counted = session.statistics
        if assumed and counted.undriven:
            session.report(assumed.pop())
        if counted.rejected and not counted.answered and not said_rejected:
            said_rejected = True
            session.report(f"all frames so far ({counted.rejected}) are rejected: {counted.last_reason}")
        counts = {
            "dropped": session.mailbox.dropped,
            "unsent": sum(sink.unsent for sink in session.sinks),
        } | {f"{one.role}_lost": one.lost for one in processes}
        statistics = session.statistics.over_interval(counts)
        if stats:
            errors.send(json.dumps(statistics).encode() + b"\n")
        if status is not None:
            status.show(statistics)

    def finish() -> None:
        report()
        if status is not None:
            status.close()

    return report, finish


def _stop_on_signals(session: Session) -> None:
    """Let SIGTERM, SIGHUP and Ctrl-C end the stream; the second of them ends it at once."""
    woken, wake = socket.socketpair()
    woken.setblocking(False)
    wake.setblocking(False)
    session.selector.register(woken, READ, lambda events: woken.recv(64))
    signal.set_wakeup_fd(wake.detach(), warn_on_full_buffer=False)

    def stop(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        session.stop()

    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, stop)
