"""How long each stage took when its present result was made: artifacts/ACTION/timings.json.

Artifacts hold no clock, so that the same input gives the same bytes; this file beside them does.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.artifacts.store import Store
from imocap_core.pipeline.runner import Outcome
from imocap_core.whole_files import write_whole

if TYPE_CHECKING:
    from imocap_core.artifacts.schemas import Table

FILE = "timings.json"


def record(store: Store, action: str, outcomes: Sequence[Outcome]) -> None:
    """Write the seconds of the stages that ran; those of cached results stay."""
    made = {o.stage: (o.stored.digest, round(o.seconds, 3)) for o in outcomes if o.how == "made"}
    if not made:
        return
    file = _file(store, action)
    noted = _read(file)
    for stage, (digest, seconds) in made.items():
        noted[stage] = {**noted.get(stage, {}), digest: seconds}
    write_whole(file, json.dumps(noted, indent=1) + "\n")


def seconds_of(store: Store, action: str, digests: Mapping[str, str]) -> dict[str, float | None]:
    """Stage -> seconds that the result of this digest took; None where not recorded."""
    noted = _read(_file(store, action))
    return {stage: noted.get(stage, {}).get(digest) for stage, digest in digests.items()}


def timing_table(seconds: Mapping[str, float | None], frames: int) -> Table:
    """A row a stage. frames: of all videos together."""
    from imocap_core.artifacts.schemas import Table

    rows: list[list[str | bool | int | float | None]] = [
        [stage, took, None if took is None else 1000 * took / max(frames, 1)]
        for stage, took in seconds.items()
    ]
    recorded = [took for took in seconds.values() if took is not None]
    if len(recorded) == len(seconds):
        rows.append(["all stages", sum(recorded), 1000 * sum(recorded) / max(frames, 1)])
    return Table(
        name="timings",
        title="Time for each stage",
        columns=["stage", "seconds", "ms_per_frame"],
        rows=rows,
        note=f"{frames} frames in all videos. Wall clock on the machine that made the result, "
        "under whatever other load; – where not recorded.",
    )


def _file(store: Store, action: str) -> Path:
    return store.folder / action / FILE


def _read(file: Path) -> dict[str, dict[str, float]]:
    """Seconds by stage and digest; without those that the file, missing or damaged, does not
    have."""
    try:
        noted = json.loads(file.read_text(encoding="utf-8"))
        return {
            str(stage): {str(digest): float(took) for digest, took in results.items()}
            for stage, results in noted.items()
        }
    except (OSError, ValueError, ArithmeticError, TypeError, AttributeError, RecursionError):
        return {}
