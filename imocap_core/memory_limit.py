"""A limit on the memory of this process."""

from __future__ import annotations

import re
import sys

from imocap_core.errors import WrongUse

SUFFIXES = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}
SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(?:I?B)?", re.IGNORECASE)
LEAST_BYTES = 2**29  # importing PyTorch alone takes a good part of it


def memory_size(text: str) -> int:
    """Bytes of a size such as 4G, 1500M or 2.5GiB (powers of 1024).

    WrongUse when it is none, or below 512M.
    """
    match = SIZE.fullmatch(text.strip())
    if match is None:
        raise WrongUse(f"expected a size of memory such as 4G or 1500M, got {text!r}")
    size = int(float(match[1]) * SUFFIXES[match[2].upper()])
    if size < LEAST_BYTES:
        raise WrongUse(f"a worker needs at least 512M of memory, got {text}")
    return size


def can_limit_memory() -> bool:
    """Whether `limit_memory` has an effect here: on Linux."""
    return sys.platform == "linux"


def limit_memory(most_bytes: int) -> None:
    """Let allocations beyond a number of bytes fail (MemoryError) instead of taking the memory of
    other processes."""
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = most_bytes if hard == resource.RLIM_INFINITY else min(most_bytes, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
