"""Disturb runs of a small action:  python -m tools.chaos.run --kills 100  (make chaos).

Runs, exports, viewers and reports are killed at random moments and begun again until they end.
Each time: the results of an undisturbed run, nothing left behind, the action's files untouched.
The same after a disk that takes no large file, is full, or fails to sync; after processes of the
demo and of the detector were killed or hung; with other numbers of threads, every stage alone, and
with a video that cannot be used. The record, build/chaos.json, grows part by part; exit code 0 when
nothing was lost.
"""

import argparse
import json
import random
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tools.chaos.disks import fail_fsyncs, fill_disk, starve
from tools.chaos.kills import disturb_outputs, disturb_runs
from tools.chaos.processes import disturb_demo, disturb_detector
from tools.chaos.small_action import STAGES, Part, SmallAction, part_of

SOLVING = [stage for stage in STAGES if stage not in ("keypoints", "evaluate")]
OUT = Path("build/chaos.json")


def vary_threads(
    action: SmallAction, counts: Sequence[int] = (1, 2, 4), alone: Sequence[str] = STAGES
) -> Part:
    """Runs with these numbers of threads, and stages forced alone, with three."""
    wrong: list[str] = []
    for threads in counts:
        action.forget()
        wrong += action.differences_after("run", threads=threads)
    for stage in alone:
        wrong += action.differences_after(f"stage {stage}", "--force", threads=3)
    return part_of(len(counts) + len(alone), wrong)


def spoil_a_video(action: SmallAction) -> Part:
    """A run with a third video of a size that its keypoints contradict."""
    expected = action.results()
    action.add_bad_video()
    action.finish("run")
    results = action.results()
    moved = [s for s in SOLVING if results[s] != expected[s]]
    return part_of(1, moved + action.leftovers())


class ChaosRecord:
    """What was tried and lost, part by part, and the seconds that a part took."""

    def __init__(self, only: str) -> None:
        self.parts: dict[str, Part] = {}
        self._only = only

    def keep(self, name: str, part: Part) -> None:
        """Write it down."""
        self.parts[name] = part
        OUT.parent.mkdir(exist_ok=True)
        OUT.write_text(json.dumps(self.parts, indent=1) + "\n")

    def add(self, name: str, disturb: Callable[[Callable[[Part], None]], Part]) -> None:
        """A part that writes down how far it has come."""
        if self._only not in name:
            return
        began = time.monotonic()
        part = disturb(lambda part: self.keep(name, part))
        self.keep(name, part | {"seconds": round(time.monotonic() - began)})


def main() -> int:
    """Exit code 0 when nothing was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100, help="of runs; half as many of outputs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="only the parts with this text in their name")
    arguments = parser.parse_args()
    rng, kills = random.Random(arguments.seed), arguments.kills
    tries = max(2, kills // 10)
    with tempfile.TemporaryDirectory() as folder:
        action = SmallAction.make(Path(folder))
        record = ChaosRecord(arguments.only)
        record.add("kills of runs", lambda keep: disturb_runs(action, kills, rng, keep))
        record.add("kills of outputs", lambda keep: disturb_outputs(action, kills // 2, rng, keep))
        record.add("threads and order", lambda keep: vary_threads(action))
        record.add("no large files", lambda keep: starve(action))
        record.add("full disk", lambda keep: fill_disk(action, tries, rng))
        record.add("failing fsync", lambda keep: fail_fsyncs(action, tries, rng))
        record.add("processes of the demo", lambda keep: disturb_demo(action))
        record.add("processes of the detector", lambda keep: disturb_detector(action))
        record.add("a video that cannot be used", lambda keep: spoil_a_video(action))
    sys.stdout.write(json.dumps(record.parts, indent=1) + "\n")
    return 1 if any(part["lost"] for part in record.parts.values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
