"""Whatever breaks beside the stream, the stream goes on, and nothing that was finished is lost."""

import json
import os
import resource
import select
import selectors
import signal
import stat
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import rerun_cli
from rerun.chunk import RrdReader

from pipelines.live.messages import packed
from pipelines.live.processes import SideProcess, StateFeed, await_ready, finish_all
from tests.live.peers import frame, half_circle, next_answer
from tests.live_process import PATIENCE, Reader, line, live
from tssgeom.engine import process
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.states import origin_of, read_state, write_state
from tssgeom.rig import Rig, read_rig
from tssgeom.stream import Frame, FrameResult
from tssgeom.tendon.machine_stream import CarriedMachine

SAMPLE = Path(__file__).parents[2] / "sample_shapes" / "insertion.jsonl"
HERE = "127.0.0.1"


def head(count: int) -> bytes:
    return b"".join(SAMPLE.read_bytes().splitlines(keepends=True)[:count])


def rerun(*arguments: str | Path) -> None:
    program = Path(rerun_cli.__file__).parent / "rerun"
    subprocess.run([program, "rrd", *arguments], check=True, capture_output=True, timeout=PATIENCE)


def rows(recording: Path, entity: str, component: str) -> int:
    """Rows of an entity over time that hold a component."""
    chunks = RrdReader(str(recording)).stream().filter(content=entity)
    batches = [chunk.to_record_batch() for chunk in chunks]
    columns = [batch.column(component) for batch in batches if component in batch.schema.names]
    return sum(len(column) - column.null_count for column in columns)


def test_standard_input_is_answered_frame_by_frame_as_batch_answers_it(tmp_path):
    count = 60
    state, recording = tmp_path / "tendon.json", tmp_path / "live.rrd"
    expected = [
        one
        for one in process(list(open_recording(SAMPLE).frames)[:count], Rig(), tension_in=15.0)
        if isinstance(one, FrameResult)
    ]
    with live("--state", state, "--record", recording) as stream:
        stream.input.write(head(count))
        stream.input.close()
        out = stream.output.read()
        assert stream.process.wait(PATIENCE) == 0
    replies = [json.loads(text) for text in out.splitlines()]
    answers = [one for one in replies if "segments" in one]
    assert [one["seq"] for one in answers] == list(range(count))
    # which product is fused with a sum may differ between processes that each compiled for themselves
    same = partial(pytest.approx, rel=1e-12, abs=1e-12)
    assert [one["tension_out_N"] for one in answers] == same(
        [one.transmission.tension_out for one in expected]
    )
    assert [one["total_angle_rad"] for one in answers] == same([one.arcs.total_angle for one in expected])
    assert read_state(state).tension_out == same(expected[-1].state.tension_out)
    rerun("verify", recording)
    assert rows(recording, "/route", "LineStrips3D:strips") == count
    assert rows(recording, "/series/tension_out", "Scalars:scalars") == count


def test_a_tendon_that_creeps_goes_on_as_it_was_left_though_the_clock_began_anew(tmp_path):
    state, rig = tmp_path / "tendon.json", tmp_path / "rig.toml"
    # so slowly that a start which compiles for a minute changes nothing
    rig.write_text('[[effects]]\nname = "creep"\nratio = 0.1\ntime_s = 1e4\n')
    pulled = Frame(1e-3 * half_circle(), 1000.0, tension_in=12.0)
    (before,) = process([pulled], read_rig(rig), tension_in=0.0)
    write_state(state, before.state)
    with live("--state", state, "--rig", rig) as stream:
        stream.input.write(line(half_circle(), -1e9, tension_in_N=-9.0))
        stream.input.write(line(half_circle(), 1.0, tension_in_N=9.0))
        stream.input.close()
        assert "rejected" in next_answer(stream)
        reply = next_answer(stream)
        assert stream.process.wait(PATIENCE) == 0
    assert 1000.0 < read_state(state).time < 1100.0  # a minute has passed at most; the rejected time is none
    assert reply["t"] == 1.0
    assert reply["direction_index"] == -1
    assert reply["dead_zone"] is True


def test_a_killed_stream_leaves_a_whole_state_and_a_whole_recording(tmp_path):
    state, recording = tmp_path / "tendon.json", tmp_path / "killed.rrd"
    with live("--state", state, "--record", recording, "--sink", "-") as stream:
        beside = stream.children()
        for i in range(20):
            stream.input.write(frame(float(i), tension_in_N=5.0 + 0.1 * i))
            stream.input.flush()
            stream.output.readline()
        stream.stop(signal.SIGKILL)
    for number in beside:
        _await_end(number)
    assert 5.0 <= read_state(state).tension_in <= 6.9 + 1e-9
    rerun("verify", recording)


def test_a_killed_or_stopped_picture_and_a_killed_saver_change_no_answer(tmp_path, free_port):
    state = tmp_path / "tendon.json"
    with live("--view", "--view-port", str(free_port), "--state", state) as stream:
        saver, viewer = stream.children()
        times = iter(range(1000))

        def answered() -> bool:
            stream.input.write(frame(float(next(times))))
            stream.input.flush()
            answer = next_answer(stream)
            while answer.get("stale"):  # no frame came while the test waited for a message
                answer = next_answer(stream)
            return "segments" in answer

        assert answered()
        os.kill(viewer, signal.SIGSTOP)
        assert all(answered() for _ in range(100))
        os.kill(viewer, signal.SIGKILL)
        os.kill(saver, signal.SIGKILL)
        stream.said("goes on without it")
        stream.said("goes on without it")
        assert all(answered() for _ in range(20))
        assert stream.stop() == 1


def test_a_full_disk_ends_the_recording_with_the_reason_and_not_the_stream(tmp_path):
    recording = tmp_path / "full.rrd"
    limit = 400_000  # bytes of any file, a few dozen frames
    with live("--record", tmp_path / "warm.rrd") as warm:  # compiled code is larger, and is stored only once
        warm.input.close()
        assert warm.process.wait(PATIENCE) == 0

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    with live("--record", recording, preexec_fn=limited) as stream:
        time = 0.0
        while not any("full.rrd" in text for text in stream.errors):
            for _ in range(20):
                time += 1.0
                stream.input.write(frame(time))
                stream.input.flush()
                assert "segments" in next_answer(stream)
        assert "make room" in stream.said("full.rrd")
        stream.input.close()
        assert stream.process.wait(PATIENCE) == 1
    assert 0 < recording.stat().st_size <= limit
    ordered = tmp_path / "ordered.rrd"
    rerun("optimize", recording, "-o", ordered)
    assert 0 < rows(ordered, "/route", "LineStrips3D:strips") <= time


def test_messages_that_a_slow_recording_loses_are_reported_without_asking(tmp_path):
    lines: list[str] = []
    arguments = [*[str(tmp_path / "live.rrd")] * 2, "inf", "inf"]
    with selectors.DefaultSelector() as selector:
        recorder = SideProcess(selector, "record", arguments, lines.append)
        os.kill(recorder.pid, signal.SIGSTOP)
        numbers = packed("numbers", np.zeros((100_000, 5)))  # 4 MB
        for _ in range(8):
            recorder.send(numbers)
        assert recorder.lost > 1
        assert lines == ["record: it is slower than the stream and begins to lose messages"]
        os.kill(recorder.pid, signal.SIGKILL)
        recorder.join()
    lost, unfinished = lines[1:]
    assert f"{recorder.lost} messages were lost" in lost
    assert "unfinished" in unfinished


def test_states_that_a_slow_disk_delays_are_no_loss_and_the_newest_is_kept(tmp_path):
    lines: list[str] = []
    frames = (Frame(half_circle() / 1e3, float(k), tension_in=3.0 + k) for k in range(20))
    *results, last = [one for one in process(frames, Rig(), tension_in=3.0) if isinstance(one, FrameResult)]
    with selectors.DefaultSelector() as selector:
        saver = SideProcess(selector, "save", [str(tmp_path / "state.json")], lines.append)
        await_ready(selector, [saver], print)
        feed = StateFeed(saver, origin_of(Rig()))
        os.kill(saver.pid, signal.SIGSTOP)
        for k in range(20_000):
            feed.take(results[k % len(results)], float(k))
        assert saver.waiting
        feed.take(last, 20_000.0)
        feed.finish()
        assert finish_all(selector, [saver])
    assert lines == []
    kept = read_state(tmp_path / "state.json")
    assert not isinstance(kept, CarriedMachine)
    assert kept.tension_in == 22.0


def test_a_source_that_dies_and_returns_is_served_again(shared):
    stream = shared.stream
    for i in range(3):
        with stream.source() as source, stream.reader().sock as sock:
            reader, reply, time = Reader(sock), {}, 0.0
            sock.settimeout(PATIENCE)
            while reply.get("id") != i:
                time += 1.0
                source.sendall(frame(time, id=i))
                reply = reader.answer()
            assert "segments" in reply
            source.sendall(frame(time + 1.0)[:100])  # dies in the middle of a line


@pytest.mark.parametrize("content", ["", "{", '{"version": 1, "kind": "bars"}', "[]"])
def test_a_broken_state_is_refused_with_the_hint(run, tmp_path, content):
    state = tmp_path / "tendon.json"
    state.write_text(content)
    outcome = run("live", "--sink", "none", "--state", state)
    assert outcome.status == 2
    assert "start anew" in outcome.errors[0]


@pytest.mark.parametrize("option", ["--record", "--state"])
def test_what_is_no_file_is_not_replaced(run, tmp_path, option):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    outcome = run("live", "--sink", "none", option, pipe)
    assert outcome.status == 2
    assert "pipe: is no file" in outcome.errors[-1]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def _await_end(number: int) -> None:
    """Wait until a process that is no child of ours has ended."""
    try:
        descriptor = os.pidfd_open(number)
    except ProcessLookupError:
        return
    try:
        assert select.select([descriptor], [], [], PATIENCE)[0]
    finally:
        os.close(descriptor)


@pytest.mark.parametrize("dies", [False, True])
def test_the_end_of_a_process_that_has_no_more_to_do_is_no_failure_and_its_death_is(tmp_path, dies):
    said = list[str]()
    with selectors.DefaultSelector() as selector:
        saver = SideProcess(selector, "save", [str(tmp_path / "tendon.json")], said.append)
        await_ready(selector, [saver], print)
        if dies:
            os.kill(saver.pid, signal.SIGSTOP)
        saver.end_messages()
        if dies:
            os.kill(saver.pid, signal.SIGKILL)
        os.waitid(os.P_PID, saver.pid, os.WEXITED | os.WNOWAIT)
        assert finish_all(selector, [saver]) is not dies
    assert [one.split(":")[0] for one in said] == ["save"] * dies
