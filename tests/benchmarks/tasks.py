"""A task for several processes: what it needs is imported quickly."""

import os

from imocap_core.errors import WorkFailed


def halve(display: object, number: int) -> tuple[int, str, int]:
    """Half of an even number, the threads and the process that computed it."""
    if number % 2:
        raise WorkFailed(f"{number} is odd")
    return number // 2, os.environ.get("OMP_NUM_THREADS", ""), os.getpid()
