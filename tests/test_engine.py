"""Frames pushed one by one give what `process` gives, in the order of the calls, whoever calls."""

import sys
import threading
from itertools import chain
from time import monotonic, sleep

import numpy as np
import pytest

from tests.test_stream import RIG, bend, moving_run
from tssgeom.engine import Engine, process
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult, Rejected


def swaying_run(count=80):
    """A noisy route of bends that opens and closes: models are checked while it is tracked."""
    s, rng = np.linspace(0.0, 1.0, 50), np.random.default_rng(3)
    for k in range(count):
        kappa = np.where(s < 0.4, 2.0 + 0.3 * np.sin(0.2 * k), np.where(s < 0.7, 0.0, -3.0))
        heading = np.concatenate(([0.0], np.cumsum(kappa[1:] * np.diff(s))))
        plane = np.column_stack((np.cos(heading), np.sin(heading), 0.0 * s))
        points = np.vstack((np.zeros(3), np.cumsum(plane[1:] * np.diff(s)[:, None], axis=0)))
        noisy = 0.5 * points + rng.normal(0.0, 2e-4, points.shape)
        yield Frame(noisy, 0.02 * k, tension_in=8.0 + 4.0 * np.sin(0.3 * k))


def summary(result):
    return result.seq, result.transmission, result.arcs.total_angle, result.warnings


@pytest.mark.parametrize("idle_every", [1, 3, 1000])
def test_frames_pushed_give_what_process_gives_wherever_the_model_check_is_made(idle_every):
    frames, engine, pushed = list(swaying_run()), Engine(Rig(), tension_in=15.0), []
    for count, frame in enumerate(frames):
        pushed.append(engine.push(frame))
        if count % idle_every == 0:
            engine.idle()
            engine.idle()  # nothing is due twice
    wanted = list(process(frames, Rig(), tension_in=15.0))
    assert [summary(one) for one in pushed] == [summary(one) for one in wanted]
    assert engine.state is pushed[-1].state


def test_a_bad_frame_is_counted_and_leaves_the_tendon_as_it_was():
    engine = Engine(RIG, tension_in=15.0)
    good = engine.push(Frame(bend(), 0.0))
    bad = engine.push(Frame(bend()[:2], 1.0, id="short"))
    passed = engine.push(Rejected(99, 2.0, "by its reader"))
    assert isinstance(good, FrameResult)
    assert (bad.seq, bad.time, bad.id) == (1, 1.0, "short")
    assert passed == Rejected(2, 2.0, "by its reader")
    assert engine.state is good.state
    assert engine.push(Frame(bend(), 3.0)).seq == 3


def test_an_engine_starts_from_a_given_state():
    frames = moving_run()
    engine = Engine(RIG, tension_in=15.0)
    for frame in frames[:3]:
        engine.push(frame)
    again = Engine(RIG, tension_in=15.0, state=engine.state).push(frames[3])
    (wanted,) = process(frames[3:4], RIG, tension_in=15.0, state=engine.state)
    assert again.transmission == wanted.transmission


def test_an_unforeseen_error_keeps_nobody_out():
    engine = Engine(RIG, tension_in=15.0)
    with pytest.raises(AttributeError):
        engine.push(None)
    assert isinstance(engine.push(Frame(bend(), 0.0)), FrameResult)


def test_frames_of_many_threads_are_all_taken_each_thread_in_its_order():
    engine, results = Engine(RIG, tension_in=15.0), dict[int, list[FrameResult]]()

    def push(name):
        results[name] = [engine.push(Frame(bend(seed=k), float(k), id=name)) for k in range(12)]
        engine.idle()

    switching = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)  # threads take turns inside every call
    try:
        threads = [threading.Thread(target=push, args=(name,)) for name in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60.0)
    finally:
        sys.setswitchinterval(switching)
    counts = [[one.seq for one in results[name]] for name in range(6)]
    assert all(each == sorted(each) for each in counts)
    in_turn = sorted(chain.from_iterable(results.values()), key=lambda one: one.seq)
    assert [one.seq for one in in_turn] == list(range(72))
    again = process([one.frame for one in in_turn], RIG, tension_in=15.0)
    assert [summary(one) for one in in_turn] == [summary(one) for one in again]


def test_calls_that_wait_are_served_in_the_order_in_which_they_came():
    entered, released = threading.Event(), threading.Event()

    class Slow(np.ndarray):
        """Points that are not there yet: the engine waits for them inside the first call."""

        def __array_finalize__(self, of):
            if threading.current_thread().name == "first":
                entered.set()
                released.wait(60.0)

    engine, seqs, threads = Engine(RIG, tension_in=15.0), dict[str, int](), list[threading.Thread]()

    def push(name, frame):
        seqs[name] = engine.push(frame).seq

    def start(name, frame):
        threads.append(threading.Thread(target=push, args=(name, frame), name=name))
        threads[-1].start()

    slow = bend().view(Slow)
    start("first", Frame(slow, 0.0))
    assert entered.wait(60.0)
    for k in range(1, 9):
        start(str(k), Frame(bend(seed=k), float(k)))
        end = monotonic() + 60.0
        while len(engine._calls) <= k and monotonic() < end:
            sleep(1e-3)
    released.set()
    for thread in threads:
        thread.join(60.0)
    assert seqs == {"first": 0} | {str(k): k for k in range(1, 9)}
