"""The command line with faults in it:  python -m tools.chaos.faulty run serve

CHAOS_FSYNC=3        the third and all later fsyncs fail, as on a disk that is dying
CHAOS_COUNT=FILE     the number of fsyncs is written to FILE
CHAOS_ANSWER_S=6     a detector is given up after this time
"""

import errno
import os
from pathlib import Path

from imocap_core.cli import main
from imocap_core.detect import detection

FSYNC = os.fsync
FIRST_TO_FAIL = int(os.environ.get("CHAOS_FSYNC", 2**31))
COUNT = os.environ.get("CHAOS_COUNT")
calls = 0


def fsync(descriptor: int) -> None:
    """As os.fsync, until it fails."""
    global calls
    calls += 1
    if calls >= FIRST_TO_FAIL:
        raise OSError(errno.EIO, os.strerror(errno.EIO))
    FSYNC(descriptor)


os.fsync = fsync
detection.ANSWER_S = float(os.environ.get("CHAOS_ANSWER_S", detection.ANSWER_S))
if __name__ == "__main__":
    code = main()
    if COUNT is not None:
        Path(COUNT).write_text(str(calls))
    raise SystemExit(code)
