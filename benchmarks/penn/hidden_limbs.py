"""A limb hidden in the middle third of a clip: where the lifter has it, and straight interpolation.

Each of the four limbs in turn. The lifted pose is put into the picture by one scale and shift a
frame, from the joints that are seen (scaled orthographic).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from benchmarks.penn.clips import FPS, LAYOUT, Clip
from imocap_core.body.layouts import layout_names
from imocap_core.camera.projection import intrinsics
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.lifter.infer import lift
from imocap_core.lifter.lifter_network import load_lifter, to_common

NAMES = layout_names(LAYOUT)
LIMBS = tuple(
    tuple(NAMES.index(f"{side}_{joint}") for joint in joints)
    for side in ("left", "right")
    for joints in (("elbow", "wrist"), ("knee", "ankle"))
)
BODY = list(range(1, len(NAMES)))  # all but the head, which is no joint of SMPL
IN_SMPL = [SMPL_JOINTS.index(NAMES[k]) for k in BODY]
NEAR = 0.2  # of the torso
LEAST_SEEN = 4  # joints in a frame that place the pose


@dataclass(frozen=True)
class HiddenLimbs:
    """Shares of hidden joints within 0.2 of the torso, %."""

    lifter_pct: float
    straight_pct: float


def hidden_limbs(clips: Sequence[Clip]) -> HiddenLimbs:
    """All limbs of all clips together."""
    near = [_near(clip, limb) for clip in clips for limb in LIMBS]
    lifted, straight = (np.concatenate([n[k] for n in near]) for k in (0, 1))
    return HiddenLimbs(100 * float(lifted.mean()), 100 * float(straight.mean()))


def _near(clip: Clip, limb: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Of each hidden label, whether the lifter's and the interpolated place are near it."""
    frames = np.arange(len(clip.xy_px))
    hidden = frames[len(frames) // 3 : 2 * len(frames) // 3]
    visible_mask = clip.visible.copy()
    visible_mask[np.ix_(hidden, np.asarray(limb))] = False
    torso_px = np.linalg.norm(_middle(clip, "shoulder") - _middle(clip, "hip"), axis=-1)
    is_known = clip.visible[np.ix_(hidden, np.asarray(limb))]
    answers = (
        lifted_px(clip, visible_mask)[np.ix_(hidden, np.asarray(limb))],
        straight_px(clip.xy_px, visible_mask, limb)[hidden],
    )
    truth = clip.xy_px[np.ix_(hidden, np.asarray(limb))]
    lifted, straight = (
        np.nan_to_num(np.linalg.norm(x - truth, axis=-1), nan=np.inf)[is_known]
        < NEAR * np.median(torso_px)
        for x in answers
    )
    return lifted, straight


def lifted_px(clip: Clip, visible_mask: np.ndarray) -> Float[np.ndarray, "T 13 2"]:
    """The lifter's joints in the picture; NaN where too few joints are seen, and of the head."""
    K = intrinsics(float(max(clip.size)), clip.size)
    rays = (clip.xy_px - K[:2, 2]) / K[0, 0]
    points, confidence = to_common(rays, visible_mask.astype(float), LAYOUT)
    pose = lift(load_lifter(), points, confidence, FPS).joints[:, IN_SMPL, :2]
    weight = visible_mask[:, BODY].astype(float)[..., None]
    total = np.maximum(weight.sum(1, keepdims=True), 1.0)
    centre, middle = (
        (weight * x).sum(1, keepdims=True) / total for x in (pose, clip.xy_px[:, BODY])
    )
    p, x = pose - centre, clip.xy_px[:, BODY] - middle
    scale = (weight * p * x).sum((1, 2)) / np.maximum((weight * p * p).sum((1, 2)), 1e-9)
    out = np.full(clip.xy_px.shape, np.nan)
    placed = weight.sum((1, 2)) >= LEAST_SEEN
    out[:, BODY] = np.where(placed[:, None, None], middle + scale[:, None, None] * p, np.nan)
    return out


def straight_px(
    xy_px: Float[np.ndarray, "T 13 2"], visible_mask: np.ndarray, limb: Sequence[int]
) -> Float[np.ndarray, "T L 2"]:
    """Each joint on a straight line between the frames that show it; NaN where none does."""
    frames = np.arange(len(xy_px))
    out = np.full((len(xy_px), len(limb), 2), np.nan)
    for n, joint in enumerate(limb):
        shown: Int[np.ndarray, " _"] = np.flatnonzero(visible_mask[:, joint])
        if len(shown):
            for axis in range(2):
                out[:, n, axis] = np.interp(frames, shown, xy_px[shown, joint, axis])
    return out


def _middle(clip: Clip, joint: str) -> Float[np.ndarray, "T 2"]:
    """Middle of the left and right joint."""
    return np.asarray(
        clip.xy_px[:, [NAMES.index(f"{side}_{joint}") for side in ("left", "right")]].mean(axis=1)
    )
