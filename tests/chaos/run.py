"""Disturb runs of a small action:  python -m tests.chaos.run --kills 100  (make chaos).

Runs, exports, viewers and reports are killed at random moments and begun again until they end.
Each time: the results of an undisturbed run, nothing left behind, the action's files untouched.
Then runs with other numbers of threads and every stage alone, a run that may write no large file,
and one with a video that cannot be used. The record, build/chaos.json, grows round by round; exit
code 0 when nothing was lost.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from imocap_core.pipeline.graph import read_pipeline
from imocap_core.pipeline.source import PROJECT
from tests.chaos.small_action import NAME, SmallAction, digests_below

STAGES = list(read_pipeline(PROJECT / "pipeline.yaml").stages)
SOLVING = [stage for stage in STAGES if stage not in ("keypoints", "evaluate")]
LARGEST_BYTES = 20_000
Start = Callable[[], subprocess.Popen[bytes]]
Part = dict[str, object]
OUT = Path("build/chaos.json")
Keep = Callable[[Part], None]  # into the record


def killed_until_done(start: Start, longest_s: float, rng: random.Random, most: int) -> int:
    """Begin a process again and again, killed after a random time, until it ends by itself (or has
    been killed `most` times and is let be); how many kills it took."""
    kills = 0
    while True:
        process = start()
        try:
            timeout = rng.uniform(0, longest_s) if kills < most else None
            _, errors = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.communicate()
            kills += 1
            continue
        assert process.returncode == 0, errors.decode(errors="replace")[-500:]
        return kills


def timed(action: SmallAction, command: str, *words: str) -> float:
    """Seconds that an undisturbed command takes."""
    began = time.monotonic()
    action.finish(command, *words)
    return time.monotonic() - began


def disturb_runs(action: SmallAction, kills: int, rng: random.Random, keep: Keep) -> Part:
    """Kills of `imocap run`."""
    longest_s = timed(action, "run")
    expected, inputs = action.results(STAGES), action.inputs()
    assert len(expected) == len(STAGES)
    done = rounds = 0
    wrong: list[str] = []
    while done < kills:
        shutil.rmtree(action.root / "artifacts")
        done += killed_until_done(lambda: action.start("run"), longest_s, rng, kills - done)
        rounds += 1
        results = action.results(STAGES)
        wrong += [stage for stage in STAGES if results.get(stage) != expected[stage]]
        wrong += ["inputs"] * (action.inputs() != inputs) + action.leftovers()
        keep({"tried": done, "rounds": rounds, "lost": len(wrong), "what": wrong})
    return {"tried": done, "rounds": rounds, "lost": len(wrong), "what": wrong}


def differences(expected: dict[str, str], digests: dict[str, str]) -> list[str]:
    """The files that are not as expected."""
    names = sorted({*expected, *digests})
    return [name for name in names if expected.get(name) != digests.get(name)]


def disturb_outputs(action: SmallAction, kills: int, rng: random.Random, keep: Keep) -> Part:
    """Kills of export, view and report."""
    done = rounds = 0
    wrong: list[str] = []
    commands: list[tuple[str, tuple[str, ...], Path]] = []
    report = action.root / "artifacts" / NAME / "report"
    for format in ("npz", "glb"):
        out = action.root / format
        commands.append(("export", ("--format", format, "--out", str(out)), out))
    commands += [("view", (), report), ("report", (), report)]
    while done < kills:
        for command, words, folder in commands:
            if folder != report:
                shutil.rmtree(folder, ignore_errors=True)
            for page in ("viewer.html", "report.html"):
                (folder / page).unlink(missing_ok=True)
            longest_s = timed(action, command, *words)
            expected = digests_below(folder)
            shutil.rmtree(folder) if folder != report else None
            for page in ("viewer.html", "report.html"):
                (folder / page).unlink(missing_ok=True)
            most = max(1, (kills + 3) // 4)
            start = lambda c=command, w=words: action.start(c, *w)  # noqa: E731
            done += killed_until_done(start, longest_s, rng, most)
            rounds += 1
            wrong += differences(expected, digests_below(folder)) + action.leftovers()
            keep({"tried": done, "rounds": rounds, "lost": len(wrong), "what": wrong})
    return {"tried": done, "rounds": rounds, "lost": len(wrong), "what": wrong}


def vary_threads(action: SmallAction) -> Part:
    """Runs with 1, 2 and 4 threads, and every stage forced alone."""
    tried, lost = 0, 0
    expected = action.results(STAGES)
    for threads in (1, 2, 4):
        shutil.rmtree(action.root / "artifacts")
        action.finish("run", threads=threads)
        tried, lost = tried + 1, lost + (action.results(STAGES) != expected)
    for stage in STAGES:
        action.finish(f"stage {stage}", "--force", threads=3)
        tried, lost = tried + 1, lost + (action.results(STAGES) != expected)
    return {"tried": tried, "lost": lost}


def starve(action: SmallAction) -> Part:
    """A run that may write no file of more than 20 kB, then one that may."""
    expected = action.results(STAGES)
    shutil.rmtree(action.root / "artifacts")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_BYTES, before[1]))
    try:
        process = action.start("run")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    _, errors = process.communicate()
    text = errors.decode(errors="replace")
    said = process.returncode == 1 and text.startswith("imocap: ") and "Traceback" not in text
    action.finish("run")
    lost = not said or action.results(STAGES) != expected or bool(action.leftovers())
    return {"tried": 1, "lost": int(lost), "sentence": text.strip()[-200:]}


def spoil_a_video(action: SmallAction) -> Part:
    """A run with a third video of a size that its keypoints contradict."""
    expected = action.results(STAGES)
    action.add_bad_video()
    action.finish("run")
    results = action.results(STAGES)
    moved = [s for s in SOLVING if results[s] != expected[s]]
    return {"tried": 1, "lost": len(moved) + bool(action.leftovers())}


def main() -> int:
    """Exit code 0 when nothing was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100, help="of runs; half as many of outputs")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        action = SmallAction.make(Path(folder))
        record: dict[str, Part] = {}

        def keep(name: str, part: Part) -> None:
            record[name] = part
            OUT.parent.mkdir(exist_ok=True)
            OUT.write_text(json.dumps(record, indent=1) + "\n")

        kills = arguments.kills
        of_runs, of_outputs = "kills of runs", "kills of outputs"
        keep(of_runs, disturb_runs(action, kills, rng, lambda part: keep(of_runs, part)))
        outputs = disturb_outputs(action, kills // 2, rng, lambda part: keep(of_outputs, part))
        keep(of_outputs, outputs)
        keep("threads and order", vary_threads(action))
        keep("no large files", starve(action))
        keep("a video that cannot be used", spoil_a_video(action))
    sys.stdout.write(json.dumps(record, indent=1) + "\n")
    return 1 if any(part["lost"] for part in record.values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
