"""Signals end a command wherever they come."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipelines.interruption import MESSAGE, SIGNALS, Interruption, ending_this_step, interruptible

LATE = 20.0  # s; far above the 0.5 s of an idle machine, which tests share; the work takes a minute

PROGRAM = """
import ctypes, hashlib, multiprocessing, subprocess, sys, time
from pathlib import Path
from pipelines.interruption import interruptible, unheard
from tssgeom.atomic import replacing, temporary_folder
from tssgeom.programs import running

def in_python():
    print("begun", flush=True)
    time.sleep(60)

def in_c():
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)

def in_a_callback():
    ctypes.CFUNCTYPE(None)(in_python)()
    time.sleep(60)

def in_a_block_that_is_never_left():
    try:
        in_python()
    finally:
        time.sleep(60)

def behind_a_broad_handler():
    try:
        in_python()
    except BaseException:
        raise ImportError("of a library whose import was interrupted")

def beside_a_worker():
    with unheard():
        worker = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
        worker.start()
    Path("worker").write_text(str(worker.pid))
    in_python()

def beside_a_program_in_c():
    with running([sys.executable, "-c", "import time; time.sleep(60)"]) as program:
        Path("worker").write_text(str(program.pid))
        in_c()

def before_a_program_has_started(start=subprocess.Popen.__init__):
    def late(self, *given, **options):
        start(self, *given, **options)
        Path("worker").write_text(str(self.pid))
        print("begun", flush=True)
        time.sleep(0.2)

    subprocess.Popen.__init__ = late
    with running([sys.executable, "-c", "import time; time.sleep(60)"]):
        time.sleep(60)

def writing(work):
    with temporary_folder(), replacing(Path("result.txt")) as draft:
        draft.write_text("half")
        return work() or 0

if __name__ == "__main__":
    sys.exit(interruptible(lambda: writing(globals()[sys.argv[1]])))
"""
WAYS = [
    *("in_python", "in_c", "in_a_callback", "in_a_block_that_is_never_left", "behind_a_broad_handler"),
    *("beside_a_worker", "beside_a_program_in_c", "before_a_program_has_started"),
]


def shut_on() -> None:
    """Hear all signals: a shell shuts SIGINT off for what it starts with &, and nohup SIGHUP."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def started(folder: Path, way: str) -> subprocess.Popen[str]:
    (folder / "program.py").write_text(PROGRAM)
    (folder / "temporary").mkdir()
    paths = {"PYTHONPATH": str(Path(__file__).parents[2]), "TMPDIR": str(folder / "temporary")}
    return subprocess.Popen(
        [sys.executable, "program.py", way],
        cwd=folder,
        env={**os.environ, **paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=shut_on,
    )


def interrupted(folder: Path, way: str, number: int) -> tuple[int, str]:
    """Send a signal to a program when it has begun; return its status and what it printed on stderr."""
    with started(folder, way) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "begun\n"
        if (worker := folder / "worker").exists():
            os.kill(int(worker.read_text()), signal.SIGSTOP)
        program.send_signal(number)
        _, errors = program.communicate(timeout=LATE)
    return program.returncode, errors


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("way", WAYS)
def test_a_signal_ends_a_command_wherever_it_comes_and_leaves_nothing(tmp_path, way, number):
    status, errors = interrupted(tmp_path, way, number)
    assert (status, errors) == (128 + number, f"tssgeom: {MESSAGE}\n")
    assert list((tmp_path / "temporary").iterdir()) == []
    assert {path.name for path in tmp_path.iterdir()} <= {"program.py", "temporary", "worker", "__pycache__"}
    if (tmp_path / "worker").exists():
        with pytest.raises(ProcessLookupError):
            os.kill(int((tmp_path / "worker").read_text()), 0)


def test_a_signal_that_was_shut_off_stays_so():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert interruptible(lambda: os.kill(os.getpid(), signal.SIGHUP) or 3) == 3
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_signal_may_end_one_step_alone_and_nothing_stays_behind():
    def filming_then_writing() -> int:
        with ending_this_step():
            signal.raise_signal(signal.SIGTERM)
            time.sleep(LATE)
        return 4

    states = [signal.getsignal(number) for number in SIGNALS], sys.unraisablehook
    assert interruptible(filming_then_writing) == 4
    assert ([signal.getsignal(number) for number in SIGNALS], sys.unraisablehook) == states
    assert signal.set_wakeup_fd(-1) == -1


def test_a_signal_after_the_work_changes_nothing():
    late = Interruption(done=True)
    late.hear(signal.SIGINT, None)
    assert (late.number, late.heard.is_set()) == (0, True)


def test_a_signal_while_the_process_ends_leaves_no_traceback():
    program = "import atexit, signal; from pipelines.interruption import interruptible; "
    program += "signal.signal(signal.SIGINT, signal.default_int_handler); "  # some shells ignore it
    program += "atexit.register(signal.raise_signal, signal.SIGINT); interruptible(lambda: 0, last=True)"
    done = subprocess.run([sys.executable, "-c", program], check=False, stderr=subprocess.PIPE, timeout=LATE)
    assert (done.returncode, done.stderr) == (-signal.SIGINT, b"")
