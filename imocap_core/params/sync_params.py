"""Parameters of the synchronisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from imocap_core.params.bounds import Count, NonNegative, Positive, WholeNumber, param

CycleMethod = Literal["als", "svt", "softmap", "none"]
Warp = Literal["posterior", "dtw"]


@dataclass(frozen=True, kw_only=True)
class SyncParams:
    """Synchronisation of videos by 3D poses (section 3.1, Eq. 1 and 2; sync.md)."""

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
        5,
        "Refinements, at most, of each video against the template on which the other videos agree.",
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
