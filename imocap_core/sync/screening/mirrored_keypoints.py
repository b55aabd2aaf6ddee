"""Mirrored videos by their keypoints: the others' motion explains them better reflected.

A monocular fit that reversed depth is the mirror image of the right one, seen from the other side:
by its 3D poses its video looks mirrored, though it is not. Its keypoints are not deceived. Held
against the other videos' motions under the best camera and warp (`registration`), those of a
mirrored video fit better reflected, and those of a wrongly fitted one as they are. An action that
is its own mirror image has no evidence either way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.screening.registration import (
    Keypoints2D,
    camera_directions,
    registration_residual,
)

# Logarithm of the residuals' ratio. Genuine videos stay below 0, but for one of four people who
# dribble a ball (0.21): keypoints alone must be much clearer than that.
LEAST_KEYPOINT_MARGIN, CLEAR_KEYPOINT_MARGIN = 0.05, 0.35
DIRECTIONS = 48
REFLECTED_AXES = np.array([[1.0, -1.0, -1.0], [-1.0, 1.0, 1.0]])  # S R S of right and down
MOST_FRAMES = 90  # of each video that are compared


def reflected_keypoints(keypoints: Keypoints2D, twins: Sequence[int]) -> Keypoints2D:
    """The keypoints of the picture seen in a mirror; twins: each joint's left-right counterpart."""
    xy_px = (keypoints.xy_px * np.array([-1.0, 1.0]))[:, list(twins)]
    return Keypoints2D(xy_px, keypoints.weight[:, list(twins)])


def judged_by_keypoints(
    detected: Sequence[int],
    margins: Float[np.ndarray, " M"],
    pinned: Sequence[bool],
    motions: Sequence[Float[np.ndarray, "_ J 3"]],
    keypoints: Sequence[Keypoints2D],
    twins: Sequence[int],
) -> tuple[list[int], list[int], Float[np.ndarray, " M"]]:
    """The mirrored videos, those that only look mirrored by their poses, and all margins.

    The margin of a mirrored video is the poses', or the keypoints' where these are very clear.

    Args:
        detected, margins: by the poses; pinned: videos whose reflection is given.
        motions, keypoints: per video, of the same frames and joints.
    """
    others = [v for v in range(len(motions)) if v not in detected]
    by_keypoints = {v: keypoint_margin(v, others, motions, keypoints, twins) for v in detected}
    mirrored = [v for v, margin in by_keypoints.items() if margin >= LEAST_KEYPOINT_MARGIN]
    refuted = [v for v in detected if v not in mirrored]
    if not mirrored and not any(pinned):
        by_keypoints = mirrored_by_keypoints(range(len(motions)), motions, keypoints, twins)
        mirrored = list(by_keypoints)
    largest = margins.copy()
    for v in mirrored:
        if by_keypoints[v] >= CLEAR_KEYPOINT_MARGIN:
            largest[v] = np.fmax(margins[v], by_keypoints[v])
    return mirrored, [v for v in refuted if v not in mirrored], largest


def keypoint_margin(
    video: int,
    others: Sequence[int],
    motions: Sequence[Float[np.ndarray, "_ J 3"]],
    keypoints: Sequence[Keypoints2D],
    twins: Sequence[int],
) -> float:
    """How much better the others' motions explain a video's keypoints reflected than as they are.

    Mean over the others of log(residual as they are / residual reflected); 0 without others.

    Args:
        motions, keypoints: per video, of the same frames and joints.
    """
    stride = -(-max(len(motions[v]) for v in [video, *others]) // MOST_FRAMES)
    axes = camera_directions(DIRECTIONS)
    directions = np.concatenate([axes, axes * REFLECTED_AXES])  # unbiased: their own mirror image
    film = Keypoints2D(keypoints[video].xy_px[::stride], keypoints[video].weight[::stride])
    ratios = []
    for u in others:
        plain, reflected = (
            registration_residual(motions[u][::stride], k, directions)
            for k in (film, reflected_keypoints(film, twins))
        )
        ratios.append(np.log(max(plain, 1e-9) / max(reflected, 1e-9)))
    return float(np.mean(ratios)) if ratios else 0.0


def mirrored_by_keypoints(
    undetected: Sequence[int],
    motions: Sequence[Float[np.ndarray, "_ J 3"]],
    keypoints: Sequence[Keypoints2D],
    twins: Sequence[int],
) -> dict[int, float]:
    """The one clearly mirrored video among some that look alike by their poses, and its margin.

    Three videos or more; the others' keypoints must speak against a reflection among themselves.
    """
    if len(undetected) < 3:
        return {}
    margins = {}
    for v in undetected:
        others = [u for u in undetected if u != v]
        margins[v] = keypoint_margin(v, others, motions, keypoints, twins)
    first = max(margins, key=lambda v: margins[v])
    others = [u for u in undetected if u != first]
    if margins[first] < CLEAR_KEYPOINT_MARGIN:
        return {}
    for v in others:
        rest = [u for u in others if u != v]
        if keypoint_margin(v, rest, motions, keypoints, twins) > -LEAST_KEYPOINT_MARGIN:
            return {}
    return {first: margins[first]}
