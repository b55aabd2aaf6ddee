"""Parameters of the monocular start of each video."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from imocap_core.params.bounds import Count, NonNegative, Positive, param


@dataclass(frozen=True, kw_only=True)
class InitialSmplParams:
    """Monocular start: 2D keypoints are matched against a library of poses (section 3.2)."""

    library_poses: Count = param(2000, "Poses drawn from the pose prior for the library.")
    library_directions: Count = param(96, "Viewing directions from which each pose is projected.")
    candidates: Count = param(40, "Library entries considered for each matched frame.")
    stride_s: Positive = param(
        0.1, "Time between two matched frames; frames between them are interpolated.", unit="s"
    )
    shape_prior: NonNegative = param(
        100.0,
        "Least `fit.shape_prior` of single videos, unless all have 3D joints: one view does not "
        "tell proportions from depth.",
    )
    match_sigma: Positive = param(
        0.12,
        "Standard deviation of a keypoint's distance to the matched pose, as a share of the "
        "keypoints' spread in the picture.",
    )
    step_m_s: Positive = param(
        2.0,
        "Joint speed that costs 1 when a path of poses over time is chosen among the candidates.",
        unit="m/s",
    )
    starts: Count = param(
        2, "Different starts that are fitted for each video; the fit of lowest cost is used."
    )
    hypotheses: Count = param(
        4,
        "Distinct motions kept for each video at most, of which the synchronisation takes the one "
        "that agrees with the other videos. Videos with an `initial` estimate have one.",
    )
    lifter: Literal["auto", "never"] = param(
        "auto",
        "`auto`: the learned lifter's joints (lifter.md) are starts of the fits of videos without "
        "an `initial` estimate, beside the library's poses and the detector's own 3D joints.",
    )
    max_steps: Count = param(12, "Most Gauss-Newton steps of the last fit of each video.")
