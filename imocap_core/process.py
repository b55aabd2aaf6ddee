"""This process: threads, allocator, largest resident memory, device, signals.

PyTorch, OpenCV and the linear algebra of NumPy and SciPy get one thread: the solver's blocks (75 to
150 unknowns) and OpenCV's pictures are too small for more, and the solver has a thread a motion.
Every stage runs under the same settings, so results depend neither on the command that ran it nor
on the machine's cores: large products are rounded differently on two threads.

Freed memory is reused: glibc returns megabytes to the system, which zeroes each page it gives back,
a tenth of a fit's processor time. Python looks for garbage less often: modules make many objects,
which all stay, and each search visits all of PyTorch's.
"""

from __future__ import annotations

import ctypes
import gc
import mmap
import re
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from imocap_core.errors import Stopped, WrongUse

STATM, LARGE_BYTES = Path("/proc/self/statm"), 800e6
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8  # mallopt(3)
NEVER, LARGEST = 2**31 - 1, 32 * 2**20  # the largest MMAP_THRESHOLD that glibc takes


def configure_process() -> None:
    """One thread for linear algebra and pictures, freed memory reused, garbage rarely looked for:
    this process and all its threads."""
    gc.set_threshold(100_000)  # new objects
    import cv2
    import scipy.linalg  # noqa: F401  (only libraries that are loaded can be limited)
    import torch
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    threadpool_limits(1, user_api="blas")
    keep_freed_memory()


def release_freed_memory() -> None:
    """Give back what is freed and kept, between two stages: the next one needs other sizes."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def release_if_large() -> None:
    """The same between two parts of a stage, where the process is large: memory that is wanted
    again costs time."""
    with suppress(OSError):
        pages = int(STATM.read_text().split()[1])
        if pages * mmap.PAGESIZE > LARGE_BYTES:
            release_freed_memory()


def keep_freed_memory() -> bool:
    """Set glibc's allocator to reuse freed memory. Whether this was possible."""
    if sys.platform != "linux":
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    options = ((TRIM_THRESHOLD, NEVER), (MMAP_THRESHOLD, LARGEST), (ARENA_MAX, 1))
    return mallopt is not None and all(mallopt(*option) == 1 for option in options)


STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
RESET_PEAK = "5"  # proc(5)


def restart_peak() -> None:
    """Count anew from now on; elsewhere than on Linux, the peak stays that since the start."""
    with suppress(OSError):
        CLEAR.write_text(RESET_PEAK)


def peak_bytes() -> int | None:
    """The peak since `restart_peak`; None where the system does not tell."""
    with suppress(OSError):
        line = re.search(r"VmHWM:\s*(\d+) kB", STATUS.read_text())
        if line is not None:
            return 1024 * int(line[1])
    if sys.platform == "win32":
        return None
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most


CPU = "cpu"


def check_device(name: str) -> None:
    """WrongUse where it is no device, or PyTorch has none of that name here.

    name: cpu, cuda, or one of several as cuda:1.
    """
    match = re.fullmatch(r"cpu|cuda(?::(\d{1,3}))?", name)
    if match is None:
        raise WrongUse(f"device: expected cpu, cuda or cuda:1, got {name!r}")
    if name == CPU:
        return
    import torch

    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if int(match[1] or 0) >= count:
        there = {0: "no CUDA device", 1: "one CUDA device (cuda)"}.get(
            count, f"CUDA devices cuda:0 to cuda:{count - 1}"
        )
        why = "" if torch.version.cuda else ", in a build without CUDA"
        raise WrongUse(f"device {name}: PyTorch finds {there} here{why}; leave it out to use cpu")


SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Raise `Stopped` in the body when one of these signals arrives; a second one ends the process
    at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        for each in SIGNALS:
            signal.signal(each, signal.SIG_DFL)
        raise Stopped(number)

    before = {each: signal.signal(each, stop) for each in SIGNALS}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, signal.SIG_DFL if handler is None else handler)
