"""What the other videos' motion says of a video's limbs.

A video's keypoints are held against the other videos' motion, at corresponding moments. Its own
motion does not vote, so that an error does not confirm itself. A joint that the detector was not
sure of and that lies elsewhere than the others expect it is detected again. What it is sure of is
kept: where performances differ, the others contradict it too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.camera.projection import project_camera
from imocap_core.motion.multiview.scene import Cameras, Scene
from imocap_core.motion.multiview.timeline import sample
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import MotionState


@dataclass(frozen=True)
class PosesOfOthers:
    """Mean pose of the other videos at each frame of a video, about its middle, world axes.

    Attributes:
        mean_m: (T, K, 3); sd_m: (T, K) standard deviation of each keypoint.
        count: (T,) videos that show the moment.
    """

    mean_m: Float[np.ndarray, "T K 3"]
    sd_m: Float[np.ndarray, "T K"]
    count: Int[np.ndarray, " T"]


def poses_of_others(
    scene: Scene, state: MotionState, R: Float[np.ndarray, "M 3 3"]
) -> list[PosesOfOthers]:
    """Of every video the other videos' poses in the world's axes, each about its own middle."""
    timeline, xyz = scene.timeline, scene.body.positions(scene.body.keypoints, state)
    rows = zip(xyz, scene.observations, timeline.from_reference, strict=True)
    motions = np.stack([sample(x[: len(o.xy_px)], f).cpu().numpy() for x, o, f in rows])
    world = np.einsum("mji,mnkj->mnki", R, motions)
    world = world - world.mean(axis=2, keepdims=True)
    matched = np.asarray(scene.keypoints.weight.max(axis=2) > 0)[..., None]

    def without(v: int) -> PosesOfOthers:
        others, position = np.arange(len(R)) != v, timeline.to_reference[v]
        count = matched[others].sum(axis=0)
        mean = (matched[others][..., None] * world[others]).sum(axis=0)
        mean = mean / np.maximum(count, 1)[..., None]
        square = matched[others] * np.square(world[others] - mean).sum(axis=-1)
        sd = np.sqrt(square.sum(axis=0) / np.maximum(count, 1))
        near = np.clip(np.ceil(np.nan_to_num(position) - 0.5), 0, len(count) - 1).astype(int)
        shown = np.where(np.isfinite(position), count[near, 0], 0)
        return PosesOfOthers(mean[near], sd[near], shown)

    return [without(v) for v in range(len(R))]


LIMB_JOINTS = ("elbow", "wrist", "knee", "ankle")
SURE = 0.5  # confidence from which a detection is not doubted
LEAST_OTHERS = 2  # videos that show a moment: of two, either may be wrong
AWAY = 0.05  # distance, in sizes of the person, from where the others expect a joint,
SPREADS = 2.0  # and so many standard deviations of the others from one another


@dataclass(frozen=True)
class ExpectedPlaces:
    """Where the other videos expect a video's keypoints, in its first frame's picture.

    Attributes:
        xy_px: (T, K, 2), NaN in frames with too few counterparts.
        limit_px: (T, K) distance from there beyond which the others contradict a detection.
    """

    xy_px: Float[np.ndarray, "T K 2"]
    limit_px: Float[np.ndarray, "T K"]


def expected_by_others(scene: Scene, state: MotionState, cameras: Cameras) -> list[ExpectedPlaces]:
    """Of every video the places of its keypoints by the mean of the other videos' poses.

    Args:
        state: every video's motion in its own camera's axes; its body's middle is where the poses
            of the others are put.
    """
    poses = scene.body.positions(scene.body.keypoints, state).cpu().numpy()
    R, K = cameras.R.cpu().numpy(), cameras.K.cpu().numpy()
    expected = []
    rows = zip(scene.observations, poses_of_others(scene, state, R), strict=True)
    for v, (o, others) in enumerate(rows):
        middle = poses[v, : len(o.xy_px)].mean(axis=1, keepdims=True)
        place = np.zeros(3) if o.centre_m is None else o.centre_m[:, None]
        xy_px = project_camera(others.mean_m @ R[v].T + middle - place, K[v])
        sd_px = others.sd_m * K[v, 0, 0] / (middle - place)[..., 2]
        is_shown = others.count >= LEAST_OTHERS
        expected.append(
            ExpectedPlaces(
                np.where(is_shown[:, None, None], xy_px, np.nan),
                np.hypot(AWAY * o.size_px[:, None], SPREADS * sd_px),
            )
        )
    return expected


def contradicted(
    observation: Observation, expected: ExpectedPlaces, names: Sequence[str]
) -> Bool[np.ndarray, "T K"]:
    """Which limb joints were detected, with doubt, where the other videos do not have them.

    Args:
        names: of the keypoints.
    """
    away = np.linalg.norm(observation.xy_px - expected.xy_px, axis=-1)
    limbs = np.array([name.partition("_")[2] in LIMB_JOINTS for name in names])
    doubted = (observation.confidence > 0) & (observation.confidence < SURE) & limbs
    return doubted & (np.nan_to_num(away) > expected.limit_px)
