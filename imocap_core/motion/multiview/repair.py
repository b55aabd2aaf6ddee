"""Videos whose camera or sides the other videos refute: placed anew, swapped back.

Relocalisation: a video whose camera the others' motion refutes is placed anew by its keypoints.

The first cameras come of root orientations of monocular fits. A fit that took the back for the
front, or reversed depth, puts its camera on the other side of the performer, and no local solver
brings it back. But the keypoints that it was fitted to are right: held against the mean motion of
the other videos, at the frames that correspond, they tell the camera's rotation (scaled
orthographic, any scale and place a frame). It replaces the first one where it lies far from it and
explains the keypoints much better.

Stretches of a video in which the detector took left for right, told by the other videos.

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

How well a joint motion explains the keypoints of each video by the video's own motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from imocap_core.alignment import refined_rotation, rigid
from imocap_core.camera.averaging import angle_deg, mean_vector
from imocap_core.conventions import mirror_indices
from imocap_core.motion.multiview.keypoint_evidence import (
    KeypointEvidence,
    frame_residuals,
    keypoint_evidence,
    mean_of_others,
    registration_residuals,
)
from imocap_core.motion.multiview.low_rank import consensus_motion, to_world
from imocap_core.motion.multiview.per_video import common_at_video_frames
from imocap_core.motion.multiview.scene import PATH_SCALE_M, Cameras, Scene, align
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import MotionState
from imocap_core.sequences import cheapest_states, runs
from imocap_core.sync.hypotheses import STATES, with_swapped_sides
from imocap_core.sync.screening.registration import camera_directions

DIRECTIONS = 128
ROLLS_DEG = (-25.0, 0.0, 25.0)
STEPS_DEG = (8.0, 4.0, 2.0)  # of the rotation's refinement
FAR_DEG = 45.0  # from the first camera: what is nearer the joint solve reaches by itself
EXPLAINED_SHARE = 0.7  # of the first camera's residual, at most


def relocalise(
    scene: Scene, state: MotionState, cameras: Cameras, agreement_rad: float
) -> tuple[MotionState, Cameras]:
    """Cameras that the other videos' motion refutes are replaced, and their videos' motions with
    them by the others' mean.

    One at a time, the clearest first, as long as two others agree; of two videos at most one.

    Args:
        state: every video's motion in its own camera's axes.
        agreement_rad: as of `consensus_motion`.
    """
    evidence = keypoint_evidence(scene, state)
    twins = mirror_indices(scene.body.keypoints.names)
    R = cameras.R.cpu().numpy().copy()
    replaced: list[int] = []
    while len(replaced) < max(1, len(R) - 2):
        rest = [v for v in range(len(R)) if v not in replaced]
        ratios, rotations = zip(
            *(_better_rotation(evidence, R, v, twins) for v in rest), strict=True
        )
        best = int(np.argmin(ratios))
        if ratios[best] > EXPLAINED_SHARE:
            break
        R[rest[best]] = rotations[best]
        replaced.append(rest[best])
    if not replaced:
        return state, cameras
    turned = replace(cameras, R=torch.as_tensor(R).to(cameras.R))
    placed = _translated(scene, state, turned, replaced).in_axes_of(scene.reference)
    return _carried(scene, state, placed, replaced, agreement_rad), placed


def _better_rotation(
    evidence: KeypointEvidence, R: Float[np.ndarray, "M 3 3"], v: int, twins: Sequence[int]
) -> tuple[float, Float[np.ndarray, "3 3"]]:
    """The best far rotation of a camera; its residual over the present one's."""
    pose = mean_of_others(evidence, R, v)
    data = (evidence.xy_px[v], evidence.weight[v])
    candidates = np.concatenate([R[v][None], _candidates()])
    residuals = registration_residuals(pose, *data, candidates, twins)
    far = angle_deg(candidates, R[v]) > FAR_DEG

    def explained(R: Float[np.ndarray, "D 3 3"]) -> Float[np.ndarray, " D"]:
        return registration_residuals(pose, *data, R, twins)

    (best, residual), (near, least) = (
        refined_rotation(candidates[side][residuals[side].argmin()], explained, STEPS_DEG)
        for side in (far, ~far)
    )
    if float(angle_deg(near, R[v])) > FAR_DEG:
        least = float(residuals[~far].min())
    return residual / max(least, 1e-9), best


def _candidates() -> Float[np.ndarray, "D 3 3"]:
    """Rotations of cameras all about the performer, level in the world or rolled a little."""
    axes = camera_directions(DIRECTIONS)
    level = np.concatenate([axes, np.cross(axes[:, :1], axes[:, 1:])], axis=1)
    rolls = Rotation.from_euler("z", np.array(ROLLS_DEG)[:, None], degrees=True).as_matrix()
    return np.asarray((rolls[:, None] @ level).reshape(-1, 3, 3))


def _translated(scene: Scene, state: MotionState, cameras: Cameras, videos: list[int]) -> Cameras:
    """Translations of some cameras: their paths, from their own fits, onto the others' path."""
    aligned = align(scene.body, state, scene.timeline)
    world = to_world(aligned, cameras)
    others = [u for u in range(len(cameras.R)) if u not in videos]
    t = cameras.t.clone()
    for v in videos:
        shift, share = [], []
        for u in others:
            shift.append(aligned.root[v] - world.root[u] @ cameras.R[v].T)
            share.append(aligned.weight[v] * aligned.weight[u])
        shifts, shares = torch.cat(shift).cpu().numpy(), torch.cat(share).cpu().numpy()
        if (shares > 0).any():
            t[v] = torch.as_tensor(mean_vector(shifts, shares, scale=PATH_SCALE_M)).to(t)
    return replace(cameras, t=t)


def _carried(
    scene: Scene, state: MotionState, cameras: Cameras, videos: list[int], agreement_rad: float
) -> MotionState:
    """The poses of some videos from the mean motion of the others, where they are matched."""
    confidence = scene.timeline.confidence.copy()
    confidence[videos] = 0.0
    others = replace(scene, timeline=replace(scene.timeline, confidence=confidence))
    mean = consensus_motion(others, state, cameras, agreement_rad)
    poses = common_at_video_frames(scene, state, mean, cameras).R_local
    R_local = state.R_local.clone()
    R_local[videos] = poses[videos]
    return replace(state, R_local=R_local)


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


EXPLAINED_FLOOR = 0.02  # share of the keypoints' spread that no motion explains


def unexplained(scene: Scene, state: MotionState) -> float:
    """Mean logarithm of the share of the keypoints' spread that the motion leaves, over the matched
    frames of each video, then over the videos.

    Args:
        scene: with the sides of the detections as the motion has them.
        state: every video's motion in its own camera's axes.
    """
    poses = scene.body.positions(scene.body.keypoints, state).xyz.cpu().numpy()
    shares, ahead = point_shares(scene.body.keypoints.names), np.eye(3)[None]
    means = []
    for pose, o, position in zip(
        poses, scene.observations, scene.timeline.to_reference, strict=True
    ):
        matched = np.isfinite(position)
        weight = np.where(matched[:, None], o.confidence * shares, 0.0)
        residual = frame_residuals(pose[: len(weight)], o.xy_px, weight, ahead)[0]
        if matched.any():
            means.append(float(np.log(residual[matched] + EXPLAINED_FLOOR).mean()))
    return float(np.mean(means))
