"""What a task of `run-all` pays for the other actions of its working folder.

A folder of empty results is made; what is done in it besides the stages is timed: every task sweeps
leftovers, reads and saves what is remembered of files; once a run the cache is measured against its
limit.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from imocap_core.artifacts.store import CACHE, cached_results, sweep

ACTIONS = (100, 1000)
STAGES, REPORT_FILES, REMEMBERED = 9, 30, 16  # of an action; remembered: videos and keypoints


@dataclass(frozen=True)
class BookkeepingRow:
    """Processor milliseconds in a folder of so many actions: of one task, and once (limit_ms)."""

    actions: int
    sweep_ms: float
    limit_ms: float
    memory_ms: float


def bookkeeping(place: Path) -> list[BookkeepingRow]:
    """A row for each of ACTIONS, in temporary folders below `place`."""
    rows = []
    place.mkdir(parents=True, exist_ok=True)
    for actions in ACTIONS:
        with tempfile.TemporaryDirectory(dir=place) as folder:
            store = Path(folder)
            make_store(store, actions)
            times = (
                _processor_ms(partial(sweep, store, "a0")),
                _processor_ms(partial(cached_results, store)),
                _processor_ms(partial(_written_and_read, remembered(actions))),
            )
            rows.append(BookkeepingRow(actions, *times))
    return rows


def make_store(store: Path, actions: int) -> None:
    """Empty results of so many actions, each linked from the cache as a run does it."""
    for stage in range(STAGES):
        (store / CACHE / f"s{stage}").mkdir(parents=True)
    for a in range(actions):
        report = store / f"a{a}" / "report"
        report.mkdir(parents=True)
        for k in range(REPORT_FILES):
            (report / f"{k}.png").touch()
        lines = [f"s{stage}/{a:064d}" for stage in range(STAGES)]
        for line in lines:
            cached = store / CACHE / f"{line}.mcap"
            cached.touch()
            os.link(cached, store / f"a{a}" / f"{line.partition('/')[0]}.mcap")


def remembered(actions: int) -> dict[str, tuple[str, str]]:
    """What of files.json grows with the actions: their videos and keypoints."""
    return {
        f"content /home/lab/actions/action_{a}/videos/v{k}.mp4": ("1234567 " * 3, "0" * 64)
        for a in range(actions)
        for k in range(REMEMBERED)
    }


def _written_and_read(entries: dict[str, tuple[str, str]]) -> object:
    return json.loads(json.dumps(entries))


def _processor_ms(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return 1e3 * (time.process_time() - began)
