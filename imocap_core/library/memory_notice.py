"""A sentence before stages that are expected to need more memory than there is."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.workers import cores

if TYPE_CHECKING:
    from imocap_core.artifacts.store import Stored

MEMINFO, STATM, CGROUP = Path("/proc/meminfo"), Path("/proc/self/statm"), Path("/sys/fs/cgroup")
# Largest memory of all stages as measured (docs/scaling.md): of the program and its data, of every
# frame of every video, and of every frame whose motion is being fitted. The posterior takes less.
PROGRAM_BYTES, FRAME_BYTES, FIT_BYTES = 700e6, 50e3, 230e3


def memory_notice(frames: Sequence[int], available: int | None) -> str | None:
    """The sentence, or None where the memory suffices or is not known.

    Args:
        frames: of each video; available: bytes.
    """
    expected = expected_bytes(frames, cores())
    if not frames or available is None or expected <= available:
        return None
    total, longest = sum(frames), max(frames)
    return (
        f"about {expected / 1e9:.2f} GB of memory are expected to be needed ({len(frames)} videos, "
        f"{total:,} frames, {longest:,} in the longest), and {available / 1e9:.2f} GB are "
        "available: use fewer frames (`frames` of a video in action.yaml), films of a lower frame "
        "rate, or a machine with more memory"
    )


def frames_of(keypoints: Stored) -> list[int]:
    """Number of used frames of every video; none where a stage of another kind made the result."""
    if keypoints.schema != "Keypoints":
        return []
    from imocap_core.artifacts.schemas import Keypoints

    return [len(video.frames) for video in keypoints.decode(Keypoints).videos]


def expected_bytes(frames: Sequence[int], workers: int) -> int:
    """Largest memory of a run.

    Args:
        frames: of each video; workers: motions that are fitted at once where they are short.
    """
    from imocap_core.motion.solver.gauss_newton import motions_at_once

    longest = max(frames, default=0)
    at_once = min(len(frames), workers, motions_at_once(longest))
    return int(PROGRAM_BYTES + FRAME_BYTES * sum(frames) + FIT_BYTES * at_once * longest)


def available_bytes() -> int | None:
    """Memory that this process may use, its own included; None where the system does not tell."""
    if sys.platform != "linux":
        with suppress(AttributeError, ValueError, OSError):
            return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        return None
    import resource

    limits: list[int] = []
    with suppress(OSError, IndexError, ValueError):
        resident = int(STATM.read_text().split()[1]) * resource.getpagesize()
        free = re.search(r"MemAvailable:\s*(\d+) kB", MEMINFO.read_text())
        if free is not None:
            limits.append(1024 * int(free[1]) + resident)
    with suppress(OSError, ValueError):  # a container's; "max" where it has none
        limits.append(int((CGROUP / "memory.max").read_text()))
    most, _ = resource.getrlimit(resource.RLIMIT_DATA)
    if most != resource.RLIM_INFINITY:
        limits.append(most)
    return min(limits, default=None)
