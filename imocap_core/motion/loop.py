"""A motion whose end blends into its start, so that it can be repeated without a jump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.camera.world import heading

BLEND_S = 0.5


@dataclass(frozen=True, eq=False)
class RootedMotion:
    """A motion in a world with y up: R_local (T, J, 3, 3), of the pelvis in the world, of the
    others against their parents; pelvis (T, 3), metres."""

    R_local: Float[np.ndarray, "T J 3 3"]
    pelvis: Float[np.ndarray, "T 3"]


def looped(motion: RootedMotion, fps: float, in_place: bool) -> RootedMotion:
    """The same with a last frame that is the first one again, but for where the body has come to.

    Joints, the pelvis' tilt and its height approach each other from both sides within `BLEND_S`, in
    value and in speed. The path on the floor and the heading go on: repeated, the clip continues
    from where it ended. in_place: their drift is taken out evenly, and the clip ends where it
    began.
    """
    R, pelvis = motion.R_local, motion.pelvis
    frames = min(round(BLEND_S * fps), (len(R) - 1) // 2)
    turned = heading(R[:, 0])
    angle = np.unwrap(np.arctan2(turned[:, 0, 2], turned[:, 0, 0]))
    tilted = np.concatenate([np.swapaxes(turned, 1, 2)[:, None] @ R[:, :1], R[:, 1:]], axis=1)
    closed = np.stack([_closed(tilted[:, j], frames) for j in range(R.shape[1])], axis=1)
    path = pelvis.copy()
    path[:, 1] += blend_offsets(pelvis[:, 1:2], frames)[:, 0]
    if in_place:
        drift = np.linspace(0.0, 1.0, len(R))
        angle = angle - drift * (angle[-1] - angle[0])
        path[:, [0, 2]] -= drift[:, None] * (pelvis[-1] - pelvis[0])[[0, 2]]
    about = Rotation.from_rotvec(angle[:, None] * np.array([0.0, 1.0, 0.0])).as_matrix()
    closed[:, 0] = about @ closed[:, 0]
    return RootedMotion(closed, path)


def blend_offsets(values: Float[np.ndarray, "T n"], frames: int) -> Float[np.ndarray, "T n"]:
    """What added to values makes the last one equal the first, with equal speeds there; cubic over
    `frames` at each end, 0 between."""
    gap = values[0] - values[-1]
    faster = (values[1] - values[0]) - (values[-1] - values[-2])
    return _both_ends(gap, faster, len(values), frames)


def _closed(R: Float[np.ndarray, "T 3 3"], frames: int) -> Float[np.ndarray, "T 3 3"]:
    """The same law for rotations, by vectors on the right."""

    def between(a: int, b: int) -> Float[np.ndarray, "3"]:
        return np.asarray(Rotation.from_matrix(R[a].T @ R[b]).as_rotvec())

    offsets = _both_ends(between(-1, 0), between(0, 1) - between(-2, -1), len(R), frames)
    return np.asarray(R @ Rotation.from_rotvec(offsets).as_matrix())


def _both_ends(
    gap: Float[np.ndarray, " n"], faster: Float[np.ndarray, " n"], length: int, frames: int
) -> Float[np.ndarray, "T n"]:
    """Half of the gap at the end, minus half at the start, by cubic Hermite polynomials."""
    s = np.arange(frames + 1)[:, None] / max(frames, 1)
    value, slope = s**2 * (3 - 2 * s), s**2 * (s - 1) * frames
    ending = (gap * value + faster * slope) / 2
    beginning = (-gap * value + faster * slope)[::-1] / 2
    offsets = np.zeros((length, len(gap)))
    offsets[length - 1 - frames :] += ending
    offsets[: frames + 1] += beginning
    return offsets
