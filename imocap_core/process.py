"""How this process computes: threads and memory, set where a run begins and nowhere else.

PyTorch gets one thread. The solver's blocks (75 to 150 unknowns) are too small for a library's own
threads to pay; it has threads of its own, one a motion. Results do not depend on how a stage was
reached, because every stage runs under the same setting.

Freed memory is kept for the next arrays. The solver makes and frees arrays of megabytes all the
time; glibc hands each back to the system, which gives it again page by page, filled with zeros: a
tenth of a fit's processor time went into that. Other systems' libraries are left as they are.
"""

from __future__ import annotations

import ctypes
import sys

TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8  # mallopt(3)
NEVER, LARGEST = 2**31 - 1, 32 * 2**20  # the largest MMAP_THRESHOLD that glibc takes


def configure_process() -> None:
    """One thread for PyTorch, freed memory kept: for this process and all its threads."""
    import torch

    torch.set_num_threads(1)
    keep_freed_memory()


def keep_freed_memory() -> bool:
    """Of this process, for all its threads together. Whether the system could be told so."""
    if sys.platform != "linux":
        return False
    tell = getattr(ctypes.CDLL(None), "mallopt", None)
    wanted = ((TRIM_THRESHOLD, NEVER), (MMAP_THRESHOLD, LARGEST), (ARENA_MAX, 1))
    return tell is not None and all(tell(*setting) == 1 for setting in wanted)
