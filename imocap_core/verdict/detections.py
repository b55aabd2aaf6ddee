"""Warnings of the detections, the people and the cameras."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from imocap_core.artifacts.schemas import VideoCameraMotion, VideoKeypoints
from imocap_core.runs import runs
from imocap_core.verdict.findings import Finding

MISSING_S = 0.5
SWAPPED_SHARE = 0.2  # of the frames: more says that the detector takes backs for fronts
LENS = " lens"  # in the parts of a camera's note that are about it
RIVAL_RATIO = 1.5  # of the performer's score to the next one's


def detection_findings(videos: Sequence[VideoKeypoints]) -> list[Finding]:
    """Long stretches without a person, cuts, swapped sides, other people."""
    return [f for video in videos for f in (*_missing(video), *_of_note(video))]


def camera_findings(cameras: Sequence[VideoCameraMotion]) -> list[Finding]:
    """Cameras that move from their place, with a path as a remark, without one as a warning; lenses
    that were corrected or should be."""
    moving = [
        _walks(camera) if len(camera.path) else _lost(camera)
        for camera in cameras
        if camera.motion == "translating"
    ]
    return moving + [finding for camera in cameras for finding in _lens(camera)]


def _lens(camera: VideoCameraMotion) -> list[Finding]:
    words = [part for part in camera.note.split("; ") if LENS in part]
    return [Finding("remark", camera.id, part, "the lens is not a pinhole") for part in words]


def _walks(camera: VideoCameraMotion) -> Finding:
    text = f"{camera.note}; the unit of its length is told by the performer's size and feet"
    return Finding("remark", camera.id, text, "the camera moves along a known path")


def _lost(camera: VideoCameraMotion) -> Finding:
    why = camera.note or f"{camera.residual_px:.1f} px from a pure rotation"
    return Finding(
        "camera",
        camera.id,
        f"the camera moves from its place, and its path is unknown ({why})",
        "the camera moves",
        "its performer's place in the world is unreliable, and counts less than the others'",
    )


def remarks(video: VideoKeypoints) -> list[str]:
    """The parts of a video's note on cuts, given tracks, swapped sides, a variable rate, and on how
    its file and keypoints were read."""
    parts = video.note.split("; ")
    kinds = (
        *("a new shot", "track ", "left and right", "the frame rate", "the time stamps"),
        *("the pixels", "the picture", "the keypoints"),
    )
    return [part for part in parts if part.startswith(kinds)]


def _missing(video: VideoKeypoints) -> list[Finding]:
    nobody = np.asarray((video.confidence > 0).sum(axis=1) == 0)
    return [
        Finding(
            "detection",
            video.id,
            f"nobody is detected for {(b - a + 1) / video.fps:.1f} s; the motion there is a guess",
            "nobody detected",
            "",
            int(video.frames[a]),
            int(video.frames[b]),
        )
        for a, b in runs(nobody, max(2, round(MISSING_S * video.fps)))
    ]


def _of_note(video: VideoKeypoints) -> list[Finding]:
    findings = []
    for part in remarks(video):
        count = re.match(r"left and right .* in (\d+) frames", part)
        if part.startswith("a new shot"):
            findings.append(Finding("detection", video.id, part, "several shots in one video"))
        elif count is None:
            findings.append(Finding("remark", video.id, part, part))
        elif int(count[1]) > SWAPPED_SHARE * len(video.frames):
            text = f"the detector swapped left and right of a limb {count[1]} times (undone)"
            text += "; it may have taken the back for the front elsewhere"
            findings.append(Finding("detection", video.id, text, "left and right uncertain"))
    rival = re.search(r"scores ([\d.]+) times the next", video.note)
    if rival is not None and float(rival[1]) < RIVAL_RATIO:
        text = "another person in the picture scores nearly as high as the one that was followed"
        advice = (
            "`imocap people` lists everybody, `person: {track: 2}` in action.yaml takes the second"
        )
        findings.append(Finding("remark", video.id, text, "another person", advice))
    return findings
