"""SIGKILL at random moments; begun again, a command must end as if nothing had been."""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from tests.chaos.small_action import NAME, Part, SmallAction, digests_below, part_of

Start = Callable[[], subprocess.Popen[bytes]]
Keep = Callable[[Part], None]  # into the record
KILLS_A_ROUND = 4  # before a command is let be, so that its result is looked at
PAGES = ("viewer.html", "report.html")
Command = tuple[str, tuple[str, ...], Path]  # its name, its words, where it writes


def killed_until_done(
    start: Start, longest_s: float, rng: random.Random, most: int
) -> tuple[int, float]:
    """Begin a process again and again, killed after a random time, until it ends by itself (or has
    been killed `most` times and is let be).

    How many kills it took, and the longest time to an end: the machine may have become slower.
    """
    kills = 0
    while True:
        began, process = time.monotonic(), start()
        try:
            timeout = rng.uniform(0, longest_s) if kills < most else None
            _, errors = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.communicate()
            kills += 1
            continue
        assert process.returncode == 0, errors.decode(errors="replace")[-500:]
        return kills, max(longest_s, time.monotonic() - began)


def timed(action: SmallAction, command: str, *words: str) -> float:
    """Seconds that an undisturbed command takes."""
    began = time.monotonic()
    action.finish(command, *words)
    return time.monotonic() - began


def disturb_runs(action: SmallAction, kills: int, rng: random.Random, keep: Keep) -> Part:
    """Kills of `imocap run`."""
    action.forget()
    longest_s = timed(action, "run")
    done = rounds = 0
    wrong: list[str] = []
    while done < kills:
        action.forget()
        most = min(KILLS_A_ROUND, kills - done)
        more, longest_s = killed_until_done(lambda: action.start("run"), longest_s, rng, most)
        done += more
        rounds += 1
        wrong += action.differences()
        keep(part_of(done, wrong) | {"rounds": rounds})
    return part_of(done, wrong) | {"rounds": rounds}


def disturb_outputs(action: SmallAction, kills: int, rng: random.Random, keep: Keep) -> Part:
    """Kills of export, view and report."""
    done = rounds = 0
    wrong: list[str] = []
    report = action.artifacts / NAME / "report"
    commands: list[Command] = [("view", (), report), ("report", (), report)]
    for format in ("npz", "glb"):
        out = action.root / format
        commands.append(("export", ("--format", format, "--out", str(out)), out))
    while done < kills:
        for command, words, folder in commands:
            _empty(folder, report)
            longest_s = timed(action, command, *words)
            expected = digests_below(folder)
            _empty(folder, report)
            most = min(KILLS_A_ROUND, kills)
            start = lambda c=command, w=words: action.start(c, *w)  # noqa: E731
            done += killed_until_done(start, longest_s, rng, most)[0]
            rounds += 1
            digests = digests_below(folder)
            names = sorted({*expected, *digests})
            wrong += [name for name in names if expected.get(name) != digests.get(name)]
            wrong += action.leftovers()
            keep(part_of(done, wrong) | {"rounds": rounds})
    return part_of(done, wrong) | {"rounds": rounds}


def _empty(folder: Path, report: Path) -> None:
    """Without what the command writes there."""
    if folder != report:
        shutil.rmtree(folder, ignore_errors=True)
    for page in PAGES:
        (folder / page).unlink(missing_ok=True)
