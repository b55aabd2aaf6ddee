"""A detector's process does not outlive the program that it works for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import imocap_core.detect.workers
from tests.processes import is_running, must_end, needs_proc

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
command = [sys.executable, "-c", sys.argv[1], "{}", sys.argv[2]]
worker = subprocess.Popen(command, stdin=subprocess.PIPE)
print(worker.pid, flush=True)
worker.wait()
"""


@needs_proc
def test_a_detector_that_hangs_ends_when_its_run_is_killed(tmp_path: Path) -> None:
    pictures, pipe = tmp_path / "pictures", subprocess.PIPE
    pictures.touch()
    command = [sys.executable, "-c", PROGRAM, HANGS, str(pictures)]
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as program:
        assert program.stdout is not None
        assert program.stderr is not None
        worker = int(program.stdout.readline())
        assert program.stderr.readline() == "hangs\n"
        assert is_running(worker)
        program.kill()
    must_end(worker, seconds=30)
    assert not pictures.exists()
