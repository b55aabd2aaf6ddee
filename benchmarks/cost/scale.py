"""What thousands of actions cost, from the model of one action and stated assumptions."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.cost.model import Size
from benchmarks.cost.models import CostModels

DETECTION_S = 0.078  # of a core for a frame with one person (docs/detection.md)
DETECTION_MB = 0.0016  # stored, of a frame with one person
MBIT_PER_S, FPS = 5.0, 30.0  # of the films that are kept with the actions
DOLLARS_A_CORE_HOUR, DOLLARS_A_GB_MONTH = 0.04, 0.02
CORES = 16  # of a machine


@dataclass(frozen=True)
class ScaleCost:
    """Of all actions together.

    detection_h, stages_h: core hours. memory_gb: of a worker. results_gb, films_gb: stored.
    core_dollars, month_dollars: price of the time, and of a month of storage.
    """

    actions: int
    detection_h: float
    stages_h: float
    memory_gb: float
    results_gb: float
    films_gb: float

    @property
    def core_h(self) -> float:
        """Core hours."""
        return self.detection_h + self.stages_h

    @property
    def core_dollars(self) -> float:
        """Price of the processor time."""
        return DOLLARS_A_CORE_HOUR * self.core_h

    @property
    def month_dollars(self) -> float:
        """Price of a month of storage."""
        return DOLLARS_A_GB_MONTH * (self.results_gb + self.films_gb)

    def hours(self, machines: int) -> float:
        """On so many machines of CORES cores that are always busy."""
        return self.core_h / (CORES * machines)


def scaled(models: CostModels, actions: int, size: Size) -> ScaleCost:
    """So many actions of one size, from pixels to their reports."""
    videos, frames, _ = size
    one = models.at(size)
    films_mb = videos * frames / FPS * MBIT_PER_S / 8
    detections_mb = DETECTION_MB * videos * frames
    return ScaleCost(
        actions,
        detection_h=actions * videos * frames * DETECTION_S / 3600,
        stages_h=actions * one.processor_s / 3600,
        memory_gb=one.peak_mb / 1e3,
        results_gb=actions * (one.stored_mb + detections_mb) / 1e3,
        films_gb=actions * films_mb / 1e3,
    )
