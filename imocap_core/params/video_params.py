"""Parameters of what looks at one video or a long film: detection, keypoints, camera motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from imocap_core.params.bounds import Count, NonNegative, Positive, Share, param


@dataclass(frozen=True, kw_only=True)
class DetectParams:
    """2D keypoint detection, for videos with `keypoints: detect` in action.yaml (detection.md)."""

    detector: Literal["auto", "blazepose", "mediapipe", "rtmlib"] = param(
        "auto",
        "Detector to run. BlazePose and rtmlib find everybody in the picture, MediaPipe (a smaller "
        "network of BlazePose's family) one person. `auto`: BlazePose, or MediaPipe with `hands`.",
    )
    hands: bool = param(
        False, "Detect the 2 x 21 points of both hands too, which the stage `hands` needs. Slower."
    )
    min_detection_confidence: Share = param(
        0.5, "MediaPipe: detections of a person below this confidence are dropped."
    )
    min_person_confidence: Share = param(
        0.3, "BlazePose: boxes of people below this confidence are dropped."
    )
    most_people: Count = param(
        5, "BlazePose: at most so many people are followed in a picture; each takes time."
    )
    every_picture: bool = param(
        False,
        "BlazePose: look at every picture. Otherwise those between two looks are interpolated "
        "where somebody moves evenly, which takes up to half the time.",
    )
    second_network: bool = param(
        True,
        "BlazePose: let MoveNet look at everybody's limbs too. Where both agree their mean is "
        "taken, where they do not a joint counts for less. Takes a quarter more time.",
    )
    min_tracking_confidence: Share = param(
        0.5,
        "BlazePose: below this confidence the person is lost, and "
        "searched for in the whole picture.",
    )
    rtmlib_person_model: str | None = param(
        None,
        "rtmlib: ONNX file of a person detector to use instead of a downloaded one, relative to "
        "the action's folder.",
    )
    rtmlib_pose_model: str | None = param(
        None,
        "rtmlib: ONNX file of a pose model to use instead of a downloaded one, relative to the "
        "action's folder.",
    )


@dataclass(frozen=True, kw_only=True)
class RedetectParams:
    """A second look where the other videos contradict what was detected (detection.md)."""

    enabled: bool = param(
        True,
        "Look again for limbs that the other videos have elsewhere, in videos with `keypoints: "
        "detect` that BlazePose detected.",
    )


@dataclass(frozen=True, kw_only=True)
class KeypointsParams:
    """Tracking of people and choice of the performer in each video (people.md)."""

    min_confidence: Share = param(0.05, "Keypoints below this confidence count as missing.")
    max_gap_s: Positive = param(
        1.0, "A person undetected for longer than this begins a new track.", unit="s"
    )
    looks: bool = param(
        True,
        "Also tell people apart by the colours of their clothes, where the action has the video "
        "file.",
    )
    performer: Literal["agreement", "score"] = param(
        "agreement",
        "How the performer is chosen where a video shows several people. `score`: the largest "
        "product of presence, size and motion. `agreement`: where scores are close, the person "
        "whose poses the other videos show too.",
    )
    sides: Literal["auto", "leave", "repair"] = param(
        "auto",
        "Whether swapped left and right limbs are corrected: `repair` always, `leave` never, "
        "`auto` for layouts whose detector swaps them (mediapipe33, blazepose33).",
    )
    correct_marks: bool = param(
        True,
        "Move shoulders and hips from where the detector marks them to the points of the body that "
        "their layout gives, by view and pose (blazepose33 only).",
    )


@dataclass(frozen=True, kw_only=True)
class CameraMotionParams:
    """Rotation and zoom of each camera, from the background (section 3.2)."""

    working_size_px: Count = param(
        640, "Pictures are scaled down until their larger side has this many pixels.", unit="px"
    )
    max_features: Count = param(400, "Most background points tracked in a picture.")
    min_inliers: Count = param(
        30, "A homography between two pictures needs at least this many agreeing points."
    )
    reprojection_threshold_px: Positive = param(
        2.0,
        "A background point further than this from a homography's prediction is an outlier, in "
        "pixels of the scaled picture.",
        unit="px",
    )
    structure: bool = param(
        True,
        "Reconstruct the path of a camera that moves from its place from the background (structure "
        "from motion; needs `pip install 'imocap[moving]'`).",
    )
    lens: bool = param(
        True,
        "Take a lens's radial distortion out of the keypoints where the camera's turning or "
        "straight lines show it. A `distortion` in action.yaml is taken out in any case.",
    )
    assumed_focal_factor: Positive = param(
        1.0,
        "Focal length divided by the picture's larger side without black bars, assumed where "
        "neither action.yaml nor the camera's rotation gives it. Phones have 0.8 to 0.9, "
        "television cameras 1 and more.",
    )


@dataclass(frozen=True, kw_only=True)
class CollectParams:
    """Occurrences of an action in long films (`imocap collect`; collect.md)."""

    least_score: Share = param(
        0.4, "Mean likeness of an occurrence to the template; below it nothing is one."
    )
    certain_score: Share = param(
        0.62, "Mean likeness from which on a stretch is an occurrence, whatever else is like it."
    )
    least_contrast: NonNegative = param(
        1.0,
        "Between these two: by how many robust standard deviations of all people's best scores "
        "an occurrence must exceed their median.",
    )
    least_height_px: Positive = param(
        60.0, "People whose box has a smaller diagonal are too small to be captured.", unit="px"
    )
    keep: Count = param(8, "Most occurrences that become videos of the action.")
