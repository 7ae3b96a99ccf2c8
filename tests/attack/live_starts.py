"""Streams of their own that are stopped, killed, started again, or started where they cannot be."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from tests.attack.live_lines import helix
from tests.attack.live_target import hang
from tests.live_process import START, Live, line, live, points_mm
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.states import read_state

_HERE = "tcp://127.0.0.1:0"
_ORDER = 5.0  # s in which a recording is put in order
_PATIENCE = 20.0  # s until the first half second of a recording is on the disk
_DISK = 400_000  # bytes of a disk that is soon full
_LONG_FIT = line(helix(10_000, 200.0), 2.0)

Trial = Callable[[Path], list[str]]
"""Does one thing in a folder; returns what may not be."""


def _answer_to(stream: Live, moment: float) -> dict:
    stream.input.write(line(points_mm(60, moment), moment))
    stream.input.flush()
    while text := stream.output.readline():
        if not (answer := json.loads(text)).get("stale"):
            return answer
    raise AssertionError(f"the stream has ended: {stream.errors[-3:]}")


def _faults(stream: Live) -> list[str]:
    return ["traceback"] if any("Traceback" in one for one in stream.errors) else []


def _ended(stream: Live, number: int = signal.SIGTERM, *, more: float = 0.0, status: int = 0) -> list[str]:
    """Send a signal and wait for the end, for so many seconds more than elsewhere."""
    begun = time.monotonic()
    ended = stream.stop(number)
    took = time.monotonic() - begun
    wrong = [f"hang {took:.1f} s"] if took > hang(more) else []
    return wrong + ([] if ended == status else [f"lost status {ended}"]) + _faults(stream)


def _signal_in_a_fit(number: int) -> Trial:
    def trial(folder: Path) -> list[str]:
        ends = ("--source", _HERE, "--sink", "none", "--state", folder / "tendon.json")
        with live(*ends) as stream, stream.source() as source:
            source.sendall(_LONG_FIT)
            time.sleep(0.3)
            return _ended(stream, number)

    return trial


def _late_line(folder: Path) -> list[str]:
    """A fit that takes long has its line in time, and a frame of another client its answer."""
    ends = ("--source", _HERE, "--sink", "-", "--deadline-ms", "20")
    with live(*ends) as stream, stream.source() as source:
        source.sendall(_LONG_FIT)
        begun = time.monotonic()
        first = json.loads(stream.output.readline())
        took = time.monotonic() - begun
        wrong = [] if "late" in first else ["silent"]
        return wrong + ([f"hang {took:.1f} s"] if took > hang() else []) + _ended(stream)


def _killed_and_started(folder: Path) -> list[str]:
    """Kill a stream with all that it started, five times: state and recordings are whole."""
    state, record, wrong = folder / "tendon.json", folder / "run.rrd", list[str]()
    for _ in range(3):
        with live("--state", state, "--record", record) as stream:
            parts, k = list[Path](), 0
            until = time.monotonic() + _PATIENCE
            while not any(one.stat().st_size for one in parts) and time.monotonic() < until:
                k += 1
                time.sleep(0.01)
                _answer_to(stream, 0.1 * k)
                parts = [*folder.glob(".run*.part.rrd")]
            for number in (*stream.children(), stream.process.pid):
                with suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)
            wrong += _faults(stream)
        try:
            read_state(state)
        except TssgeomError:
            wrong.append("lost state")
    with live("--state", state, "--record", record) as stream:
        _answer_to(stream, 0.0)
        wrong += _ended(stream, more=_ORDER)
    kept = [one for one in folder.glob("run*.rrd") if one.stat().st_size]
    return wrong + ["lost recording"] * max(4 - len(kept), 0)


def _stopped_workers(folder: Path) -> list[str]:
    with live("--state", folder / "tendon.json", "--record", folder / "run.rrd") as stream:
        _answer_to(stream, 0.0)
        for number in stream.children():
            os.kill(number, signal.SIGSTOP)
        return _ended(stream, more=_ORDER)


def _killed_workers(folder: Path) -> list[str]:
    with live("--state", folder / "tendon.json", "--record", folder / "run.rrd") as stream:
        _answer_to(stream, 0.0)
        for number in stream.children():
            os.kill(number, signal.SIGKILL)
        good = all("segments" in _answer_to(stream, 0.1 * k) for k in range(1, 20))
        return ([] if good else ["lost"]) + _ended(stream, status=1)


def _full_disk(folder: Path) -> list[str]:
    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (_DISK, _DISK))

    with live("--record", folder / "full.rrd", preexec_fn=limited) as stream:
        k = 0
        while not any("make room" in one for one in stream.errors) and k < 20_000:
            k += 1
            _answer_to(stream, 0.1 * k)
        wrong = [] if k < 20_000 else ["silent"]
        wrong += _ended(stream, more=_ORDER, status=1)
    return wrong + ([] if (folder / "full.rrd").stat().st_size else ["lost recording"])


def _state_folder_goes(folder: Path) -> list[str]:
    """A state that can no longer be written is reported, and not in each save."""
    home = folder / "home"
    with live("--state", home / "tendon.json") as stream:
        _answer_to(stream, 0.0)
        time.sleep(0.5)
        for one in home.iterdir():
            one.unlink()
        home.rmdir()
        home.touch()  # a file where the folder was
        for k in range(1, 30):
            _answer_to(stream, 0.1 * k)
            time.sleep(0.1)
        said = [one for one in stream.errors if "tendon.json" in one]
        wrong = ["silent"] if not said else ["long"] * (len(said) > 2)
        return wrong + _ended(stream, status=1)


def _refused(*arguments: str, prepare: Callable[[Path], object] = lambda folder: None) -> Trial:
    """Start where it cannot be: one line, and exit status 2."""

    def trial(folder: Path) -> list[str]:
        prepare(folder)
        begun = time.monotonic()
        done = subprocess.run(
            [*START, *(one.format(folder) for one in arguments)],
            check=False,
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=60,
        )
        wrong = ["traceback"] if b"Traceback" in done.stderr else []
        wrong += [f"hang {time.monotonic() - begun:.0f} s"] if time.monotonic() - begun > 30.0 else []
        return wrong + (["silent"] if done.returncode != 2 or not done.stderr.strip() else [])

    return trial


def _taken_port(option: str, text: str) -> Trial:
    def trial(folder: Path) -> list[str]:
        kind = socket.SOCK_DGRAM if text.startswith("udp") else socket.SOCK_STREAM
        with socket.socket(socket.AF_INET, kind) as taken:
            taken.bind(("127.0.0.1", 0))
            if kind == socket.SOCK_STREAM:
                taken.listen()
            port = str(taken.getsockname()[1])
            return _refused("--sink", "none", option, text.replace("PORT", port), *_VIEW.get(option, ()))(
                folder
            )

    return trial


_VIEW = {"--view-port": ("--view", "--source", _HERE)}


def _output(stdout: str, status: int) -> Trial:
    """Answer frames on an output that is no good."""

    def trial(folder: Path) -> list[str]:
        frames = b"".join(line(points_mm(60, 0.1 * k), 0.1 * k) for k in range(50))
        command = " ".join(("exec", *(f"'{one}'" for one in START), stdout))
        done = subprocess.run(
            ["/bin/bash", "-c", command], check=False, input=frames, capture_output=True, timeout=60
        )
        wrong = ["traceback"] if b"Traceback" in done.stderr else []
        return wrong + ([] if done.returncode == status else [f"silent (status {done.returncode})"])

    return trial


def _server_that_lies(folder: Path) -> list[str]:
    """Serve what is no OpenIGTLink, over and over."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(20.0)
        with live("--source", f"igtl://127.0.0.1:{server.getsockname()[1]}", "--sink", "-") as stream:
            for _ in range(3):
                peer, _ = server.accept()
                with peer, suppress(OSError):
                    peer.sendall(os.urandom(200))
            rejected = "rejected" in json.loads(stream.output.readline())
            return ([] if rejected else ["silent"]) + _ended(stream)


STARTS: dict[str, Trial] = {
    "SIGTERM in a long fit": _signal_in_a_fit(signal.SIGTERM),
    "a long fit has its late line": _late_line,
    "kill and start with --state and --record": _killed_and_started,
    "stopped workers": _stopped_workers,
    "full disk": _full_disk,
    "a taken viewer port": _taken_port("--view-port", "PORT"),
    "/dev/full": _output(">/dev/full", 1),
    "SIGINT in a long fit": _signal_in_a_fit(signal.SIGINT),
    "SIGHUP in a long fit": _signal_in_a_fit(signal.SIGHUP),
    "killed workers": _killed_workers,
    "the folder of the state goes": _state_folder_goes,
    "a taken TCP port": _taken_port("--source", "tcp://127.0.0.1:PORT"),
    "a taken UDP port": _taken_port("--source", "udp://127.0.0.1:PORT"),
    "a reader that closes": _output("| head -c 10 >/dev/null", 0),
    "an output that is closed": _output(">&-", 0),
    "an ASCII terminal": _output("", 0),
    "a state that is a folder": _refused("--sink", "none", "--state", "{}"),
    "a state of noise": _refused(
        "--sink", "none", "--state", "{}/s", prepare=lambda folder: (folder / "s").write_bytes(b"\xff\0[")
    ),
    "a recording in a file": _refused(
        "--sink", "none", "--record", "{}/f/x.rrd", prepare=lambda folder: (folder / "f").touch()
    ),
    "a replay of nothing": _refused("--source", "replay:{}/none.jsonl", "--sink", "none"),
    "a port of text": _refused("--source", "tcp://127.0.0.1:x", "--sink", "none"),
    "an address elsewhere": _refused("--source", "tcp://192.0.2.1:5000", "--sink", "none"),
    "a deadline of 0": _refused("--deadline-ms", "0", "--sink", "none"),
    "a server that lies": _server_that_lies,
}
