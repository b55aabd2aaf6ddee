"""Videos that seem to show different people, by their bones.

Fitted with one body, a person with long thighs has longer ones in the pictures than the fit, and a
person with short ones shorter. A bone is measured where it lies across the line of sight, left and
right by themselves, relative to the other bones: a body is alike on both sides, what a fit or a
detector does wrong is not.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.cluster.hierarchy import fcluster, linkage

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Keypoints,
    RefineSync,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import LIMB_BONES, SIDES, SMPL_JOINTS
from imocap_core.verdict.findings import Finding

ACROSS = 0.85  # of its length a bone must show
LEAST_FRAMES, LEAST_LIMBS, LEAST_VIDEOS = 15, 3, 2
# Two performers with bodies of their own, fitted as one: 0.089 and 0.156 apart, 5.5 and 5.8 times
# the difference of sides, groups 2.0 and 1.4 times as far apart as they are wide. One performer (26
# results, made and real detections): no more than 0.07 where the groups are farther apart than wide
LEAST_DIFFERENCE = 0.07
SIDES_APART, GROUPS_APART = 3.0, 1.2


def performer_findings(
    keypoints: Keypoints, camera_motion: CameraMotion | None, refined: RefineSync
) -> list[Finding]:
    """A proposal to declare two performers; nothing where they are declared."""
    if camera_motion is None or any(v.performer is not None for v in keypoints.videos):
        return []
    cameras = {camera.id: camera for camera in camera_motion.videos}
    motions = {motion.id: motion for motion in refined.motion.videos}
    K = {camera.id: camera.K for camera in refined.motion.cameras}
    videos = [v for v in keypoints.videos if v.id not in refined.sync.excluded]
    errors = [limb_errors(v, cameras[v.id], motions[v.id], K[v.id]) for v in videos]
    groups = two_bodies(np.array(errors).reshape(-1, len(LIMB_BONES), 2))
    if groups is None:
        return []
    first, second = (
        ", ".join(v.id for v, number in zip(videos, groups, strict=True) if number == g)
        for g in (groups[0], 1 - groups[0])
    )
    text = f"the limbs of {first} have other proportions than those of {second}"
    remedy = (
        f"if they show two people, write `performer: A` below the videos {first} and `performer: "
        f"B` below {second} in action.yaml, and each gets a body of its own"
    )
    return [Finding("remark", "", text, text, remedy)]


def limb_errors(
    video: VideoKeypoints,
    camera: VideoCameraMotion,
    motion: VideoMotion,
    K: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "4 2"]:
    """Median logarithm of detected over fitted length in the picture, by limb and side; NaN where
    it is seldom seen across."""
    names = layout_names(video.layout)
    out = np.full((len(LIMB_BONES), 2), np.nan)
    for row, limb in enumerate(LIMB_BONES):
        for column, side in enumerate(SIDES):
            ends = [f"{side}_{end}" for end in limb]
            if not set(ends) <= set(names):
                continue
            near, far = (motion.joints[:, SMPL_JOINTS.index(end)] for end in ends)
            shown = np.hypot(*(_pixels(far, K) - _pixels(near, K)).T)
            start, stop = (camera.xy_first_px[:, names.index(end)] for end in ends)
            detected = np.hypot(*(stop - start).T)
            full = K[0, 0] * np.linalg.norm(far - near, axis=-1) / np.minimum(near, far)[:, 2]
            used = (shown > ACROSS * full) & np.isfinite(detected) & (detected > 0)
            if used.sum() >= LEAST_FRAMES:
                out[row, column] = np.median(np.log(detected[used] / shown[used]))
    return out


def two_bodies(errors: Float[np.ndarray, "M 4 2"]) -> list[int] | None:
    """Of each video, which of two bodies (0, 1) it shows; None where nothing speaks for two."""
    limbs = np.isfinite(errors).all(axis=(0, 2))
    if len(errors) < 2 * LEAST_VIDEOS or limbs.sum() < LEAST_LIMBS:
        return None
    used = errors[:, limbs]
    used = used - used.mean(axis=(1, 2), keepdims=True)
    proportions = used.mean(axis=2)
    groups = fcluster(linkage(proportions, "complete"), 2, "maxclust") - 1
    a, b = (proportions[groups == g] for g in (0, 1))
    if min(len(a), len(b)) < LEAST_VIDEOS:
        return None
    difference = float(np.linalg.norm(a.mean(axis=0) - b.mean(axis=0)))
    sides = float(np.sqrt(((np.diff(used, axis=2)[..., 0] / 2) ** 2).mean(axis=0).sum()))
    width = max(_distances(a, a).max(), _distances(b, b).max())
    apart = _distances(a, b).min()
    clear = difference >= max(LEAST_DIFFERENCE, SIDES_APART * sides)
    return [int(g) for g in groups] if clear and apart >= GROUPS_APART * width else None


def _distances(a: Float[np.ndarray, "A n"], b: Float[np.ndarray, "B n"]) -> np.ndarray:
    return np.asarray(np.linalg.norm(a[:, None] - b[None], axis=-1))


def _pixels(points: Float[np.ndarray, "T 3"], K: Float[np.ndarray, "3 3"]) -> np.ndarray:
    projected = points @ K.T
    return projected[:, :2] / projected[:, 2:]
