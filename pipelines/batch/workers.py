"""Pools of workers: this process, several processes, or a Dask cluster; all take the same calls."""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, ParamSpec, TypeVar

from pipelines.interruption import end_workers, unheard
from tssgeom.atomic import temporary_folder
from tssgeom.errors import SettingsError, SourceError


@dataclass(frozen=True, slots=True)
class BatchLimits:
    """How a batch is divided among workers and in its report; no number depends on it."""

    most_figures: int = 500
    """Inputs that the report draws; of all others it has the numbers and the link to the recording [1].
    Chosen: each adds 20 to 60 kB to the page."""
    most_outlying: int = 10
    """Outlying inputs with a line on the terminal [1]; the report has all. Chosen."""
    most_rows: int = 40
    """Inputs that the table lists [1]; chosen: the height of a terminal."""
    worker_size: int = 4 << 20
    """Size of all inputs for each further worker, and of an input whose frames several workers share where
    each stands alone [B]. Chosen: a worker takes about as long for it as for its start."""
    worker_pictures: int = 30
    """Inputs with pictures for each further worker [1]. Chosen: it draws them in the time of its start."""


@dataclass(frozen=True, slots=True)
class WorkerLimits:
    """How calls are handed out; no result depends on it."""

    report_interval: float = 0.25
    """Time between two reports of progress [s]; chosen: a bar that moves smoothly."""
    calls_per_worker: int = 2
    """Calls that a worker holds: one under way, one waiting; derived: no worker waits for the next."""
    slots: int = 4096
    """Counters of progress shared by processes; chosen: more than processes are ever started."""
    connect_timeout: str = "10s"
    """Wait for a Dask scheduler; chosen."""


_LIMITS = WorkerLimits()

Given = TypeVar("Given")
Done = TypeVar("Done")
P = ParamSpec("P")
Report = Callable[[int, float], None]
"""Takes frames [1] and bytes of input [B]."""


@dataclass(frozen=True, slots=True)
class WorkerLost:
    """The outcome of a call whose worker is lost."""

    reason: str


class _SameProcess(Executor):
    """Does each call at once, in this process."""

    def submit(self, fn: Callable[P, Done], /, *args: P.args, **kwargs: P.kwargs) -> Future[Done]:
        future: Future[Done] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # as every executor does: it is raised where the result is read
            future.set_exception(error)
        return future


@dataclass(slots=True)
class WorkerPool:
    """Workers of one kind, and their progress."""

    count: int
    make: Callable[[int], Executor]
    """Makes an executor of so many workers."""
    progress: Callable[[], tuple[int, float]]
    """Frames and bytes that all workers have done since the start; zero where they cannot report."""
    show: Report
    """Called with those numbers, several times a second."""
    executor: Executor = field(init=False)

    def __post_init__(self) -> None:
        self.executor = self.make(self.count)

    def unordered(
        self, work: Callable[[Given], Done], given: Iterable[Given]
    ) -> Iterator[tuple[Given, Done | WorkerLost]]:
        """Yield each input with its outcome, in the order in which they are done.

        A worker that dies loses only the call that killed it.
        """
        waiting, running = deque(given), dict[Future[Done], Given]()
        while waiting or running:
            while waiting and len(running) < self.count * _LIMITS.calls_per_worker and not _any_done(running):
                one = waiting.popleft()
                running[self._submit(work, one)] = one
            done, _ = wait(running, _LIMITS.report_interval, FIRST_COMPLETED)
            self.show(*self.progress())
            suspects = list[Given]()
            for future in done:
                one = running.pop(future)
                if isinstance(future.exception(), BrokenExecutor):
                    suspects.append(one)
                else:
                    yield one, _outcome(future)
            if suspects:
                suspects += running.values()
                running.clear()
                yield from self._one_by_one(work, suspects)

    def _one_by_one(
        self, work: Callable[[Given], Done], suspects: Sequence[Given]
    ) -> Iterator[tuple[Given, Done | WorkerLost]]:
        """Find which of the calls under way killed a worker: each gets a worker of its own."""
        _give_up(self.executor)
        for one in suspects:
            self.executor = self.make(1)
            future = self._submit(work, one)
            wait([future])
            yield one, _outcome(future)
            _give_up(self.executor)
        self.executor = self.make(self.count)

    def ordered(self, work: Callable[..., Done], calls: Iterable[tuple[Any, ...]]) -> Iterator[Done]:
        """Yield the result of each call in their order; a call is taken when a worker is free.

        Raises SourceError where a worker dies.
        """
        running = deque[Future[Done]]()
        for call in calls:
            running.append(self._submit(work, *call))
            if len(running) >= self.count * _LIMITS.calls_per_worker:
                yield self._result(running.popleft())
        while running:
            yield self._result(running.popleft())

    def _submit(self, work: Callable[..., Done], *given: Any) -> Future[Done]:
        """Hand out a call; a worker that starts for it hears no signal. One that is lost is an outcome."""
        try:
            if self.count == 1:
                return self.executor.submit(work, *given)
            with unheard():
                return self.executor.submit(work, *given)
        except BrokenExecutor as error:
            future: Future[Done] = Future()
            future.set_exception(error)
            return future

    def _result(self, future: Future[Done]) -> Done:
        while not wait([future], _LIMITS.report_interval).done:
            self.show(*self.progress())
        try:
            return future.result()
        except BrokenExecutor as error:
            _give_up(self.executor)
            self.executor = self.make(self.count)
            raise SourceError(_LOST_REASON) from error


_LOST_REASON = "the worker process of it was lost, perhaps for lack of memory: run it alone with --workers 1"


def _give_up(executor: Executor) -> None:
    """End an executor that has lost a worker or has no call left, and the workers that it still has.

    It ends them by a signal that they do not hear, and waits for them: since Python 3.12 with its lock held.
    """
    if isinstance(executor, ProcessPoolExecutor):
        end_workers()
    executor.shutdown(wait=False)


def _any_done(running: Iterable[Future[Any]]) -> bool:
    return any(future.done() for future in running)


def _outcome(future: Future[Done]) -> Done | WorkerLost:
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, BrokenExecutor):
        return WorkerLost(_LOST_REASON)
    return WorkerLost(f"the worker failed ({type(error).__name__}: {error}): {_LOST_REASON}")


_report: Report = lambda frames, size: None  # noqa: E731


def report_progress(frames: int, size: float) -> None:
    """Report that more frames, and so many bytes of input, are done; called inside a worker."""
    _report(frames, size)


def worker_pool(workers: int, scheduler: str | None, show: Report) -> AbstractContextManager[WorkerPool]:
    """Start workers for a `with` block, and end them after it.

    Parameters
    ----------
    workers
        Processes on this machine; one is this process.
    scheduler
        Address of a Dask scheduler, which has workers of its own; None for this machine.
    show
        Called with frames and bytes done so far, several times a second.

    Raises
    ------
    SettingsError
        Where there is no such scheduler, or Dask is not installed.
    """
    if scheduler is not None:
        return _cluster(scheduler, show)
    return _same_process(show) if workers == 1 else _processes(workers, show)


@contextmanager
def _same_process(show: Report) -> Iterator[WorkerPool]:
    global _report
    done = [0, 0.0]

    def add(frames: int, size: float) -> None:
        done[0] += frames
        done[1] += size
        show(int(done[0]), done[1])

    before, _report = _report, add
    try:
        yield WorkerPool(1, lambda count: _SameProcess(), lambda: (int(done[0]), done[1]), show)
    finally:
        _report = before


@contextmanager
def _processes(workers: int, show: Report) -> Iterator[WorkerPool]:
    """Start processes that end with this one, however it ends: they watch a pipe whose other end it holds.

    They are killed, since all results are there or none is wanted, and one that was stopped would not end.
    """
    context = multiprocessing.get_context("spawn")
    _start_tracker()
    watched, held = context.Pipe(duplex=False)
    frames, sizes = context.RawArray("q", _LIMITS.slots), context.RawArray("d", _LIMITS.slots)
    next_slot = context.Value("i", 0)

    with temporary_folder() as temporary:
        given = (watched, frames, sizes, next_slot, str(temporary))

        def make(count: int) -> Executor:
            return ProcessPoolExecutor(count, context, initializer=_begin, initargs=given)

        pool = WorkerPool(workers, make, lambda: (sum(frames), sum(sizes)), show)
        try:
            yield pool
        finally:
            end_workers()
            pool.executor.shutdown(cancel_futures=True)
            held.close()
            watched.close()


def _start_tracker() -> None:
    """Start what removes the locks of a process that a signal ended, without a line about them on stderr."""
    if os.name != "posix":
        return
    from multiprocessing import resource_tracker

    quiet = "ignore:resource_tracker:UserWarning"
    sys.warnoptions.append(quiet)
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.remove(quiet)


def _begin(watched: Connection, frames: Any, sizes: Any, next_slot: Any, temporary: str) -> None:
    """Prepare a new process: it counts its frames and bytes in a slot of its own."""
    global _report
    tempfile.tempdir = temporary  # its parent removes it
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()
    with next_slot.get_lock():
        slot = next_slot.value % _LIMITS.slots
        next_slot.value += 1

    def add(count: int, size: float) -> None:
        frames[slot] += count
        sizes[slot] += size

    _report = add


def _end_with(watched: Connection) -> None:
    watched.poll(None)
    os._exit(1)


@contextmanager
def _cluster(address: str, show: Report) -> Iterator[WorkerPool]:
    try:
        from distributed import Client
    except ImportError as error:
        raise SettingsError(
            "--scheduler needs Dask, which is not installed: pip install 'tssgeom[cluster]'"
        ) from error
    try:
        client = Client(address, timeout=_LIMITS.connect_timeout)
    except (OSError, ValueError) as error:
        raise SettingsError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}): check the address"
        ) from error
    with client:
        threads_of: Any = client.nthreads()
        threads = sum(threads_of.values())
        if not threads:
            raise SettingsError(f"--scheduler {address}: it has no worker: start one with `dask worker`")
        yield WorkerPool(threads, lambda count: client.get_executor(pure=False), lambda: (0, 0.0), show)
