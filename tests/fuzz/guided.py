"""Coverage-guided fuzzing of the readers of people's files:  make fuzz-guided SECONDS=3600.

Each reader gets a process of its own, in which libFuzzer (atheris) keeps every damage to its file
that reaches new code of this project and goes on from there; half of the damages are those of
mutations.py, so that JSON and YAML stay well-formed. The corpus is in build/fuzz/corpus, what was
not refused properly in build/fuzz, the record of executions in build/fuzz/guided.json.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

ROOM_BYTES = 3 * 2**30
LARGEST_BYTES = 2**20
STARTING_S = 120  # of a process, and its last file
OUT = Path("build/fuzz")


def fuzz_one_reader(name: str, seconds: float) -> None:
    """Fuzz one reader in this process, which ends with it."""
    import atheris  # type: ignore[import-not-found, unused-ignore]

    with atheris.instrument_imports(include=["imocap_core"]):
        from tests.fuzz.mutations import damaged
        from tests.fuzz.readers import READERS, file_of
        from tests.fuzz.run import hang, outcome
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGALRM, hang)
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + ROOM_BYTES, resource.RLIM_INFINITY))
    begin, read = READERS[name]
    path = begin(Path(tempfile.mkdtemp(dir=os.environ["IMOCAP_FUZZ_FOLDER"])))
    file = file_of(path)
    valid = file.read_bytes()
    corpus = OUT / "corpus" / _plain(name)
    corpus.mkdir(parents=True, exist_ok=True)
    (corpus / "valid").write_bytes(valid)
    became: Counter[str] = Counter()
    end = time.monotonic() + seconds

    def read_damaged(content: bytes) -> None:
        if time.monotonic() > end:
            _write_part(name, became)
            os._exit(0)
        file.write_bytes(content)
        what = outcome(read, path)
        became[what] += 1
        if what not in ("read", "refused") and became[what] == 1:
            (OUT / f"guided-{_plain(name)}-{len(became)}{file.suffix}").write_bytes(content)

    def mutate(content: bytes, max_size: int, seed: int) -> bytes:
        if seed % 2:
            return bytes(atheris.Mutate(content, max_size))
        try:
            return damaged(content, file.name, random.Random(seed))[:max_size]
        except (ValueError, RecursionError, ArithmeticError, _yaml_error()):
            return damaged(content, "", random.Random(seed))[:max_size]

    words = [f"-max_len={LARGEST_BYTES}", "-timeout=0", "-rss_limit_mb=0", "-verbosity=0"]
    atheris.Setup([name, str(corpus), *words], read_damaged, custom_mutator=mutate)
    atheris.Fuzz()


def _yaml_error() -> type[Exception]:
    import yaml

    return yaml.YAMLError


def _plain(name: str) -> str:
    return name.replace(" ", "-")


def _write_part(name: str, became: Counter[str]) -> None:
    (OUT / f"guided-{_plain(name)}.part").write_text(json.dumps(became))


def fuzz_all(names: list[str], seconds: float) -> dict[str, Any]:
    """Fuzz the readers one after another, each for its share of the time."""
    became: dict[str, Any] = {}
    share_s = seconds / len(names)
    for name in names:
        part = OUT / f"guided-{_plain(name)}.part"
        part.unlink(missing_ok=True)
        with tempfile.TemporaryDirectory() as folder:
            line = [sys.executable, "-m", "tests.fuzz.guided", "--only", name]
            process = subprocess.Popen(
                [*line, "--seconds", str(share_s)],
                env={**os.environ, "IMOCAP_FUZZ_FOLDER": folder},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            try:
                broke = {f"the process ended with {process.wait(share_s + STARTING_S)}": 1}
            except subprocess.TimeoutExpired:  # in code that no signal of Python's interrupts
                process.kill()
                process.wait()
                broke = {"the process hung": 1}
        became[name] = json.loads(part.read_text()) if part.exists() else broke
        part.unlink(missing_ok=True)
    return became


def main() -> int:
    """Exit code 0 when every damaged file was read or refused as it should be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600, help="of all readers together")
    parser.add_argument("--only", help="a reader, in this process")
    arguments = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    if arguments.only:
        fuzz_one_reader(arguments.only, arguments.seconds)
        return 0
    from tests.fuzz.readers import READERS

    became = fuzz_all(list(READERS), arguments.seconds)
    executions = sum(sum(counts.values()) for counts in became.values())
    corpus = sum(1 for p in (OUT / "corpus").rglob("*") if p.is_file())
    record = {"executions": executions, "corpus": corpus, "became": became}
    (OUT / "guided.json").write_text(json.dumps(record, indent=1) + "\n")
    wrong = 0
    for name, results in became.items():
        for result, count in results.items():
            if result not in ("read", "refused"):
                wrong += count
                sys.stdout.write(f"{name}: {count} x {result}\n")
    sys.stdout.write(f"{executions} executions, {corpus} files that reach new code\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
