"""A detector's process does not outlive the program that it works for."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import imocap_core.detect.workers

WORKERS = Path(next(iter(imocap_core.detect.workers.__path__)))
HANGS = f"""
import sys, time
sys.path.insert(0, {str(WORKERS)!r})
import exchange
def make(settings):
    print("hangs", file=sys.stderr, flush=True)
    time.sleep(1e6)
exchange.serve(make)
"""
PROGRAM = """
import subprocess, sys
worker = subprocess.Popen([sys.executable, "-c", sys.argv[1], "{}"], stdin=subprocess.PIPE)
print(worker.pid, flush=True)
worker.wait()
"""


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks for processes in /proc")
def test_a_detector_that_hangs_ends_when_its_run_is_killed() -> None:
    command = [sys.executable, "-c", PROGRAM, HANGS]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as program:
        assert program.stdout is not None
        assert program.stderr is not None
        worker = int(program.stdout.readline())
        assert program.stderr.readline() == "hangs\n"
        process = Path(f"/proc/{worker}/exe")  # gone, as well, for one that nobody has waited for
        assert process.exists()
        program.kill()
    waits = 0
    while process.exists() and waits < 300:
        time.sleep(0.1)
        waits += 1
    if process.exists():
        os.kill(worker, signal.SIGKILL)
        pytest.fail("it goes on")
