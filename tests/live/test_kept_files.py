"""State and recordings of a stream: one writer each, none overwritten, none lost with a signal or a kill."""

import os
import shutil
import signal
import socket
import subprocess
import time

import pytest

from pipelines.live.kept_files import Rotation, rotation_of
from tests.live.peers import frame, next_answer
from tests.live.test_faults import _await_end, rows
from tests.live_process import PATIENCE, START, live
from tssgeom.errors import SettingsError
from tssgeom.io.formats.states import read_state


def answer_one(stream, moment=0.0, **more):
    stream.input.write(frame(moment, **more))
    stream.input.flush()
    return next_answer(stream)


@pytest.mark.parametrize(("option", "name"), [("--state", "tendon.json"), ("--record", "live.rrd")])
def test_a_second_stream_on_the_same_file_is_refused_at_its_start(run, tmp_path, option, name):
    (tmp_path / "link").symlink_to(tmp_path)
    with live(option, tmp_path / name) as first:
        for same in (tmp_path / name, tmp_path / "link" / name):
            outcome = run("live", "--sink", "none", option, same)
            assert outcome.status == 2
            assert "another stream writes it" in outcome.errors[-1]
        assert "segments" in answer_one(first)
        assert first.stop() == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["link", name])


def test_a_state_that_cannot_be_written_is_refused_at_the_start(run, tmp_path):
    (tmp_path / "taken").touch()
    outcome = run("live", "--sink", "none", "--state", tmp_path / "taken" / "tendon.json")
    assert outcome.status == 2
    assert "tendon.json: cannot be written" in outcome.errors[-1]


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a folder in which no file can be made")
@pytest.mark.parametrize("option", ["--state", "--record"])
def test_a_folder_in_which_no_file_can_be_made_is_named_and_no_other_stream(run, option):
    outcome = run("live", "--sink", "none", option, "/proc/tendon.json")
    assert outcome.status == 2
    assert "cannot be written (No such file or directory)" in outcome.errors[-1]


def test_a_state_that_can_no_longer_be_written_is_said_once_a_minute(tmp_path):
    home = tmp_path / "home"
    with live("--state", home / "tendon.json") as stream:
        answer_one(stream)
        while not (home / "tendon.json").exists():
            time.sleep(0.05)
        shutil.rmtree(home)
        home.touch()  # a file where the folder was
        for i in range(1, 8):
            answer_one(stream, float(i))
            time.sleep(0.25)
        assert stream.stop() == 1
    assert len([one for one in stream.errors if "tendon.json: cannot be written" in one]) == 1


def test_workers_that_are_stopped_finish_with_the_stream(tmp_path):
    state, recording = tmp_path / "tendon.json", tmp_path / "live.rrd"
    with live("--state", state, "--record", recording) as stream:
        for beside in stream.children():
            os.kill(beside, signal.SIGSTOP)
        for i in range(5):
            answer_one(stream, float(i), tension_in_N=5.0 + i)
        assert stream.stop() == 0
    assert read_state(state).tension_in == pytest.approx(9.0)
    assert recording.stat().st_size > 0


def test_a_viewer_port_that_is_taken_is_an_error_at_the_start(run):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        outcome = run("live", "--sink", "none", "--view", "--view-port", str(port))
    assert outcome.status == 2
    assert f"port {port}: Address already in use: choose another with --view-port" in outcome.errors[-1]


def test_a_state_that_is_taken_up_is_said_and_that_of_another_rig_is_named(tmp_path):
    state, rig = tmp_path / "tendon.json", tmp_path / "rig.toml"
    rig.write_text("[friction]\ncoefficient = 0.3\n")
    said, goes_on = [], []
    for options in ((), (), ("--rig", rig)):
        with live("--state", state, *options) as stream:
            answer_one(stream)
            assert stream.stop() == 0
        said.append([text for text in stream.errors if "of another rig" in text])
        goes_on.append([text for text in stream.errors if "the tendon goes on from t = " in text])
    assert [len(one) for one in said] == [0, 0, 1]
    assert [len(one) for one in goes_on] == [0, 1, 1]
    assert "tendon.json" in said[-1][0]


def test_a_state_of_another_kind_of_rig_is_refused_in_one_line(tmp_path):
    state, rig = tmp_path / "tendon.json", tmp_path / "rig.toml"
    rig.write_text("[end]\nkind = 'joint'\nradius_m = 0.01\n[drive]\nkind = 'pair'\nradius_m = 0.01\n")
    with live("--state", state) as stream:
        answer_one(stream)
        assert stream.stop() == 0
    command = [*START, "--sink", "none", "--state", state, "--rig", rig]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    assert done.returncode == 2
    (line,) = (text for text in done.stderr.decode().splitlines() if "tendon.json" in text)
    assert "the state is of one tendon, the stream needs a machine: remove it" in line


def test_a_hang_up_saves_state_and_recording(tmp_path):
    state, recording = tmp_path / "tendon.json", tmp_path / "live.rrd"
    with live("--state", state, "--record", recording) as stream:
        for beside in stream.children():
            os.kill(beside, signal.SIGHUP)
        for i in range(5):
            answer_one(stream, float(i), tension_in_N=5.0 + i)
        assert stream.stop(signal.SIGHUP) == 0
    assert read_state(state).tension_in == pytest.approx(9.0)
    assert recording.stat().st_size > 0


def test_no_recording_is_overwritten_and_what_a_kill_left_is_kept(tmp_path):
    recording = tmp_path / "live.rrd"
    with live("--record", recording) as stream:
        answer_one(stream)
        assert stream.stop() == 0
    first = recording.read_bytes()
    with live("--record", recording) as stream:
        assert "live-2.rrd" in next(text for text in stream.errors if "exists" in text)
        (beside,) = stream.children()
        part = tmp_path / ".live-2.part.rrd"
        i = 0
        while not part.stat().st_size:
            answer_one(stream, float(i := i + 1))
        os.kill(beside, signal.SIGKILL)
        stream.stop(signal.SIGKILL)
    _await_end(beside)
    left = part.read_bytes()
    with live("--record", recording) as stream:
        assert "live-2.rrd: what a stream recorded" in next(text for text in stream.errors if "order" in text)
        answer_one(stream)
        stream.input.close()
        assert stream.process.wait(PATIENCE) == 0
    assert recording.read_bytes() == first
    assert (tmp_path / "live-2.rrd").read_bytes() == left
    assert (tmp_path / "live-3.rrd").stat().st_size > 0


def test_a_recording_that_grows_too_large_goes_on_in_the_next_one(tmp_path):
    (tmp_path / "live-4.rrd").touch()
    count, first = 0, tmp_path / "live.rrd"
    with live("--record", first, "--record-rotate", "0.2 MB") as stream:
        while not (tmp_path / "live-6.rrd").exists():
            answer_one(stream, float(count))
            count += 1
            time.sleep(0.02)  # each frame has a picture, up to 100 a second
        assert stream.stop() == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert {"live.rrd", "live-4.rrd", "live-5.rrd", "live-6.rrd"} <= names
    assert not {name for name in names if name.startswith(".")}
    files = [path for path in tmp_path.iterdir() if path.stat().st_size]
    pictures = [rows(path, "/route", "LineStrips3D:strips") for path in files]
    assert 0 < sum(pictures) <= count  # a busy machine leaves pictures out, none is there twice
    assert (tmp_path / "live-4.rrd").stat().st_size == 0


def test_a_rotation_is_a_size_or_a_time():
    assert rotation_of("1.5GiB") == Rotation(size=1.5 * 2**30)
    assert rotation_of("30 min") == Rotation(age=1800.0)
    for wrong in ("", "0MB", "-1h", "5", "5 parsec", "9" * 400 + "GB"):
        with pytest.raises(SettingsError, match="write a number and s, min"):
            rotation_of(wrong)


def test_a_rotation_without_a_recording_is_refused(run):
    outcome = run("live", "--sink", "none", "--record-rotate", "1h")
    assert (outcome.status, "give both" in outcome.errors[0]) == (2, True)


def test_a_stream_that_is_ended_before_it_is_ready_leaves_nothing(tmp_path):
    command = [*START, "--sink", "none", "--record", str(tmp_path / "live.rrd")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as stream:
        while not (tmp_path / ".live.rrd.lock").exists():
            time.sleep(0.01)
        time.sleep(0.2)
        stream.terminate()
        assert stream.wait(PATIENCE) == 128 + signal.SIGTERM
    assert not list(tmp_path.iterdir())
