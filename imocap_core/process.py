"""Thread count and memory allocator of this process, set only where a run begins.

PyTorch, OpenCV and the linear algebra of NumPy and SciPy get one thread. The solver's blocks (75 to
150 unknowns) are too small to benefit from multithreaded linear algebra; the solver uses one thread
per motion instead. Every stage runs under the same settings, so results depend neither on the
command that ran it nor on the machine's cores: products of large matrices are rounded differently
on two threads (and were slower there). OpenCV's pictures are small too, and several videos are
tracked at once: its own threads took a fifth of that stage's processor time.

Freed memory is reused for new arrays. The solver allocates and frees arrays of megabytes all the
time; by default glibc returns each to the system, which provides it again page by page, filled with
zeros: this took a tenth of a fit's processor time. Other systems' libraries are not changed.
"""

from __future__ import annotations

import ctypes
import mmap
import sys
from contextlib import suppress
from pathlib import Path

STATM, LARGE_BYTES = Path("/proc/self/statm"), 800e6
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8  # mallopt(3)
NEVER, LARGEST = 2**31 - 1, 32 * 2**20  # the largest MMAP_THRESHOLD that glibc takes


def configure_process() -> None:
    """One thread for linear algebra and pictures, freed memory reused: for this process and all its
    threads."""
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
