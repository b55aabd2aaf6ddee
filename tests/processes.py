"""Processes that nobody waits for (Linux), and what they import."""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

needs_proc = pytest.mark.skipif(
    not Path("/proc/self/exe").exists(), reason="looks processes up in /proc"
)


def plant(folder: Path, *modules: str) -> Path:
    """Put modules of these names into a folder; the file that they write when one is imported."""
    trace = folder / "imported"
    for name in modules:
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(
            f"open({str(trace)!r}, 'w')\nraise SystemExit(3)"
        )
    return trace


def in_new_process(work: Callable[..., None], *arguments: object) -> int:
    """The exit code of a new process that does it; a fork would copy locks that threads hold."""
    process = multiprocessing.get_context("spawn").Process(target=work, args=arguments)
    process.start()
    process.join(300)
    assert process.exitcode is not None, "it goes on"
    return process.exitcode


def is_running(process: int) -> bool:
    """Whether it runs; one that ended and was not waited for does not."""
    return Path(f"/proc/{process}/exe").exists()


def must_end(process: int, seconds: float) -> None:
    """Fail, and end it, when it still runs after that time."""
    deadline = time.monotonic() + seconds
    while is_running(process) and time.monotonic() < deadline:
        time.sleep(0.1)
    if is_running(process):
        os.kill(process, signal.SIGKILL)
        pytest.fail("it goes on")


@contextmanager
def at_most(seconds: int) -> Iterator[None]:
    """A body that must end by then: what waits for ever fails here, not with the whole run."""

    def give_up(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"not done after {seconds} s")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
