"""Processes beside a stream give way to it while it runs, not while it waits for them."""

import os
import selectors
import sys
import threading
from time import monotonic, thread_time

import numpy as np
import pytest

from pipelines.live.priorities import Rests, lower_own_priority
from pipelines.live.processes import SideProcess, await_ready, finish_all
from pipelines.live.worker import Drawer
from tssgeom import core
from tssgeom.core.binding import give_way
from tssgeom.view.scene.live import LivePicture
from tssgeom.view.scene.writer import GrowingFile

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="niceness of threads")


def niceness(process: SideProcess) -> set[int]:
    threads = os.listdir(f"/proc/{process.pid}/task")
    return {os.getpriority(os.PRIO_PROCESS, int(thread)) for thread in threads}


def test_a_recorder_gives_way_once_it_is_ready_and_not_at_its_end(tmp_path):
    own = os.nice(0)
    with selectors.DefaultSelector() as selector:
        file = str(tmp_path / "run.rrd")
        recorder = SideProcess(selector, "record", [file, file, "inf", "inf"], print)
        assert niceness(recorder) == {own}
        await_ready(selector, [recorder], print)
        assert niceness(recorder) == {min(own + 10, 19)}
        if os.geteuid() == 0:
            recorder.resume()
            assert niceness(recorder) == {own}
        assert finish_all(selector, [recorder])


def test_a_picture_that_finds_no_memory_is_not_tried_again_and_again(tmp_path):
    file = GrowingFile(tmp_path / "run.rrd")
    drawer = Drawer(LivePicture(file.recording, "run"))
    drawer.take("picture", "no frame")
    with pytest.raises(AttributeError):
        drawer.flush()
    drawer.flush()
    file.finish()


def test_threads_for_long_fits_give_way_to_a_stream_of_real_time_and_else_stay_as_they_are():
    noted = list[int]()

    def work():
        noted.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
        lower_own_priority()
        noted.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
        try:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(5))
        except PermissionError:
            return
        lower_own_priority()
        noted.append(os.sched_getparam(0).sched_priority)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert noted[0] == noted[1]
    assert noted[2:] in ([], [4])


def share_of_core(work):
    """Run work that takes rests in a thread of real time; return its share, 0 where none is allowed."""
    shares = [0.0]

    def run():
        try:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(5))
        except PermissionError:
            return
        rests, begun, used = Rests(), monotonic(), thread_time()
        work(rests, begun)
        shares.append((thread_time() - used) / (monotonic() - begun))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return shares[-1]


def test_a_thread_of_real_time_leaves_some_of_its_core_to_others():
    def work(rests, begun):
        while monotonic() < begun + 0.3:
            if rests.are_due(urgent=True):  # put off, but not for ever
                rests.take_one()

    assert share_of_core(work) < 0.95  # from there on Linux takes the core away


def test_rests_of_a_stream_that_awaits_a_frame_each_5_ms_are_between_frames():
    held_up = [False]

    def work(rests, begun):
        for due in begun + 5e-3 * np.arange(1, 61):
            while (now := monotonic()) < due:
                if rests.end_within(due - now) and rests.are_due():
                    rests.take_one()
            held_up.append(rests.are_due(urgent=True))
            while monotonic() < due + 1e-3:  # the frame is answered
                pass

    assert share_of_core(work) < 0.9
    assert np.mean(held_up) < 0.2


def test_an_entry_of_the_core_waits_first_in_a_thread_that_gives_way():
    points, waited = np.random.default_rng(0).standard_normal((20, 3)), list[int]()

    def work():
        give_way(lambda: waited.append(1))
        core.mean_spacing(points)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    core.mean_spacing(points)
    assert waited == [1]
