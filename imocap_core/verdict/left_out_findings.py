"""Videos that take no part because they cannot be used, and damaged parts of those that do."""

from __future__ import annotations

from imocap_core.artifacts.schemas import Keypoints
from imocap_core.verdict.findings import Finding


def left_out_findings(keypoints: Keypoints) -> list[Finding]:
    """Each video that was left out when it was read, with the fault."""
    return [
        Finding(
            "decision",
            video.id,
            f"left out, the result is that of the other videos: {video.reason}",
            "left out, it cannot be used as it is",
            f"mend it or remove {video.id} from action.yaml",
        )
        for video in keypoints.left_out or ()
    ]


def damage_findings(keypoints: Keypoints) -> list[Finding]:
    """Each span of a video that could not be decoded."""
    return [
        Finding(
            "detection",
            video.id,
            "the video file is damaged; its keypoints are not used, and the motion there is a "
            "guess",
            "the video file is damaged",
            "get the video again",
            first,
            last,
        )
        for video in keypoints.videos
        for first, last in video.damaged or ()
    ]
