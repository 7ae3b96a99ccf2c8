"""A good sender at 100 Hz beside frames that are hard to fit, `python -m tests.attack.beside [--long]`.

It has a process of its own, and so have the frames beside it. What it gets is judged where it and the stream
have a priority of real time, as by `chrt -r 5`; else it is printed. The time to an answer is judged by its
goal or, on a machine that is slow or busy, by what the same sender got alone just before.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import socket
import threading
import time
from contextlib import suppress

import numpy as np

from pipelines.live.priorities import has_real_time
from tests.attack.live_lines import HARD
from tests.live_process import SWAY_PERIOD, arriving, line, live, points_mm, retimed

_PERIOD = 0.01  # s between good frames; the goal of the stream
_LEAST_SHARE, _P99 = 0.99, 5e-3  # share of good frames, and time to an answer [s]; goals of the stream
_SLOWER = 3.0  # most by which hard frames may lengthen that time; chosen: starved, it is 20 and more
_FIRST, _ALONE, _FRAMES = 100, 600, 600  # good frames of the first fit, alone, and beside hard ones; chosen
_PAUSE = 0.05  # s between two hard frames; chosen: more than can be fitted

_ENDS = ("--source", "tcp://127.0.0.1:0", "--sink", "tcp://127.0.0.1:0")
_CONTEXT = multiprocessing.get_context("fork")


def good(source: int, sink: int, times: multiprocessing.SimpleQueue, begun: threading.Event) -> None:
    """Send good frames with new noise in each, and put the times to their answers [s], NaN for none."""
    texts = [line(points_mm(60, _PERIOD * k, k), 0.0) for k in range(round(SWAY_PERIOD / _PERIOD))]
    sent, answers = dict[int, float](), dict[int, float]()
    with (
        socket.create_connection(("127.0.0.1", source)) as out,
        socket.create_connection(("127.0.0.1", sink)) as back,
    ):
        out.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        threading.Thread(target=_read, args=(back, answers), daemon=True).start()
        first = time.monotonic()
        for k in range(count := _FIRST + _ALONE + _FRAMES):
            time.sleep(max(first + _PERIOD * k - time.monotonic(), 0.0))
            if k == _FIRST + _ALONE:
                begun.set()
            sent[k] = time.monotonic()
            text = retimed(texts[k % len(texts)], 1000.0 + _PERIOD * k)
            out.sendall(text[:-2] + b',"id":"good %d"}\n' % k)
        time.sleep(1.0)
        times.put([answers.get(k, np.nan) - sent[k] for k in range(_FIRST, count)])


def _read(back: socket.socket, answers: dict[int, float]) -> None:
    """Note when the answer to each good frame came [s]."""
    with suppress(OSError):
        for now, lines in arriving(back):
            for one in lines:
                if b"good " in one[-4000:] and "segments" in (content := json.loads(one)):
                    answers[int(content["id"].removeprefix("good "))] = now


def hard(source: int, texts: list[bytes], again: bool) -> None:
    """Send hard frames, one after the other, without a priority; each from a new port if `again`."""
    if hasattr(os, "SCHED_OTHER"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    out = socket.create_connection(("127.0.0.1", source))
    for k in range(1, 1_000_000):
        with suppress(OSError):
            if again:
                out.close()
                out = socket.create_connection(("127.0.0.1", source))
            out.sendall(retimed(texts[k % len(texts)], float(k)))
        time.sleep(_PAUSE)


def trial(name: str, texts: list[bytes], *, again: bool) -> bool:
    """Let a good sender and hard frames meet; print what the first gets, and return whether it is enough."""
    times, begun = _CONTEXT.SimpleQueue(), _CONTEXT.Event()
    with live(*_ENDS) as stream:
        source, sink = stream.port("source", "tcp"), stream.port("sink", "tcp")
        sender = _CONTEXT.Process(target=good, args=(source, sink, times, begun))
        sender.start()
        begun.wait()
        other = _CONTEXT.Process(target=hard, args=(source, texts, again))
        other.start()
        took = np.array(times.get())
        other.kill()
        for process in (sender, other):
            process.join()
    alone, beside = took[:_ALONE], took[_ALONE:]
    share, least, high = float(np.mean(~np.isnan(beside))), _p99(alone), _p99(beside)
    of = f"{name}, {'new ports' if again else 'one port'}"
    print(f"{of}: {share:.1%} answered, p99 {1e3 * high:.1f} ms, alone {1e3 * least:.1f} ms", flush=True)  # noqa: T201
    return share >= _LEAST_SHARE and high <= max(_P99, _SLOWER * least)


def _p99(times: np.ndarray) -> float:
    return float(np.nanquantile(times, 0.99))


def main() -> int:
    """Run the attack; return 1 where the good sender had too few answers, or too late."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--long", action="store_true", help="each kind of frame by itself, too")
    kinds = {"all kinds": [line(points(), 0.0) for points in HARD.values()]}
    if parser.parse_args().long:
        kinds |= {name: [line(points(), 0.0)] for name, points in HARD.items()}
    sound = [
        trial(name, texts, again=again) or trial(name, texts, again=again)  # a machine may stand still once
        for name, texts in kinds.items()
        for again in (False, True)
    ]
    judged = has_real_time()
    why = "" if judged else " (not judged: no priority)"
    print(f"{len(sound)} trials, {sound.count(False)} starved{why}")  # noqa: T201
    return int(judged and not all(sound))


if __name__ == "__main__":
    raise SystemExit(main())
