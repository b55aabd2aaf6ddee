"""Stretches of a video in which the detector took left for right, told by the other videos.

Swapped sides of the whole body look, to one view, like a performer who faces the other way, and
swapped legs like other steps. Seen from the video's camera, the other videos' motion decides: each
frame's keypoints are as detected, with swapped legs, or swapped as a whole, whichever that motion
explains best, and the cheapest sequence of these states, where every change costs something, is the
estimate (Viterbi). Detections whose sides were swapped before the joint motion was known are judged
as they were detected.

A performer who really turns away looks like swapped sides, too. Then the video's own motion turns
against the others' little by little, and for a while faces a quarter another way; one whose sides
were swapped faces as the others do (it was held by the frames around) or the opposite way, and
nothing between.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from imocap_core.alignment import rigid
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.keypoint_evidence import (
    frame_residuals,
    keypoint_evidence,
    mean_of_others,
)
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import MotionState
from imocap_core.runs import runs
from imocap_core.sync.hypotheses.swapped_sides import STATES, with_swapped_sides
from imocap_core.viterbi import cheapest_states

QUARTER_RAD = (np.pi / 4, 3 * np.pi / 4)  # that no swap of sides turns a body by
TURNING_SHARE, TURNING_S = 0.2, 0.27  # of a stretch: less is a fit's own turn at its two ends
RATE_PER_S = 15.0  # frames of which each is a piece of evidence by itself
SWAPPED = 0.1  # of a frame, in logarithms of the residual
FLOOR = 0.1  # share of the keypoints' spread by which performances differ without being swapped
LEGS, WHOLE = 2, 3  # states of `swapped_by_others`
CHANGE = np.array([0.0, 1.0, 0.5, 1.0])  # to or from each state: legs are swapped most often
HEAD, HANDS = ("nose", "eye", "ear", "mouth", "head"), ("thumb", "index", "pinky", "finger")


def with_sides_of_others(scene: Scene, state: MotionState, cameras: Cameras) -> Scene:
    """The scene with left and right swapped in the frames where the other videos say so.

    Legs alone are judged by two others at least: of two videos either may have them swapped. What
    is above the hips is swapped alone only where it was before, by the choice of motions.

    Args:
        state: every video's motion in its own camera's axes.
    """
    if len(scene.observations) < 2:
        return scene
    frames = scene.timeline.from_reference.shape[1]
    evidence = keypoint_evidence(scene, state, frames)  # legs pass each other within a few
    R = cameras.R.cpu().numpy()
    names = scene.body.keypoints.names
    alone = [LEGS] if len(R) > 2 else []
    poses = scene.body.positions(scene.body.keypoints, state).xyz.cpu().numpy()
    observations = []
    for v, o in enumerate(scene.observations):
        position = scene.timeline.to_reference[v]
        pose = mean_of_others(evidence, R, v)[evidence.nearest_moment(position)]
        weight = np.where(np.isfinite(position)[:, None], o.confidence, 0.0)
        before = o.swapped_states
        possible = {0, *alone, WHOLE, *before.tolist()}
        states = swapped_states(pose, o.xy_px, weight, R[v], names, o.fps, before, possible)
        whole = (states == WHOLE) & (before != WHOLE)
        whole &= turning_frames(poses[v, : len(whole)], pose @ R[v].T, whole, o.fps)
        observations.append(swapped(o, before ^ np.where(whole, before, states), names))
    return replace(scene, observations=observations)


def with_sides(scene: Scene, states: Sequence[Int[np.ndarray, " _"]]) -> Scene:
    """The scene with left and right swapped as each video's states say (of
    `swapped_by_others`, in all)."""
    names = scene.body.keypoints.names
    rows = zip(scene.observations, states, strict=True)
    observations = [swapped(o, o.swapped_states ^ state, names) for o, state in rows]
    return replace(scene, observations=observations)


def swapped_states(
    pose: Float[np.ndarray, "T K 3"],
    xy_px: Float[np.ndarray, "T K 2"],
    weight: Float[np.ndarray, "T K"],
    R: Float[np.ndarray, "3 3"],
    names: Sequence[str],
    fps: float,
    before: Int[np.ndarray, " T"],
    possible: Iterable[int] = (0, LEGS, WHOLE),
) -> Int[np.ndarray, " T"]:
    """What of the detections has to be swapped for a pose, rotated by R, to explain them best.

    Args:
        xy_px: any value where the weight is 0; names: of the keypoints.
        before: what of them was swapped already; possible: what may be swapped in all. Both are
            states of `swapped_by_others`, as those returned are.
    """
    costs = np.full((len(pose), STATES), np.inf)
    weight = weight * point_shares(names)
    for state in possible:
        x, w = (with_swapped_sides(q, before ^ state, names) for q in (xy_px, weight))
        residual = frame_residuals(pose, x, w, R[None])[0]
        costs[:, state] = np.log(residual + FLOOR) + SWAPPED * (state > 0)
    costs *= min(1.0, RATE_PER_S / fps)
    change = np.maximum(CHANGE[:, None], CHANGE) * (1.0 - np.eye(STATES))
    steps = change + costs[1:, None]
    return cheapest_states(costs[0], steps)


def point_shares(names: Sequence[str]) -> Float[np.ndarray, " K"]:
    """Weight of each keypoint: all of the head count as one, and all of both hands as two, however
    many a detector marks there; they tell nothing of legs."""
    shares = np.ones(len(names))
    for words, total in ((HEAD, 1), (HANDS, 2)):
        part = [any(w in name for w in words) and "foot" not in name for name in names]
        if sum(part) > total:
            shares[part] = total / sum(part)
    return shares


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
    observation: Observation, states: Int[np.ndarray, " T"], names: Sequence[str]
) -> Observation:
    """The observation with its sides swapped as the states of `swapped_by_others` say."""
    if not states.any():
        return observation
    xy_px, confidence = (
        with_swapped_sides(x, states, names) for x in (observation.xy_px, observation.confidence)
    )
    in_all = observation.swapped_states ^ states
    return replace(observation, xy_px=xy_px, confidence=confidence, swapped=in_all)
