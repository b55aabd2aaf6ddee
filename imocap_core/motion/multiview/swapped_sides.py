"""Stretches of a video in which the detector took left for right, told by the other videos.

Swapped sides of the whole body look, to one view, like a performer who faces the other way. Seen
from the video's camera, the other videos' motion decides: each frame's keypoints are as detected or
swapped, whichever that motion explains better, and the cheapest sequence of the two states, where
every change costs something, is the estimate (Viterbi).

A performer who really turns away looks alike, too. Then the video's own motion turns against the
others' little by little, and for a while faces a quarter another way; one whose sides were
swapped faces as the others do (it was held by the frames around) or the opposite way, and nothing
between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from imocap_core.alignment import rigid
from imocap_core.conventions import mirror_indices
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.keypoint_evidence import (
    SWAPPED,
    frame_residuals,
    keypoint_evidence,
    mean_of_others,
)
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import MotionState
from imocap_core.runs import runs
from imocap_core.viterbi import cheapest_states

QUARTER_RAD = (np.pi / 4, 3 * np.pi / 4)  # that no swap of sides turns a body by
TURNING_SHARE, TURNING_S = 0.2, 0.27  # of a stretch: less is a fit's own turn at its two ends
RATE_PER_S = 15.0  # frames of which each is a piece of evidence by itself
CHANGE = 0.5  # of a change of state


def with_sides_of_others(scene: Scene, state: MotionState, cameras: Cameras) -> Scene:
    """The scene with left and right swapped in the frames where the other videos say so.

    Args:
        state: every video's motion in its own camera's axes.
    """
    if len(scene.observations) < 2:
        return scene
    evidence = keypoint_evidence(scene, state)
    R = cameras.R.cpu().numpy()
    twins = mirror_indices(scene.body.keypoints.names)
    poses = scene.body.positions(scene.body.keypoints, state).xyz.cpu().numpy()
    observations = []
    for v, observation in enumerate(scene.observations):
        position = scene.timeline.to_reference[v]
        pose = mean_of_others(evidence, R, v)[evidence.nearest_moment(position)]
        weight = np.where(np.isfinite(position)[:, None], observation.confidence, 0.0)
        frames = swapped_frames(pose, observation.xy_px, weight, R[v], twins, observation.fps)
        frames &= ~turning_frames(poses[v, : len(frames)], pose @ R[v].T, frames, observation.fps)
        observations.append(swapped(observation, frames, twins))
    return replace(scene, observations=observations)


def swapped_frames(
    pose: Float[np.ndarray, "T K 3"],
    xy_px: Float[np.ndarray, "T K 2"],
    weight: Float[np.ndarray, "T K"],
    R: Float[np.ndarray, "3 3"],
    twins: Sequence[int],
    fps: float,
) -> Bool[np.ndarray, " T"]:
    """In which frames a pose, rotated by R, explains the keypoints with left and right swapped.

    Args:
        xy_px: any value where the weight is 0; twins: each keypoint's counterpart.
    """
    columns = list(twins)
    plain, other = (
        frame_residuals(pose, x, w, R[None])[0]
        for x, w in ((xy_px, weight), (xy_px[:, columns], weight[:, columns]))
    )
    share = min(1.0, RATE_PER_S / fps)
    costs = share * np.stack([plain, other + SWAPPED], axis=1)
    steps = CHANGE * (1.0 - np.eye(2)) + costs[1:, None]
    return cheapest_states(costs[0], steps).astype(bool)


def turning_frames(
    pose: Float[np.ndarray, "T K 3"],
    others: Float[np.ndarray, "T K 3"],
    frames: Bool[np.ndarray, " T"],
    fps: float,
) -> Bool[np.ndarray, " T"]:
    """Those of some frames, by whole stretches, in which the performer turns against the others.

    Args:
        pose, others: of the video and of the others, in the axes of the video's camera.
    """
    turning = np.zeros_like(frames)
    for first, last in runs(frames):
        stretch = slice(first, last + 1)
        R = rigid(pose[stretch], others[stretch]).R_target_from_source
        angle = Rotation.from_matrix(R).magnitude()
        quarter = (angle > QUARTER_RAD[0]) & (angle < QUARTER_RAD[1])
        least = max(TURNING_S * fps, TURNING_SHARE * (last + 1 - first))
        turning[stretch] = round(least) <= quarter.sum()
    return turning


def swapped(
    observation: Observation, frames: Bool[np.ndarray, " T"], twins: Sequence[int]
) -> Observation:
    """The observation with left and right swapped in some frames."""
    if not frames.any():
        return observation
    xy_px, confidence = observation.xy_px.copy(), observation.confidence.copy()
    xy_px[frames] = xy_px[frames][:, list(twins)]
    confidence[frames] = confidence[frames][:, list(twins)]
    return replace(observation, xy_px=xy_px, confidence=confidence)
