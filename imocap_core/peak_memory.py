"""The largest resident memory of this process: of a stage, where the system can count anew."""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from pathlib import Path

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
