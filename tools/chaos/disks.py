"""Disks that fail a run: no large files, no room, no fsync. Begun again, it must end as if nothing
had been."""

import random
import resource
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tools.chaos.small_action import Part, SmallAction, part_of, refused

LARGEST_BYTES = 20_000
PLENTY_BYTES = 2**30


def starve(action: SmallAction) -> Part:
    """A run that may write no file of more than 20 kB, then one that may."""
    action.forget()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_BYTES, before[1]))
    try:
        process = action.start("run")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    wrong = refused(process) + action.differences_after("run")
    return part_of(1, wrong)


def fill_disk(action: SmallAction, tries: int, rng: random.Random) -> Part:
    """Runs whose artifacts lie on a disk with less room than they need, then with enough."""
    files = (p.stat() for p in action.artifacts.rglob("*") if p.is_file())
    needed = sum({status.st_ino: status.st_size for status in files}.values())  # links count once
    wrong: list[str] = []
    for done in range(tries):
        shutil.rmtree(action.artifacts)
        action.artifacts.mkdir()
        with small_disk(action.artifacts, round(rng.uniform(0.02, 0.9) * needed)) as possible:
            if not possible:
                return part_of(done, wrong) | {"note": "no tmpfs can be mounted here"}
            wrong += _refused_or_done(action, action.start("run"))
            _mount("-o", f"remount,size={PLENTY_BYTES}", str(action.artifacts))
            wrong += action.differences_after("run")
    action.finish("run")
    return part_of(tries, wrong)


def fail_fsyncs(action: SmallAction, tries: int, rng: random.Random) -> Part:
    """Runs in which fsync fails from a random call on, then one in which it works."""
    action.forget()
    count = action.root / "fsyncs"
    action.finish("run", faults={"CHAOS_COUNT": str(count)})
    calls, wrong = int(count.read_text()), []
    for _ in range(tries):
        action.forget()
        first = rng.randint(1, calls)
        process = action.start("run", faults={"CHAOS_FSYNC": str(first)})
        wrong += _refused_or_done(action, process)
        wrong += action.differences_after("run")
    return part_of(tries, wrong)


def _refused_or_done(action: SmallAction, process: subprocess.Popen[bytes]) -> list[str]:
    """What is wrong with the end of a run that had to fail, unless the fault met only what can be
    done without (digests remembered for the next command)."""
    wrong = refused(process)
    return wrong if process.returncode != 0 else action.differences()


@contextmanager
def small_disk(folder: Path, size_bytes: int) -> Iterator[bool]:
    """A disk of this size mounted at a folder; whether that is possible here."""
    mounted = _mount("-t", "tmpfs", "-o", f"size={size_bytes}", "tmpfs", str(folder))
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(folder)], check=True)


def _mount(*words: str) -> bool:
    try:
        return subprocess.run(["mount", *words], stderr=subprocess.DEVNULL).returncode == 0
    except FileNotFoundError:
        return False
