"""Readers and sockets bear some seconds of the attacks at random; the commands themselves run for longer."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(("of", "seconds"), [("readers", "5"), ("sockets", "3")])
def test_a_short_attack_finds_no_fault(of, seconds):
    command = [sys.executable, "-m", f"tests.attack.{of}", "--seconds", seconds]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "; 0 faults" in done.stdout
