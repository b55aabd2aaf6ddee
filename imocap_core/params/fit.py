"""Parameters of the objective that every motion fit minimises."""

from __future__ import annotations

from dataclasses import dataclass

from imocap_core.params.bounds import NonNegative, Positive, param


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
    pose_prior: NonNegative = param(0.05, "Weight of the pose prior (a Gaussian mixture).")
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
        "Speed of a foot that costs 1, before the ceiling `foot_scale`: slow feet are drawn to a "
        "stop.",
        unit="m/s",
    )
    foot_hold_m_s: Positive = param(
        0.03,
        "Speed that costs 1 for a foot in contact with the ground in the motion common to all "
        "videos.",
        unit="m/s",
    )
    foot_scale: Positive = param(1.0, "Square root of the largest cost of a foot's speed.")
    path_velocity_m_s: Positive = param(100.0, "Speed of the body's root that costs 1.", unit="m/s")
    path_acceleration_m_s2: Positive = param(
        6.0, "Acceleration of the body's root that costs 1.", unit="m/s²"
    )
    evidence_mm: Positive = param(
        80.0,
        "Standard deviation of the 3D joints of a monocular estimator, where the action names one.",
        unit="mm",
    )
    balance: NonNegative = param(
        16.0,
        "Weight of the squared horizontal distance, in standard deviations, of the centre of mass "
        "from the middle of its support, where an action has one video only.",
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
