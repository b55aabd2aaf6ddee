"""SIGKILL at random moments; begun again, a command must end as if nothing had been."""

import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from tools.chaos.small_action import NAME, STAGES, Part, SmallAction, digests_below, part_of

Start = Callable[[], subprocess.Popen[bytes]]
Wait = Callable[[subprocess.Popen[bytes]], None]
Keep = Callable[[Part], None]  # into the record
STEP_S = 0.05
KILLS_A_ROUND = 4  # before a command is let be, so that its result is looked at
PAGES = ("viewer.html", "report.html")
Command = tuple[str, tuple[str, ...], Path]  # its name, its words, where it writes


def killed_until_done(start: Start, wait: Wait, most: int) -> int:
    """Begin a process again and again, killed after `wait`, until it ends by itself (or has been
    killed `most` times and is let be); how many kills it took."""
    kills = 0
    while True:
        process = start()
        if kills < most:
            wait(process)
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
                process.communicate()
                kills += 1
                continue
        _, errors = process.communicate()
        assert process.returncode == 0, errors.decode(errors="replace")[-500:]
        return kills


def for_a_random_time(longest_s: float, rng: random.Random) -> Wait:
    """Wait for up to this time, or the end of a process."""

    def wait(process: subprocess.Popen[bytes]) -> None:
        with suppress(subprocess.TimeoutExpired):
            process.wait(rng.uniform(0, longest_s))

    return wait


def for_a_random_stage(action: SmallAction, stage_s: float, rng: random.Random) -> Wait:
    """Wait until some of the stages that are left have their result, and a little longer: as often
    early as late in a run, however busy the machine is."""

    def finished() -> int:
        return sum((action.artifacts / NAME / f"{stage}.mcap").is_file() for stage in STAGES)

    def wait(process: subprocess.Popen[bytes]) -> None:
        target = rng.randint(finished(), len(STAGES))
        while process.poll() is None and finished() < target:
            time.sleep(STEP_S)
        for_a_random_time(2 * stage_s, rng)(process)

    return wait


def timed(action: SmallAction, command: str, *words: str) -> float:
    """Seconds that an undisturbed command takes."""
    began = time.monotonic()
    action.finish(command, *words)
    return time.monotonic() - began


def disturb_runs(action: SmallAction, kills: int, rng: random.Random, keep: Keep) -> Part:
    """Kills of `imocap run`."""
    action.forget()
    wait = for_a_random_stage(action, timed(action, "run") / len(STAGES), rng)
    done = rounds = 0
    wrong: list[str] = []
    while done < kills:
        action.forget()
        most = min(KILLS_A_ROUND, kills - done)
        done += killed_until_done(lambda: action.start("run"), wait, most)
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
            done += killed_until_done(start, for_a_random_time(longest_s, rng), most)
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
