"""Who does the work: this process, several processes, or a Dask cluster; all take the same calls."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, ParamSpec, TypeVar

from tssgeom.errors import SettingsError, SourceError

_TICK = 0.25  # s between two looks at how far the workers are
_AHEAD = 2  # calls for each worker that are handed out at a time

Given = TypeVar("Given")
Done = TypeVar("Done")
P = ParamSpec("P")
Tell = Callable[[int, float], None]
"""Takes frames [1] and bytes of input [B] that are done since the last call."""


@dataclass(frozen=True, slots=True)
class Died:
    """A worker's end that took its call with it."""

    reason: str


class _Here(Executor):
    """Does each call at once, in this process."""

    def submit(self, fn: Callable[P, Done], /, *args: P.args, **kwargs: P.kwargs) -> Future[Done]:
        future: Future[Done] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # as every executor does: the one who asks for the result shall see it
            future.set_exception(error)
        return future


@dataclass(slots=True)
class Crew:
    """Workers of one kind, and how far they are."""

    count: int
    make: Callable[[int], Executor]
    """Makes an executor of so many workers."""
    progress: Callable[[], tuple[int, float]]
    """Frames and bytes that are done in all workers since the start, where they tell."""
    tick: Callable[[int, float], None]
    """Shown those numbers now and then."""
    executor: Executor = field(init=False)

    def __post_init__(self) -> None:
        self.executor = self.make(self.count)

    def each(
        self, work: Callable[[Given], Done], given: Iterable[Given]
    ) -> Iterator[tuple[Given, Done | Died]]:
        """Yield what was given with what came of it, as it is done.

        A worker that dies takes down only the call that it dies of, even alone.
        """
        waiting, running = deque(given), dict[Future[Done], Given]()
        while waiting or running:
            while waiting and len(running) < self.count * _AHEAD and not _any_done(running):
                one = waiting.popleft()
                running[self.executor.submit(work, one)] = one
            done, _ = wait(running, _TICK, FIRST_COMPLETED)
            self.tick(*self.progress())
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
    ) -> Iterator[tuple[Given, Done | Died]]:
        """Find out which of the calls in hand killed a worker: each gets one of its own."""
        self.executor.shutdown(wait=False)
        for one in suspects:
            self.executor = self.make(1)
            future = self.executor.submit(work, one)
            wait([future])
            yield one, _outcome(future)
            self.executor.shutdown(wait=False)
        self.executor = self.make(self.count)

    def in_order(self, work: Callable[..., Done], calls: Iterable[tuple[Any, ...]]) -> Iterator[Done]:
        """Yield what comes of each call, in their order; the calls are made as they are needed.

        Raises
        ------
        SourceError
            Where a worker dies.
        """
        running = deque[Future[Done]]()
        for call in calls:
            running.append(self.executor.submit(work, *call))
            if len(running) >= self.count * _AHEAD:
                yield self._result(running.popleft())
        while running:
            yield self._result(running.popleft())

    def _result(self, future: Future[Done]) -> Done:
        while not wait([future], _TICK).done:
            self.tick(*self.progress())
        try:
            return future.result()
        except BrokenExecutor as error:
            self.executor.shutdown(wait=False)
            self.executor = self.make(self.count)
            raise SourceError(_DIED) from error


_DIED = "a worker process died over it, perhaps for want of memory: run it alone with --workers 1"


def _any_done(running: Iterable[Future[Any]]) -> bool:
    return any(future.done() for future in running)


def _outcome(future: Future[Done]) -> Done | Died:
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, BrokenExecutor):
        return Died(_DIED)
    return Died(f"the worker failed ({type(error).__name__}: {error}): {_DIED}")


_tell: Tell = lambda frames, size: None  # noqa: E731


def tell(frames: int, size: float) -> None:
    """Tell that more frames, and so many bytes of input, are done; called by whoever does the work."""
    _tell(frames, size)


@contextmanager
def hired(workers: int, scheduler: str | None, tick: Callable[[int, float], None]) -> Iterator[Crew]:
    """Hire workers for the time being.

    Parameters
    ----------
    workers
        Processes on this machine; one is this process.
    scheduler
        Address of a Dask scheduler, which has workers of its own; None for this machine.
    tick
        Shown frames and bytes done so far, now and then.

    Raises
    ------
    SettingsError
        Where there is no such scheduler, or Dask is not installed.
    """
    with ExitStack() as stack:
        if scheduler is not None:
            crew = stack.enter_context(_cluster(scheduler, tick))
        elif workers == 1:
            crew = stack.enter_context(_alone(tick))
        else:
            crew = stack.enter_context(_processes(workers, tick))
        yield crew


@contextmanager
def _alone(tick: Callable[[int, float], None]) -> Iterator[Crew]:
    global _tell
    done = [0, 0.0]

    def told(frames: int, size: float) -> None:
        done[0] += frames
        done[1] += size
        tick(int(done[0]), done[1])

    before, _tell = _tell, told
    try:
        yield Crew(1, lambda count: _Here(), lambda: (int(done[0]), done[1]), tick)
    finally:
        _tell = before


@contextmanager
def _processes(workers: int, tick: Callable[[int, float], None]) -> Iterator[Crew]:
    """Hire processes that end with this one, however it ends: they watch a pipe whose other end it holds."""
    context = multiprocessing.get_context("spawn")
    watched, held = context.Pipe(duplex=False)
    frames, sizes = context.RawArray("q", _SLOTS), context.RawArray("d", _SLOTS)
    next_slot = context.Value("i", 0)

    def make(count: int) -> Executor:
        given = (watched, frames, sizes, next_slot)
        return ProcessPoolExecutor(count, context, initializer=_begin, initargs=given)

    crew = Crew(workers, make, lambda: (sum(frames), sum(sizes)), tick)
    try:
        yield crew
    except BaseException:
        held.close()
        crew.executor.shutdown(wait=False, cancel_futures=True)
        raise
    else:
        crew.executor.shutdown()
    finally:
        held.close()
        watched.close()


_SLOTS = 4096


def _begin(watched: Connection, frames: Any, sizes: Any, next_slot: Any) -> None:
    """Make a new process a worker: it counts what it does in a slot of its own."""
    global _tell
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who hired it ends it
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()
    with next_slot.get_lock():
        slot = next_slot.value % _SLOTS
        next_slot.value += 1

    def told(count: int, size: float) -> None:
        frames[slot] += count
        sizes[slot] += size

    _tell = told


def _end_with(watched: Connection) -> None:
    watched.poll(None)
    os._exit(1)


@contextmanager
def _cluster(address: str, tick: Callable[[int, float], None]) -> Iterator[Crew]:
    try:
        from distributed import Client
    except ImportError as error:
        raise SettingsError(
            "--scheduler needs Dask, which is not installed: pip install 'tssgeom[cluster]'"
        ) from error
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise SettingsError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}): check the address"
        ) from error
    with client:
        known: Any = client.nthreads()
        threads = sum(known.values())
        if not threads:
            raise SettingsError(f"--scheduler {address}: it has no worker: start one with `dask worker`")
        yield Crew(threads, lambda count: client.get_executor(pure=False), lambda: (0, 0.0), tick)
