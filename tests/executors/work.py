"""Work for tasks: what writes, fails, dies."""

import os
import signal
import time
from pathlib import Path

from imocap_core.errors import WorkFailed
from imocap_core.executors.tasks import Report


def note(report: Report, file: Path, text: str) -> int:
    """Write a line; the number of the process."""
    report(0.5, text)
    with file.open("a") as stream:
        stream.write(text + "\n")
    return os.getpid()


def refuse(report: Report, sentence: str) -> None:
    """Fail as a stage does."""
    raise WorkFailed(sentence)


def die_once(report: Report, file: Path) -> int:
    """Kill this process, unless it was done before; the number of the process."""
    if not file.exists():
        file.touch()
        time.sleep(1)  # until what watches a process that has just begun does so
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def stay(report: Report, seconds: float) -> None:
    """Report the number of the process and work on."""
    report(0.0, str(os.getpid()))
    time.sleep(seconds)
