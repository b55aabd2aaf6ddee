"""Parameters of the calibration of cameras that film one event."""

from __future__ import annotations

from dataclasses import dataclass

from imocap_core.params.bounds import Positive, param


@dataclass(frozen=True, kw_only=True)
class EventParams:
    """Cameras calibrated from the performer, where all videos show one event (actions.md)."""

    bias_share: Positive = param(
        0.02,
        "Standard deviation of a detector's constant error at one point of one video, as a share "
        "of the person's size.",
    )
    bone_noise_m: Positive = param(
        0.01, "Standard deviation of a bone's length, as detected, about its mean.", unit="m"
    )
    bone_length_spread_m: Positive = param(
        0.05, "Standard deviation of that mean about the bone's length in the body.", unit="m"
    )
    common_focal_spread: Positive = param(
        0.07,
        "Standard deviation of the logarithms of unknown focal lengths about their mean, among "
        "cameras whose pictures have one size.",
    )
    distortion_spread: Positive = param(
        0.05,
        "Standard deviation of a lens's radial distortion (coefficient of the squared distance "
        "from the middle, in focal lengths). A distortion below three standard deviations of its "
        "estimate counts as none.",
    )
    rate_spread: Positive = param(
        0.001, "Standard deviation of the logarithm of a video's frame rate against its header's."
    )
    correlation_s: Positive = param(
        0.25, "Detector errors count once per this time in the claimed errors.", unit="s"
    )
