"""Starting points of monocular fits: from 2D alone with the library, or from an estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.library import Library
from imocap_core.motion.monocular.lifting import best_path, match
from imocap_core.motion.observations import Observation, without_jumps
from imocap_core.params import InitialSmplParams
from imocap_core.rotations import exp, log
from imocap_core.rotations import project as nearest_rotation
from imocap_core.sync.pairwise.procrustes import procrustes_distances


@dataclass(frozen=True)
class Start:
    """A start of one video, in camera axes.

    Attributes:
        R_local: (T, 24, 3, 3); trans: (T, 3) metres; cost: of the match, lower is better.
    """

    R_local: Float[Tensor, "T 24 3 3"]
    trans: Float[Tensor, "T 3"]
    cost: float


MIN_JOINTS = 6  # fewer do not determine a pose


def lifted_starts(
    body: Body, library: Library, observation: Observation, options: InitialSmplParams
) -> list[Start]:
    """Several different starts of one video from its 2D keypoints alone, best first."""
    template = library.R_view
    frames = len(observation.xy_px)
    stride = max(1, round(options.stride_s * observation.fps))
    confidence = without_jumps(observation)
    keys = _key_frames(confidence, stride)
    xy = torch.as_tensor(np.nan_to_num(observation.xy_px[keys])).to(template)
    weight = torch.as_tensor(confidence[keys]).to(template)
    candidates = match(library, xy, weight, count=options.candidates, sigma=options.match_sigma)
    step_m = options.step_m_s * stride / observation.fps
    starts: list[Start] = []
    followed: list[Tensor] = []
    rows = torch.arange(len(keys), device=template.device)
    for _ in range(options.starts):
        path, _ = best_path(candidates, step_m=step_m, avoid=followed)
        followed.append(candidates.joints[rows, path])
        R_local = interpolate_rotations(candidates.R_local[rows, path], keys, frames)
        scale = _interpolate(candidates.scale_px_m[rows, path].log()[:, None], keys, frames).exp()
        depth = float(observation.K[0, 0]) / scale[:, 0]
        trans = place(body, R_local, observation, confidence, depth)
        starts.append(Start(R_local, trans, float(candidates.cost[rows, path].sum())))
    return starts


def start_at_joints(
    body: Body, R_local: Float[Tensor, "T 24 3 3"], observation: Observation
) -> Start:
    """A start from given rotations: depth from the apparent size of the body (weak perspective).

    Raises:
        ValueError: no frame has enough keypoints.
    """
    confidence = without_jumps(observation)
    posed = body.model.shape(R_local.new_zeros(1, 10)).pose(
        R_local, R_local.new_zeros(len(R_local), 3)
    )
    points = posed.keypoints(body.keypoints)[..., :2]
    xy = torch.as_tensor(np.nan_to_num(observation.xy_px)).to(R_local)
    weight = torch.as_tensor(confidence).to(R_local)
    share = (weight / weight.sum(1, keepdim=True).clamp_min(1e-9))[..., None]
    p, w = points - (share * points).sum(1, keepdim=True), xy - (share * xy).sum(1, keepdim=True)
    scale = (share * p * w).sum((1, 2)) / (share * p.square()).sum((1, 2)).clamp_min(1e-9)
    visible = ((weight > 0).sum(1) >= 4) & (scale > 0)
    keys = visible.nonzero()[:, 0].cpu().numpy()
    if len(keys) == 0:
        raise ValueError("no frame shows enough keypoints to place the body")
    scale = _interpolate(scale[keys].log()[:, None], keys, len(scale)).exp()[:, 0]
    depth = float(observation.K[0, 0]) / scale
    return Start(R_local, place(body, R_local, observation, confidence, depth), 0.0)


def place(
    body: Body,
    R_local: Float[Tensor, "T 24 3 3"],
    observation: Observation,
    confidence: Float[np.ndarray, "T K"],
    depth: Float[Tensor, " T"],
) -> Float[Tensor, "T 3"]:
    """Translations that project the body onto its keypoints, at the given depth.

    The rays of the confident keypoints, at the body's depth, minus the keypoints' positions
    relative to the root.
    """
    points = body.model.shape(depth.new_zeros(1, 10)).pose(R_local, depth.new_zeros(len(depth), 3))
    xyz = points.keypoints(body.keypoints)
    root = points.joints[:, 0]
    K = torch.as_tensor(observation.K).to(depth)
    xy = torch.as_tensor(np.nan_to_num(observation.xy_px)).to(depth)
    weight = torch.as_tensor(confidence).to(depth)
    total = weight.sum(1)
    rays = (xy - K[:2, 2]) / torch.stack([K[0, 0], K[1, 1]])
    z = (depth[:, None] + xyz[..., 2] - root[:, None, 2]).clamp_min(0.1)
    offset = rays * z[..., None] - xyz[..., :2]
    plane = (weight[..., None] * offset).sum(1) / total.clamp_min(1e-9)[:, None]
    keys = (total > 0).nonzero()[:, 0].cpu().numpy()
    if len(keys) == 0:
        plane, keys = torch.zeros_like(plane), np.arange(len(plane))
    plane = _interpolate(plane[keys], keys, len(depth))
    place_of_body = torch.cat([plane, (depth - root[:, 2])[:, None]], -1)
    centre = observation.centre_m
    return place_of_body if centre is None else place_of_body + torch.as_tensor(centre).to(depth)


def fit_rotations_to_joints(
    body: Body, library: Library, joints: Float[np.ndarray, "T 24 3"]
) -> Float[Tensor, "T 24 3 3"]:
    """Nearest library pose, rotated rigidly, for each frame of an estimator's joints.

    Args:
        joints: metres, camera axes, NaN where missing.

    Returns:
        Starts for a fit that has the joints as evidence; frames with fewer than `MIN_JOINTS` joints
        are interpolated.

    Raises:
        ValueError: no frame has that many.
    """
    finite = np.isfinite(joints).all(-1)
    keys = np.nonzero(finite.sum(1) >= MIN_JOINTS)[0]
    if len(keys) == 0:
        raise ValueError(f"no frame has {MIN_JOINTS} joints or more")
    poses = library.joints.cpu().numpy()
    weights = finite[keys].astype(float)
    every = np.ones(poses.shape[:2])
    nearest = procrustes_distances(joints[keys], poses, weights, every).argmin(1)
    template = library.R_view
    target, weight = (
        torch.as_tensor(x).to(template) for x in (np.nan_to_num(joints[keys]), weights)
    )
    index = torch.as_tensor(nearest, device=template.device)
    R_local = library.R_local[index].clone()
    R_local[:, 0] = nearest_rotation(_correlation(target, library.joints[index], weight))
    return interpolate_rotations(R_local, keys, len(joints))


def _correlation(target: Tensor, pose: Tensor, weight: Tensor) -> Tensor:
    """(T, 3, 3) of joints (T, J, 3) about their weighted means, weight (T, J)."""
    share = (weight / weight.sum(1, keepdim=True))[..., None]
    a, b = (x - (share * x).sum(1, keepdim=True) for x in (target, pose))
    return torch.einsum("tk,tki,tkj->tij", weight, a, b)


def start_at_motion(R_local: Float[Tensor, "T 24 3 3"], trans: Float[Tensor, "T 3"]) -> Start:
    """A start from an estimator's motion in camera axes, metres; frames with NaN are interpolated.

    Raises:
        ValueError: every frame has NaN.
    """
    finite = R_local.isfinite().flatten(1).all(1) & trans.isfinite().all(1)
    keys = finite.nonzero()[:, 0].cpu().numpy()
    if len(keys) == 0:
        raise ValueError("every frame has numbers that are not finite")
    frames = len(trans)
    return Start(
        interpolate_rotations(R_local[finite], keys, frames),
        _interpolate(trans[finite], keys, frames),
        0.0,
    )


def _key_frames(confidence: np.ndarray, stride: int) -> np.ndarray:
    """Every stride-th frame with enough keypoints; of all frames if none has."""
    enough = (confidence > 0).sum(1) >= max(4, confidence.shape[1] // 4)
    usable = np.nonzero(enough)[0]
    if len(usable) == 0:
        return np.arange(0, len(confidence), stride)
    keys = usable[::stride]
    return keys if keys[-1] == usable[-1] else np.append(keys, usable[-1])


def _interpolate(values: Tensor, keys: np.ndarray, frames: int) -> Tensor:
    """Linear in time from (len(keys), D) to (frames, D), constant beyond the ends."""
    low, high, share = _between(keys, frames, values)
    return values[low] * (1 - share[:, None]) + values[high] * share[:, None]


def interpolate_rotations(
    R: Float[Tensor, "n J 3 3"], keys: Sequence[int] | Int[np.ndarray, " n"], frames: int
) -> Float[Tensor, "T J 3 3"]:
    """Geodesic interpolation from key frames to all frames, constant beyond the ends."""
    low, high, share = _between(np.asarray(keys), frames, R)
    turn = log(R[low].transpose(-1, -2) @ R[high])
    return R[low] @ exp(turn * share[:, None, None])


def _between(keys: np.ndarray, frames: int, template: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    time = np.clip(np.arange(frames), keys[0], keys[-1])
    high = np.clip(np.searchsorted(keys, time), 1 if len(keys) > 1 else 0, len(keys) - 1)
    low = np.maximum(high - 1, 0)
    gap = np.maximum(keys[high] - keys[low], 1)
    share = np.clip((time - keys[low]) / gap, 0.0, 1.0)
    index = [torch.as_tensor(x, device=template.device) for x in (low, high)]
    return index[0], index[1], torch.as_tensor(share).to(template)
