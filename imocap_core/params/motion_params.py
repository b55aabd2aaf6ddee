"""Parameters of every motion fit: the objective, the monocular start, the joint motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from imocap_core.params.bounds import Count, NonNegative, Positive, WholeNumber, param


@dataclass(frozen=True, kw_only=True)
class FitParams:
    """Terms of the objective, in every fit of the body (section 3.2; paper.md)."""

    focal_spread: NonNegative = param(
        0.15,
        "Standard deviation of the logarithm of an assumed focal length, which is then solved for "
        "with the motion of all videos. 0: the assumed value stays.",
    )
    noise_share: Positive = param(
        0.01,
        "Standard deviation of a detected keypoint, as a share of the person's size in the "
        "picture.",
    )
    noise_share_of: dict[str, Positive] = param(
        {"mediapipe33": 0.02, "blazepose33": 0.02},
        "The same by keypoint layout, for detectors that differ from `noise_share`.",
    )
    robust_scale_sigma: Positive = param(
        4.0,
        "Scale of the Geman-McClure loss of reprojection errors, in standard deviations of the "
        "detector's noise: at this error the cost is half its ceiling.",
    )
    pose_prior: NonNegative = param(0.2, "Weight of the pose prior (a Gaussian mixture).")
    shape_prior: NonNegative = param(
        10.0,
        "Weight of the squared shape coefficients along the proportions that keypoints tell: "
        "limbs, hips, shoulders, trunk.",
    )
    shape_prior_of: dict[str, Positive] = param(
        {"mediapipe33": 100.0, "blazepose33": 30.0},
        "The same by keypoint layout, for detectors whose points are off at the same places in "
        "every frame: such errors look like another body.",
    )
    hidden_shape_prior: NonNegative = param(
        100.0,
        "Weight of the squared shape coefficients along which keypoints tell nothing: the form of "
        "a torso between hips and shoulders.",
    )
    size_prior: NonNegative = param(
        1000.0,
        "Weight of the squared change of size, which pictures do not tell either, in shape "
        "coefficients. High, because small people near the camera cost less.",
    )
    limits: NonNegative = param(
        100.0, "Weight of the squared angle by which a knee or elbow bends backwards."
    )
    velocity: NonNegative = param(
        0.02,
        "Weight of joint rotation speeds (lambda_t of Eq. 7), relative to the speeds of real "
        "motion.",
    )
    acceleration: NonNegative = param(
        4.0,
        "Weight of small joint rotation accelerations, relative to the accelerations of real "
        "motion.",
    )
    acceleration_scale: Positive = param(
        0.7, "Cost above which an acceleration's cost grows only logarithmically."
    )
    joint_acceleration: NonNegative = param(
        0.07,
        "Weight of the accelerations of joints in space, relative to their likelihood in real "
        "motion. Neighbouring joints and frames accelerate together, so it is far below 1.",
    )
    foot_speed_m_s: Positive = param(
        0.2,
        "Speed of a foot that costs half of the most: slow feet are drawn to a stop.",
        unit="m/s",
    )
    foot_hold_m_s: Positive = param(
        0.03,
        "Speed that costs 1 for a foot in contact with the ground in the motion common to all "
        "videos.",
        unit="m/s",
    )
    path_acceleration_m_s2: Positive = param(
        6.0, "Acceleration of the body's root that costs 1.", unit="m/s²"
    )
    evidence_mm: Positive = param(
        80.0,
        "Standard deviation of the 3D joints of a monocular estimator, where the action names one.",
        unit="mm",
    )
    camera_roll_deg: Positive = param(
        2.0,
        "Standard deviation of a camera's roll: cameras are held level, which tells where up is "
        "(heavy tails allow for exceptions).",
        unit="deg",
    )
    camera_pitch_deg: Positive = param(
        8.0, "Standard deviation of a camera's pitch about `camera_pitch_down_deg`.", unit="deg"
    )
    camera_pitch_down_deg: NonNegative = param(
        5.0,
        "Mean pitch of cameras, downwards: held at a chest's or an eye's height, 3 to 6 m from the "
        "middle of a body.",
        unit="deg",
    )


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
    correlation_s: NonNegative = param(
        0.25,
        "Time over which a performance's deviation from the common motion persists: its cost "
        "counts once per this time.",
        unit="s",
    )
    max_steps: Count = param(10, "Most Gauss-Newton steps of each solve.")


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


@dataclass(frozen=True, kw_only=True)
class EvaluateParams:
    """Metrics, tables and figures (report.md)."""

    figures: bool = param(True, "Draw the report's figures. Without them it is written faster.")
