"""Training motions retargeted to the free body: joint rotations and root paths.

Captured joints do not include faces and feet, and belong to one skeleton. Brought once onto the
free body (as in tools/make_pose_prior.py), the motions apply to bodies of any shape.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from make_pose_prior import LONGEST, FittedClip, fit_clips, in_a_mirror

from lifter.anatomy import REST, J, Pose, about, from_rotvec, rotvec

LEAST_KNEE_DEG, MOST_OFFSET_DEG, LEAST_QUANTILE = 3.0, 28.0, 0.03
KEPT_FROM_DEG, KEPT_DEG = 40.0, 150.0  # deep bends are what they are


def fit_all(train: Path, cache: Path) -> dict[str, FittedClip]:
    """The beginning of every training clip, fitted; `cache` (npz) is read when it exists."""
    if not cache.exists():
        with np.load(train) as stored:
            names, parents = [str(n) for n in stored["names"]], stored["parents"].tolist()
            keys = [k for k in stored.files if k.startswith("clip_") and k != "clip_ids"]
            clips = {k: stored[k][:LONGEST].astype(float) for k in keys}
        fitted_clips = dict(zip(keys, fit_clips([*clips.values()], names, parents), strict=True))
        flat = {f"{k}/{part}": x for k, clip in fitted_clips.items()
                for part, x in zip(("theta", "trans"), clip, strict=True)}  # fmt: skip
        np.savez(cache, **flat)
    with np.load(cache) as stored:
        ids = sorted({k.split("/")[0] for k in stored.files})
        return {k: (stored[f"{k}/theta"], stored[f"{k}/trans"]) for k in ids}


def mirrored_clip(clip: FittedClip) -> FittedClip:
    """The mirror image of a motion (in the world's x), left and right swapped."""
    theta, trans = clip
    return in_a_mirror(theta), trans * np.array([-1.0, 1.0, 1.0])


def with_straight_legs(clip: FittedClip) -> FittedClip:
    """A clip (z up) whose least knee flexion is that of people.

    The captured skeleton's hip joint is too low and its thigh too short, so all of its legs are
    bent. What a clip's straightest frames have more than people's is taken from the knees, from the
    hips what keeps the ankle in its direction, from the ankles what keeps the sole; the root rises.
    """
    theta, trans = (x.astype(float) for x in clip)
    R = from_rotvec(theta)
    knees = [J[f"{side}_knee"] for side in ("left", "right")]
    bend = np.degrees(theta[:, knees, 0])
    offset = np.clip(np.quantile(bend, LEAST_QUANTILE) - LEAST_KNEE_DEG, 0, MOST_OFFSET_DEG)
    less = offset * np.clip((KEPT_DEG - bend) / (KEPT_DEG - KEPT_FROM_DEG), 0, 1)
    before = _lowest_ankle(R)
    for column, knee in enumerate(knees):
        hip, ankle = knee - 3, knee + 3
        thigh = _ahead_deg(bend[:, column], knee) - _ahead_deg(
            bend[:, column] - less[:, column], knee
        )
        R[:, hip] = R[:, hip] @ about("x", thigh)
        R[:, knee] = R[:, knee] @ about("x", -less[:, column])
        R[:, ankle] = about("x", less[:, column] - thigh) @ R[:, ankle]
    trans[:, 2] += before - _lowest_ankle(R)
    return rotvec(R), trans


def _ahead_deg(bend_deg: np.ndarray, knee: int) -> np.ndarray:
    """Angle of the thigh before the line from hip to ankle."""
    thigh, shank = (np.linalg.norm(REST[k] - REST[k - 3]) for k in (knee, knee + 3))
    bend = np.radians(bend_deg)
    return np.degrees(np.arctan2(shank * np.sin(bend), thigh + shank * np.cos(bend)))


def _lowest_ankle(R: np.ndarray) -> np.ndarray:
    """(T,) height of the lower ankle over the pelvis joint, metres; z up."""
    xyz = Pose(R, np.zeros((len(R), 3))).posed()[1]
    return xyz[:, [J["left_ankle"], J["right_ankle"]], 2].min(1)
