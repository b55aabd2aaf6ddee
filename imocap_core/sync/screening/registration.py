"""Registration of a video's keypoints with a motion: the best camera and the best monotone warp.

A monocular fit may go wrong (depth reversed, back taken for front), and then its poses lie far from
everybody's. The keypoints it was fitted to do not go wrong with it. So a video is held against a
motion by its keypoints alone: under the best camera direction (scaled orthographic, any scale and
place a frame) and the best monotone warp. The residual of a frame is the share of its keypoints'
spread that the projected pose leaves, between 0 and 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

from imocap_core.workers import compiled

DIRECTIONS = 64  # on the sphere, of which those nearly along gravity are left out
STEEPEST = 0.9  # sine of a camera's elevation
UNBIASED_DIRECTIONS, STEEPEST_UNBIASED = 80, 0.5  # with as many reflected ones
REFLECTED_AXES = np.array([[1.0, -1.0, -1.0], [-1.0, 1.0, 1.0]])  # S R S of right and down
MAX_STEP = 4  # positions that a warp may go on from one frame to the next
HOLD_COST, SKIP_COST = 0.1, 0.02  # of staying at a position, of each position skipped beyond two
SLOWED = 2  # times that a position is shown to a video that plays or performs more slowly


@dataclass(frozen=True)
class Keypoints2D:
    """One video's keypoints of the joints that its poses have.

    Attributes:
        xy_px: (T, J, 2) pixels, y down, any number where unknown.
        weight: (T, J), 0 where unknown.
    """

    xy_px: Float[np.ndarray, "T J 2"]
    weight: Float[np.ndarray, "T J"]


def registration_residual(
    motion: Float[np.ndarray, "N J 3"],
    keypoints: Keypoints2D,
    directions: Float[np.ndarray, "D 2 3"],
) -> float:
    """Mean residual a frame under the best direction and warp, 0 (explained) to 1."""
    if not len(motion) or not keypoints.weight.any():
        return 1.0
    residual = pose_residuals(motion, keypoints, directions)
    best = residual[int(warp_costs(residual).argmin())]
    return best_warp(best)[0] / len(keypoints.weight)


def reflected_keypoints(keypoints: Keypoints2D, twins: Sequence[int]) -> Keypoints2D:
    """The keypoints of the picture seen in a mirror; twins: each joint's left-right counterpart."""
    columns = list(twins)
    xy_px = (keypoints.xy_px * np.array([-1.0, 1.0]))[:, columns]
    return Keypoints2D(xy_px, keypoints.weight[:, columns])


def camera_directions(
    count: int = DIRECTIONS, steepest: float = STEEPEST
) -> Float[np.ndarray, "D 2 3"]:
    """Image axes (right, down) of level cameras on a Fibonacci sphere about the performer."""
    index = np.arange(count) + 0.5
    height = 1.0 - 2.0 * index / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - height**2)
    forward = np.stack([radius * np.cos(angle), height, radius * np.sin(angle)], axis=1)
    forward = forward[np.abs(forward[:, 1]) < steepest]
    right = np.cross(np.array([0.0, 1.0, 0.0]), forward)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(forward, right)], axis=1)


def unbiased_directions() -> Float[np.ndarray, "_D 2 3"]:
    """Directions within 30 degrees of the motion's horizon, a set that is its own mirror image."""
    axes = camera_directions(UNBIASED_DIRECTIONS, STEEPEST_UNBIASED)
    return np.concatenate([axes, axes * REFLECTED_AXES])


def residual_share(
    product: Float[np.ndarray, "*frames"],
    spread: Float[np.ndarray, "*frames"],
    size: Float[np.ndarray, "..."],
) -> Float[np.ndarray, "*frames"]:
    """What the best positive scale of a projected pose p leaves of keypoints x, 0 to 1.

    Args:
        product: Re<x, p>; spread: <p, p>; size: <x, x>, both about their weighted means.
    """
    explained = np.maximum(product, 0.0) ** 2 / np.maximum(spread * size, 1e-12)
    return np.asarray(np.sqrt(np.clip(1.0 - explained, 0.0, 1.0)))


def centred_plane(keypoints: Keypoints2D) -> Complex[np.ndarray, "T J"]:
    """x + i y about the weighted mean of each frame, 0 where unknown."""
    points = np.where(keypoints.weight[..., None] > 0, keypoints.xy_px, 0.0)
    plane = points[..., 0] + 1j * points[..., 1]
    total = np.maximum(keypoints.weight.sum(1, keepdims=True), 1e-12)
    mean = (keypoints.weight * plane).sum(1, keepdims=True) / total
    return np.where(keypoints.weight > 0, plane - mean, 0.0)


def pose_residuals(
    motion: Float[np.ndarray, "N J 3"],
    keypoints: Keypoints2D,
    directions: Float[np.ndarray, "D 2 3"],
) -> Float[np.ndarray, "D T N"]:
    """What the best scale and place of each projected pose leave of each frame's keypoints.

    With keypoints x and a pose p, both about their weighted means, the best scale is
    Re<x, p> / <p, p>, and 1 - Re<x, p>^2 / (<x, x> <p, p>) of the squared spread is left.
    """
    plane, weight = centred_plane(keypoints), keypoints.weight
    flat = directions.reshape(-1, 3) @ np.nan_to_num(motion).reshape(-1, 3).T
    projected = flat.reshape(len(directions), 2, *motion.shape[:2])
    right, down = projected[:, 0].swapaxes(1, 2), projected[:, 1].swapaxes(1, 2)
    weighted = weight * plane
    product = weighted.real @ right + weighted.imag @ down
    total = np.maximum(weight.sum(1)[:, None], 1e-12)
    squared_mean = ((weight @ right) ** 2 + (weight @ down) ** 2) / total
    spread = weight @ (right**2 + down**2) - squared_mean
    size = (weight * np.abs(plane) ** 2).sum(1)[:, None]
    return residual_share(product, spread, size)


Residuals = Callable[[Float[np.ndarray, "D 2 3"]], Float[np.ndarray, "D T"]]


def matched_residuals(poses: Float[np.ndarray, "T J 3"], keypoints: Keypoints2D) -> Residuals:
    """A function of directions: `pose_residuals` of each frame's keypoints and its own pose."""
    share = keypoints.weight / np.maximum(keypoints.weight.sum(1, keepdims=True), 1e-12)
    given = np.where(keypoints.weight[..., None] > 0, keypoints.xy_px, 0.0)
    x, p = (q - share[:, None] @ q for q in (given, poses))
    weighted = share[..., None] * p
    cross, moment = ((weighted.mT @ q).reshape(len(p), -1).T.copy() for q in (x, p))
    size = (share[..., None] * x**2).sum((1, 2))

    def residuals(axes: Float[np.ndarray, "D 2 3"]) -> Float[np.ndarray, "D T"]:
        product = axes.mT.reshape(-1, 6) @ cross
        spread = (axes.mT @ axes).reshape(-1, 9) @ moment
        return residual_share(product, spread, size)

    return residuals


def warp_costs(residual: Float[np.ndarray, "D T N"]) -> Float[np.ndarray, " D"]:
    """Cost of the best monotone warp with open ends, for every direction at once."""
    steps = _step_costs(residual)
    return np.array([_warp(of_direction, steps)[-1].min() for of_direction in residual])


def _step_costs(residual: Float[np.ndarray, "*batch T N"]) -> Float[np.ndarray, " S"]:
    """Costs of the steps of a warp among so many positions, from holding on."""
    steps = np.arange(min(MAX_STEP, residual.shape[-1] - 1) + 1)
    return np.where(steps == 0, HOLD_COST, SKIP_COST * np.maximum(steps - 2, 0))


@compiled
def _warp(residual, steps):  # type: ignore[no-untyped-def]
    """Costs (T, N) of the best warps of the first frames that end at each position."""
    total, best = residual.copy(), np.empty(residual.shape[1])
    for t in range(1, len(total)):
        last = total[t - 1]
        best[:] = last + steps[0]
        for step in range(1, len(steps)):
            for k in range(step, len(best)):
                cost = last[k - step] + steps[step]
                best[k] = cost if cost < best[k] else best[k]
        total[t] += best
    return total


def best_warp(residual: Float[np.ndarray, "T N"]) -> tuple[float, Int[np.ndarray, " T"]]:
    """Cost and positions of the best warp of one direction, at the motion's speed or at half of it.

    From 0.4 to 2.5 times the speed a warp then costs at most 0.02 a frame.
    """
    slowed = np.repeat(residual, SLOWED, axis=1)
    costs = [float(warp_costs(x[None])[0]) for x in (residual, slowed)]
    if costs[0] <= costs[1]:
        return costs[0], warp_path(residual)
    return costs[1], warp_path(slowed) // SLOWED


def warp_path(residual: Float[np.ndarray, "T N"]) -> Int[np.ndarray, " T"]:
    """The position of each frame on the best warp of one direction, as costed by `warp_costs`."""
    steps = _step_costs(residual)
    total = _warp(residual, steps)
    path = [int(total[-1].argmin())]
    for last in total[-2::-1]:
        before = last[max(0, path[-1] + 1 - len(steps)) : path[-1] + 1][::-1]
        path.append(path[-1] - int((before + steps[: len(before)]).argmin()))
    return np.array(path[::-1])
