"""Where the other videos' motion has a video's limbs, and which doubtful ones are elsewhere.

The video's own motion has no say in where its limbs are expected, only in where the body as a whole
is, so that an error does not confirm itself. What the detector is sure of is not asked: where
performances differ, the others contradict it, too, and it is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.camera.projection import project_camera
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.keypoint_evidence import KeypointEvidence, keypoint_evidence
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import MotionState

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
    evidence = keypoint_evidence(scene, state, scene.timeline.from_reference.shape[1])
    poses = scene.body.positions(scene.body.keypoints, state).xyz.cpu().numpy()
    R, K = cameras.R.cpu().numpy(), cameras.K.cpu().numpy()
    expected = []
    for v, o in enumerate(scene.observations):
        position = scene.timeline.to_reference[v]
        moments = evidence.nearest_moment(position)
        mean_m, sd_m, count = _mean_and_spread(evidence, R, v)
        middle = poses[v, : len(o.xy_px)].mean(axis=1, keepdims=True)
        place = np.zeros(3) if o.centre_m is None else o.centre_m[:, None]
        xy_px = project_camera(mean_m[moments] @ R[v].T + middle - place, K[v])
        sd_px = sd_m[moments] * K[v, 0, 0] / (middle - place)[..., 2]
        is_shown = np.isfinite(position) & (count[moments] >= LEAST_OTHERS)
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


def _mean_and_spread(
    evidence: KeypointEvidence, R: Float[np.ndarray, "M 3 3"], v: int
) -> tuple[
    Float[np.ndarray, "N K 3"], Float[np.ndarray, "N K"], Int[np.ndarray, " N"]
]:  # fmt: skip
    """The other videos' poses in the world's axes, each about its own middle: mean, standard
    deviation of each keypoint, and how many videos show the moment."""
    others = [u for u in range(len(R)) if u != v]
    world = np.einsum("mji,mnkj->mnki", R[others], evidence.xyz_m[others])
    world = world - world.mean(axis=2, keepdims=True)
    matched = np.max(evidence.weight[others] > 0, axis=2)[..., None]
    count = matched.sum(axis=0)
    mean = (matched[..., None] * world).sum(axis=0) / np.maximum(count, 1)[..., None]
    square = matched * np.square(world - mean).sum(axis=-1)
    return mean, np.sqrt(square.sum(axis=0) / np.maximum(count, 1)), count[:, 0]
