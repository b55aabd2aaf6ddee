"""The cost models of all stages, and of a whole action."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.cost.measure import StageCost
from benchmarks.cost.model import CostModel, Size, fitted

LEAST_S = 0.005  # the system counts processor time in hundredths


@dataclass(frozen=True)
class ActionCost:
    """A whole action: processor seconds, the process's largest memory, bytes of all results."""

    processor_s: float
    peak_mb: float
    stored_mb: float


@dataclass(frozen=True)
class CostModels:
    """Stage -> processor seconds, stored MB, and the process's largest memory meanwhile."""

    processor_s: dict[str, CostModel]
    stored_mb: dict[str, CostModel]
    peak_mb: dict[str, CostModel]

    def at(self, size: Size) -> ActionCost:
        """The predicted cost of an action."""
        return ActionCost(
            sum(model.at(size) for model in self.processor_s.values()),
            max(model.at(size) for model in self.peak_mb.values()),
            sum(model.at(size) for model in self.stored_mb.values()),
        )


def size_of(row: StageCost) -> Size:
    """Videos, frames of each, keypoints."""
    return row.videos, row.frames, row.keypoints


def of_actions(rows: Sequence[StageCost]) -> dict[Size, ActionCost]:
    """What each action cost."""
    sizes = dict.fromkeys(size_of(row) for row in rows)
    return {size: _summed([row for row in rows if size_of(row) == size]) for size in sizes}


def models_of(rows: Sequence[StageCost]) -> CostModels:
    """Fitted to the stages of several actions."""
    processor_s, stored_mb, peak_mb = {}, {}, {}
    for stage in dict.fromkeys(row.stage for row in rows):
        of_stage = [row for row in rows if row.stage == stage]
        sizes = [size_of(row) for row in of_stage]
        seconds = [max(row.processor_s, LEAST_S) for row in of_stage]
        processor_s[stage] = fitted(sizes, seconds)
        stored_mb[stage] = fitted(sizes, [row.stored_mb for row in of_stage])
        peak_mb[stage] = fitted(sizes, [row.peak_mb for row in of_stage])
    return CostModels(processor_s, stored_mb, peak_mb)


def _summed(rows: Sequence[StageCost]) -> ActionCost:
    return ActionCost(
        sum(row.processor_s for row in rows),
        max(row.peak_mb for row in rows),
        sum(row.stored_mb for row in rows),
    )
