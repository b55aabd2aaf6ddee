"""The numbers of one action, and their file."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.scoring.costs import Cost

LAST = "refine_sync"
RESULTS = ("estimator", "monocular", "single pass", "after loop", "oracle")
SINGLE = ("keypoints", "camera_motion", "initial_smpl", "sync", "smpl_ba")
STAGES_OF = {
    "monocular": SINGLE[:3],
    "single pass": SINGLE,
    "after loop": (*SINGLE, "redetect", LAST),
    "oracle": (*SINGLE[:3], "oracle"),
}


def first_videos(count: int) -> str:
    """The name of the loop's result when only the first videos are scored."""
    return f"after loop, first {count}"


@dataclass(frozen=True)
class ActionScore:
    """numbers: result -> metric (docs/metrics.md) -> mean over the videos; costs: stage -> seconds
    and peak gigabytes when it was made."""

    action: str
    videos: int
    frames: int
    numbers: dict[str, dict[str, float]]
    costs: dict[str, Cost]
    key: str

    def of(self, result: str, metric: str) -> float | None:
        """One number, or None where it could not be scored."""
        return self.numbers.get(result, {}).get(metric)

    def cost(self, result: str) -> Cost | None:
        """Cost of a result and all that it is made from; None when a part was not measured."""
        parts = [self.costs.get(stage) for stage in STAGES_OF.get(result, (result,))]
        measured = [part for part in parts if part is not None]
        if len(measured) < len(parts):
            return None
        return Cost(sum(c.seconds for c in measured), max(c.peak_gb for c in measured))


def write_score(score: ActionScore, file: Path) -> None:
    """Store an action's numbers, whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_suffix(".part")
    draft.write_text(json.dumps(asdict(score), indent=1))
    draft.replace(file)


def read_score(file: Path) -> ActionScore | None:
    """An action's stored numbers; None when there are none that can be read."""
    try:
        fields = json.loads(file.read_text())
        costs = {stage: Cost(**cost) for stage, cost in fields.pop("costs").items()}
        return ActionScore(**fields, costs=costs)
    except (FileNotFoundError, ValueError, TypeError, KeyError, AttributeError):
        return None
