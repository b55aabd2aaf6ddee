"""Leave-one-out errors of a set of videos, as the benchmarks of real clips sum them up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imocap_core.artifacts.schemas import Uncertainty
from imocap_core.artifacts.store import Stored
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job

LAST = "uncertainty"


@dataclass(frozen=True)
class SetErrors:
    """Medians over a set's videos, in % of the person's height; NaN without any.

    error_pct: of keypoints that the other videos predict; share_10: of those within 10 %.
    monocular_pct: of hidden limbs, by each video's own fit.
    """

    error_pct: float
    share_10: float
    monocular_pct: float


def run_to_prediction(job: Job, display: Display) -> dict[str, Stored]:
    """The artifacts of an action's stages up to the prediction of each video by the others."""
    outcomes = runner.run(job, display, job.pipeline.upstream(LAST))
    return {outcome.stage: outcome.stored for outcome in outcomes}


def set_errors(done: Mapping[str, Stored]) -> SetErrors:
    """The errors of a run."""
    rows = done[LAST].decode(Uncertainty).leave_one_out
    return SetErrors(
        100 * _median([row.error_share for row in rows]),
        _median([row.near_share for row in rows]),
        100 * _median([row.monocular_error_share for row in rows]),
    )


def _median(values: list[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else float("nan")
