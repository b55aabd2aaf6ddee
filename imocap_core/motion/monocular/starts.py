"""Starting points of monocular fits: from 2D alone with a library of poses, or from an estimate.

A library of posed skeletons seen from all sides, as starts of monocular fits. Poses are drawn from
the pose prior; directions cover the sphere; the rotation in the image plane, the scale and the
shift are solved in closed form when a detection is matched.

From 2D keypoints to 3D starts: match each frame against the library, then the best path. Matching
alone is ambiguous in depth. Each frame has many candidates; dynamic programming picks the sequence
that agrees with the image and moves least in 3D. A penalty near earlier paths gives further,
different starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from imocap_core.motion.observations import Observation, without_jumps
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.state import Body
from imocap_core.params import InitialSmplParams
from imocap_core.robust import geman_mcclure
from imocap_core.rotations import exp, log
from imocap_core.rotations import project as nearest_rotation
from imocap_core.sync.procrustes import procrustes_distances


@dataclass(frozen=True)
class Library:
    """S poses seen from V directions.

    Attributes:
        R_local: (S, 24, 3, 3) with the identity as global rotation.
        R_view: (V, 3, 3) camera from body, before the in-plane rotation.
        tilt_rad: (V,) angle by which the body's up direction leans to or from the camera.
        templates: (S * V, K) complex, keypoints x + i y in camera axes (y down), metres, relative
            to the root; row s * V + v.
        joints: (S, 24, 3) metres, body axes, relative to the root.
        pose_cost: (S,) twice the negative log likelihood under the prior.
    """

    R_local: Float[Tensor, "S 24 3 3"]
    R_view: Float[Tensor, "V 3 3"]
    tilt_rad: Float[Tensor, " V"]
    templates: Complex[Tensor, "SV K"]
    joints: Float[Tensor, "S 24 3"]
    pose_cost: Float[Tensor, " S"]

    @cached_property
    def narrow(self) -> tuple[Complex[Tensor, "SV K"], Float[Tensor, "SV K"]]:
        """The templates in single precision, and their squared magnitudes."""
        narrow = self.templates.to(torch.complex64)
        return narrow, _square(narrow)


def make_library(
    body: Body, prior: PosePrior, rng: np.random.Generator, *, poses: int, directions: int
) -> Library:
    """Draw ``poses`` from the prior and view them from ``directions`` sides."""
    template = prior.mean
    theta = torch.as_tensor(prior.sample(poses, rng)).to(template)
    local = torch.cat([theta.new_zeros(poses, 1, 3), theta.reshape(poses, -1, 3)], 1)
    R_local = exp(local)
    shaped = body.model.shape(template.new_zeros(1, 10))
    posed = shaped.pose(R_local, template.new_zeros(poses, 3))
    root = posed.joints[:, :1]
    keypoints = posed.keypoints(body.keypoints) - root
    R_view, tilt = _view_rotations(directions, template)
    xy = torch.einsum("vij,skj->svki", R_view[:, :2], keypoints)
    templates = torch.complex(xy[..., 0], xy[..., 1]).flatten(0, 1)
    cost, _ = prior.best(theta)
    return Library(R_local, R_view, tilt, templates, posed.joints - root, cost)


def _view_rotations(count: int, template: Tensor) -> tuple[Tensor, Tensor]:
    """Fibonacci directions on the sphere: (V, 3, 3) camera from body, and tilts (V,).

    The body's axes are y up and z ahead, the camera's y down and z away: a body upright and
    facing the camera has the rotation diag(1, -1, -1).
    """
    index = torch.arange(count, dtype=template.dtype, device=template.device) + 0.5
    tilt = torch.asin(1 - 2 * index / count)
    yaw = torch.pi * (1 + 5**0.5) * index
    zero = torch.zeros_like(tilt)
    turn = exp(torch.stack([zero, yaw, zero], -1))
    lean = exp(torch.stack([torch.pi + tilt, zero, zero], -1))
    return lean @ turn, tilt


CHUNK, FRAMES = 16384, 32  # templates, and frames, matched at once: 0.1 GB
KEYPOINT_SIGMAS, STEP_SIGMAS = 3.0, 3.0  # Geman-McClure scales of the match and of the path


@dataclass(frozen=True)
class Candidates:
    """The best C library entries of each frame.

    Attributes:
        R_local: (T, C, 24, 3, 3) with the global rotation in camera axes.
        joints: (T, C, 24, 3) metres relative to the root, camera axes.
        scale_px_m: (T, C) pixels a metre; cost: (T, C) unary cost.
    """

    R_local: Float[Tensor, "T C 24 3 3"]
    joints: Float[Tensor, "T C 24 3"]
    scale_px_m: Float[Tensor, "T C"]
    cost: Float[Tensor, "T C"]


def match(
    library: Library,
    xy_px: Float[Tensor, "T K 2"],
    weight: Float[Tensor, "T K"],
    *,
    count: int,
    sigma: float,
) -> Candidates:
    """The ``count`` most likely entries of each frame under weak perspective.

    Args:
        xy_px: finite; weight: confidence, 0 where missing.
        sigma: keypoint misfit in units of the person's image size (RMS spread of keypoints):
            detector noise, bone lengths and the library's coarseness together.
    """
    blocks = zip(xy_px.split(FRAMES), weight.split(FRAMES), strict=True)
    matched = [_match(library, *block, count=count, sigma=sigma) for block in blocks]
    return Candidates(
        *(torch.cat([getattr(x, f.name) for x in matched]) for f in fields(Candidates))
    )


def _match(
    library: Library, xy_px: Tensor, weight: Tensor, *, count: int, sigma: float
) -> Candidates:
    w = torch.complex(xy_px[..., 0], xy_px[..., 1])
    total = weight.sum(1).clamp_min(1e-9)
    centre = (weight * w).sum(1) / total
    w = (w - centre[:, None]) * (weight > 0)
    spread = ((weight * w.abs().square()).sum(1) / total).clamp_min(1e-9)
    first = _best_least_squares(library, w, weight / total[:, None], spread, 8 * count)
    return _rescore(library, first, w, weight, spread, count=count, sigma=sigma)


def _best_least_squares(
    library: Library, w: Tensor, share: Tensor, spread: Tensor, keep: int
) -> Tensor:
    """(T, keep) template indices with the smallest share of unexplained spread.

    For centred observations w and template p, the residual after the best similarity is
    ``1 - |sum c w conj(p)|^2 / (spread_w spread_p)``: three matrix products over all templates.
    """
    best_value = w.real.new_full((len(w), 0), 0.0)
    best_index = torch.zeros((len(w), 0), dtype=torch.long, device=w.device)
    narrow_w, narrow_c = w.to(torch.complex64), share.to(torch.float32)
    weighted = narrow_c * narrow_w
    for start in range(0, len(library.templates), CHUNK):
        p, squared = (x[start : start + CHUNK] for x in library.narrow)
        mean = narrow_c.to(torch.complex64) @ p.T
        spread_p = narrow_c @ squared.T - _square(mean)
        cross = weighted @ p.conj().T
        value = 1 - _square(cross) / (spread_p.clamp_min(1e-9) * spread[:, None].float())
        index = torch.arange(start, start + len(p), device=w.device).expand(len(w), -1)
        values = torch.cat([best_value.float(), value], 1)
        indices = torch.cat([best_index, index], 1)
        top = values.topk(min(keep, values.shape[1]), dim=1, largest=False)
        best_value, best_index = top.values, indices.gather(1, top.indices)
    return best_index


def _square(z: Tensor) -> Tensor:
    """Squared magnitude of complex numbers, without the square root of ``abs``."""
    return z.real.square().addcmul_(z.imag, z.imag)


def _rescore(
    library: Library,
    index: Tensor,
    w: Tensor,
    weight: Tensor,
    spread: Tensor,
    *,
    count: int,
    sigma: float,
) -> Candidates:
    """Robust similarity (outliers fade), plus priors of pose and of an upright body."""
    p = library.templates[index]
    c = weight[:, None].expand(p.shape[:2] + weight.shape[1:]).clone()
    unit2 = (sigma**2 * spread)[:, None, None]
    for _ in range(4):
        share = c / c.sum(-1, keepdim=True).clamp_min(1e-9)
        mean_p = (share * p).sum(-1, keepdim=True)
        mean_w = (share * w[:, None]).sum(-1, keepdim=True)
        q, v = p - mean_p, w[:, None] - mean_w
        factor = (share * v * q.conj()).sum(-1) / (share * _square(q)).sum(-1).clamp_min(1e-9)
        squared = _square(v - factor[..., None] * q) / unit2
        loss, robust = geman_mcclure(squared, KEYPOINT_SIGMAS)
        c = weight[:, None] * robust
    fit = (weight[:, None] * loss).sum(-1)
    directions = len(library.R_view)
    pose, view = index // directions, index % directions
    roll = factor.angle()
    lean = torch.acos((torch.cos(library.tilt_rad)[view] * torch.cos(roll)).clamp(-1, 1))
    cost = fit + 0.1 * library.pose_cost[pose] + (lean / 0.8).square()
    best = cost.topk(min(count, cost.shape[1]), dim=1, largest=False)
    pose, view, roll, factor = (x.gather(1, best.indices) for x in (pose, view, roll, factor))
    zero = torch.zeros_like(roll)
    R_root = exp(torch.stack([zero, zero, roll], -1)) @ library.R_view[view]
    R_local = library.R_local[pose].clone()
    R_local[:, :, 0] = R_root
    joints = torch.einsum("tcij,tckj->tcki", R_root, library.joints[pose])
    return Candidates(R_local, joints, factor.abs(), best.values)


def best_path(
    candidates: Candidates, *, step_m: float, avoid: Sequence[Float[Tensor, "T 24 3"]] = ()
) -> tuple[Int[Tensor, " T"], float]:
    """The candidate of each frame on the cheapest path, and the path's cost.

    Args:
        step_m: joint movement from one frame to the next that costs 1 per joint (9 at most, so that
            single outliers do not bend the path).
        avoid: joints of earlier paths; entries near them cost more.
    """
    unary = candidates.cost.clone()
    for path in avoid:
        away = (candidates.joints - path[:, None]).square().sum(-1).mean(-1)
        unary = unary + 40.0 * torch.exp(-away / (2 * 0.15**2))
    frames = len(unary)
    total, back = unary[0], []
    for t in range(1, frames):
        flat = candidates.joints[t - 1].flatten(1), candidates.joints[t].flatten(1)
        squared = torch.cdist(*flat).square() / step_m**2
        per_joint = squared / candidates.joints.shape[2]
        move = 24 * geman_mcclure(per_joint, STEP_SIGMAS)[0]
        best = (total[:, None] + move).min(0)
        total = best.values + unary[t]
        back.append(best.indices)
    chosen = [int(total.argmin())]
    for pointer in reversed(back):
        chosen.append(int(pointer[chosen[-1]]))
    return torch.tensor(chosen[::-1], device=unary.device), float(total.min())


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


_MATCH_SIGMA = 0.12  # of a keypoint's distance to the matched pose, share of the keypoints' spread
_STEP_M_S = 2.0  # joint speed that costs 1 where a path of poses is chosen


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
    candidates = match(library, xy, weight, count=options.candidates, sigma=_MATCH_SIGMA)
    step_m = _STEP_M_S * stride / observation.fps
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
