"""Parameters of the synchronisation and the search for repetitions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.params.bounds import Count, NonNegative, Positive, Share, WholeNumber, param

CycleMethod = Literal["als", "svt", "softmap", "none"]
Warp = Literal["posterior", "dtw"]


@dataclass(frozen=True, kw_only=True)
class SyncParams:
    """Synchronisation of videos by 3D poses (section 3.1, Eq. 1 and 2; sync.md)."""

    affinity: Literal["reciprocal", "gaussian"] = param(
        "reciprocal",
        "Map from pose distances to affinities: `reciprocal` is the paper's, `gaussian` is "
        "sharper.",
    )
    joint_weights: dict[str, NonNegative] = param(
        {},
        "Weights of single joints in every comparison of poses, by SMPL's joint names, as in "
        "`{left_wrist: 2}`; 1 for joints that are not named.",
    )
    method: CycleMethod = param(
        "softmap",
        "Cycle consistency of the pairwise affinities: `als` and `svt` are the paper's (Eq. 2), "
        "`softmap` composes soft maps, `none` uses the pairs as they are.",
    )
    rounds: Count = param(2, "Compositions of soft maps (method `softmap`).")
    warp: Warp = param(
        "posterior",
        "How frames are matched: `posterior` is the mean over all monotone warps, `dtw` the one "
        "best path (the paper's).",
    )
    consensus_rounds: WholeNumber = param(
        5, "Refinements of each video against the template on which the other videos agree."
    )
    orientation_window_s: Positive = param(
        1.0, "Time over which the orientation error of a monocular estimate persists.", unit="s"
    )
    evidence_per_s: Positive = param(
        15.0,
        "Independent observations of the pose per second of video. Fewer give smoother warps.",
        unit="1/s",
    )
    unmatched_level: Positive = param(
        1.0,
        "How different poses may be before a match ends: about 1 + 2 x this times the usual "
        "squared distance (`dtw`: this share of the way from matching to unrelated poses).",
    )
    regularity: Share = param(
        0.5,
        "Share of warps with a slowly changing rate among the averaged ones, in the pairwise maps.",
    )
    rate_spread: Positive = param(
        0.7,
        "Standard deviation of the logarithm of a video's rate (seconds of the reference per "
        "second of the video).",
    )
    rate_persistence_s: Positive = param(1.0, "Time over which a rate persists.", unit="s")
    positions_per_frame: Count = param(
        4, "Positions that are tried between two frames of the reference."
    )
    max_rate: Positive = param(
        32.0,
        "Upper limit of rates and of their change within a video: slow motion, time lapse and "
        "frames left out by more than this factor are not followed.",
    )
    confidence_reach_s: Positive = param(
        0.1,
        "The confidence of a match is the probability that it is right within this time of the "
        "reference.",
        unit="s",
    )
    normalise_scale: bool = param(True, "Divide each video's poses by its body size.")
    least_difference_m: NonNegative = param(
        0.04, "Pose distance below which two performances are not told apart.", unit="m"
    )
    outliers: Literal["exclude", "report", "ignore"] = param(
        "exclude",
        "A video that shows another action: `exclude` it from the joint solve, only `report` it, "
        "or check no video (`ignore`).",
    )
    mirrored: Literal["flip", "report", "ignore"] = param(
        "flip",
        "A video that shows the mirror image of the action: `flip` it for the joint solve, only "
        "`report` it, or check no video (`ignore`).",
    )

    def __post_init__(self) -> None:
        """ValueError for weights of unknown joints, or too few joints of weight above 0."""
        weights = self.joint_weights
        if unknown := sorted(set(weights) - set(SMPL_JOINTS)):
            raise ValueError(
                f"joint_weights: expected joints of {', '.join(SMPL_JOINTS)}, got {unknown[0]}"
            )
        if (count := sum(weights.get(name, 1.0) > 0 for name in SMPL_JOINTS)) < 3:
            raise ValueError(
                f"joint_weights: expected at least three joints of weight above 0, got {count}"
            )


@dataclass(frozen=True, kw_only=True)
class RepetitionParams:
    """Repetitions of one action in a long clip (`imocap sync --repetitions`; sync.md)."""

    least_score: Share = param(
        0.6,
        "Share of the clip's motion that one repetition must explain of the others; below it "
        "nothing repeats.",
    )
    least_quality: Share = param(
        0.4, "Share of an occurrence's poses that the template must explain."
    )
    match_level: Positive = param(
        0.4,
        "Squared distance up to which a pose counts as explained, as a share of the way from its "
        "nearest pose to an unrelated one.",
    )
    shortest_s: Positive = param(0.5, "Shortest repetition, at the clip's typical speed.", unit="s")
