"""Parameters of fingers and wrists."""

from __future__ import annotations

from dataclasses import dataclass

from imocap_core.params.bounds import Count, NonNegative, Positive, Share, param


@dataclass(frozen=True, kw_only=True)
class HandsParams:
    """Fit of wrists and fingers after the body (hands.md).

    `coupling_rad`, `acceleration_rad_s2` and `pose_prior` were chosen on *taichi* of another seed.
    """

    noise_share: Positive = param(
        0.04, "Standard deviation of a hand's keypoint, as a share of the hand's length."
    )
    robust_scale_sigma: Positive = param(
        4.0,
        "Scale of the Geman-McClure loss of keypoint distances, in standard deviations of the "
        "noise: at this distance the cost is half its ceiling.",
    )
    min_confidence: Share = param(0.1, "Keypoints below this confidence are not used.")
    min_points: Count = param(6, "A hand with fewer keypoints than this counts as unseen.")
    wrist_rad: Positive = param(
        0.8,
        "Standard deviation of a wrist's rotation about the body's, which says little about a "
        "forearm's twist.",
        unit="rad",
    )
    offset_m: Positive = param(
        0.04, "Standard deviation of a wrist's position about the body's.", unit="m"
    )
    pose_prior: NonNegative = param(
        0.5, "Weight of squared finger angles, relative to the spread of everyday poses."
    )
    limit_rad: Positive = param(
        0.05, "Angle beyond a finger joint's range that costs 1.", unit="rad"
    )
    coupling_rad: Positive = param(
        0.3, "Difference from the hand common to all videos that costs 1.", unit="rad"
    )
    agreement_rad: Positive = param(
        0.5,
        "A finger or wrist that differs by more than this from the common hand stops following it.",
        unit="rad",
    )
    acceleration_rad_s2: Positive = param(
        20.0, "Standard deviation of accelerations of wrists and fingers.", unit="rad/s²"
    )
    offset_acceleration_m_s2: Positive = param(
        4.0, "Standard deviation of accelerations of a wrist's position.", unit="m/s²"
    )
    size_spread: Positive = param(
        0.15,
        "Standard deviation of the logarithm of the hands' size, relative to the performer's body "
        "shape.",
    )
    stride_s: Positive = param(
        0.2,
        "Time between the frames in which all rotations of the wrist are tried as a start.",
        unit="s",
    )
    max_steps: Count = param(15, "Most Gauss-Newton steps of each solve.")
