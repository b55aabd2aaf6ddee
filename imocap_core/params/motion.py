"""Parameters of the joint motion of all videos, of the loop, and of its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from imocap_core.params.bounds import Count, NonNegative, Positive, WholeNumber, param


@dataclass(frozen=True, kw_only=True)
class MotionParams:
    """Joint solve of all videos' motion and cameras, SMPL-BA (section 3.2, Eq. 3 to 8)."""

    objective: Literal["shared", "paper", "single"] = param(
        "shared",
        "`shared`: a common motion from all images, then each video's own deviation from it. "
        "`paper`: Eq. 8 as printed. `single`: one motion for all videos.",
    )
    rank: Count = param(1, "Rank s of the motions of all videos (Eq. 4 and 5).")
    rounds: Count = param(3, "Alternations of Eq. 8 (objective `paper`).")
    coupling_rad: Positive = param(
        0.1,
        "Difference of a joint's rotation between videos that costs 1 (lambda_r1 of Eq. 8).",
        unit="rad",
    )
    coupling_path_m: Positive = param(
        0.3,
        "Difference of the root's path between videos that costs 1 (lambda_r2 of Eq. 8).",
        unit="m",
    )
    agreement_rad: Positive = param(
        0.35,
        "A joint that differs by more than this from the other videos stops following them.",
        unit="rad",
    )
    correlation_s: NonNegative = param(
        0.25,
        "Time over which a performance's deviation from the common motion persists: its cost "
        "counts once per this time.",
        unit="s",
    )
    max_steps: Count = param(10, "Most Gauss-Newton steps of each solve.")
    rigid_offset_start_rad: Positive = param(
        0.08,
        "Spread of a performance's rotation as a whole against the common motion, where its "
        "estimation starts.",
        unit="rad",
    )
    rigid_offset_start_m: Positive = param(
        0.15,
        "Spread of a performance's translation as a whole against the common motion, where its "
        "estimation starts.",
        unit="m",
    )
    rigid_offset_floor_rad: Positive = param(
        0.01, "Smallest spread of that rotation that the estimation may return.", unit="rad"
    )
    rigid_offset_floor_m: Positive = param(
        0.005, "Smallest spread of that translation that the estimation may return.", unit="m"
    )


@dataclass(frozen=True, kw_only=True)
class RefineParams:
    """The loop of synchronisation and joint solve (section 3.3)."""

    max_rounds: WholeNumber = param(
        5, "Most rounds of the loop; it ends earlier when the correspondences settle."
    )
    settled_frames: NonNegative = param(
        0.1,
        "The loop ends when the correspondences move by less than this on average.",
        unit="frames",
    )
    evidence: Literal["poses", "pictures"] = param(
        "pictures",
        "What the loop synchronises by: `pictures` compares detections with the other videos' "
        "projected motion, where three videos or more show one motion; `poses` compares poses "
        "alone.",
    )


@dataclass(frozen=True, kw_only=True)
class UncertaintyParams:
    """Standard deviations of the result (uncertainty.md)."""

    correlation_s: Positive = param(
        0.4,
        "Detector errors and deviations count once per this time. Chosen on training clips.",
        unit="s",
    )
    pose_persistence_s: Positive = param(
        0.5, "The pose prior counts once per this time. Chosen on training clips.", unit="s"
    )
    lasting_error_mm: dict[str, NonNegative] = param(
        {"mediapipe33": 18.0, "blazepose33": 18.0},
        "Standard deviation of a joint's place along each axis that errors of a detector leave, "
        "where they last as long as a view does; by keypoint layout.",
        unit="mm",
    )
    weak_limit: Positive = param(
        2.0,
        "A joint whose standard deviation exceeds this many times the action's median is reported "
        "as ill-determined.",
    )
    near_limit_deg: Positive = param(
        20.0,
        "Two videos whose lines of sight differ by less than this are reported as near-identical "
        "views.",
        unit="deg",
    )
