"""Damage files and read them for some time:  python -m tools.fuzz.run --seconds 300  (make fuzz).

Every damaged file must be read or refused in a sentence that names it, within ten seconds and a
gigabyte more of memory. What was not goes to build/fuzz, and the record of executions to
build/fuzz/record.json; a case is run again with --only READER --seed N.
"""

import argparse
import json
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from types import FrameType

from tools.fuzz.mutations import damaged
from tools.fuzz.readers import READERS, Read, file_of, try_to_read

LIMIT_S, ROOM_BYTES = 10, 2**30
OUT = Path("build/fuzz")


class Hung(BaseException):
    """A file took longer than the limit to read."""


def one(name: str, seed: int, keep: Path | None) -> str:
    """What became of one damaged file: read, refused, or what went wrong, in a line."""
    begin, read = READERS[name]
    with tempfile.TemporaryDirectory() as folder:
        path = begin(Path(folder))
        file = file_of(path)
        content = damaged(file.read_bytes(), file.name, random.Random(f"{name} {seed}"))
        file.write_bytes(content)
        what = outcome(read, path)
        if what not in ("read", "refused") and keep is not None:
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{name.replace(' ', '-')}-{seed}{file.suffix}").write_bytes(content)
        return what


def outcome(read: Read, path: Path) -> str:
    """What becomes of a file within the time limit, where SIGALRM calls `hang`."""
    signal.alarm(LIMIT_S)
    try:
        return "read" if try_to_read(read, path) else "refused"
    except (Exception, Hung) as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        return f"{type(error).__name__} at {place}: {str(error)[:160]}"
    finally:
        signal.alarm(0)


def hang(number: int, frame: FrameType | None) -> None:
    """The handler of SIGALRM."""
    raise Hung(f"took longer than {LIMIT_S} s")


def main() -> int:
    """Exit code 0 when every damaged file was read or refused as it should be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--seed", type=int, default=0, help="of the first damage to each file")
    parser.add_argument("--only", help="a reader, as the record names it")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGALRM, hang)
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + 3 * ROOM_BYTES, resource.RLIM_INFINITY))
    names = [arguments.only] if arguments.only else list(READERS)
    became: dict[str, Counter[str]] = {name: Counter() for name in names}
    end, seed = time.monotonic() + arguments.seconds, arguments.seed
    while time.monotonic() < end:
        for name in names:
            became[name][one(name, seed, OUT)] += 1
        seed += 1
    wrong = {
        n: {r: c for r, c in b.items() if r not in ("read", "refused")} for n, b in became.items()
    }
    executions = sum(sum(counts.values()) for counts in became.values())
    OUT.mkdir(parents=True, exist_ok=True)
    record = {"executions": executions, "seeds": [arguments.seed, seed], "became": became}
    (OUT / "record.json").write_text(json.dumps(record, indent=1) + "\n")
    for name, results in wrong.items():
        for result, count in results.items():
            sys.stdout.write(f"{name}: {count} x {result}\n")
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sys.stdout.write(f"{executions} executions, peak memory {peak_mib:.0f} MiB\n")
    return 1 if any(wrong.values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
