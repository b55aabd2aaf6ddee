"""The objective of hands: each function returns a term's cost and adds its normal equations."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.hands.kinematics import hand_points
from imocap_core.hands.skeleton import ANGLE_NAMES, HandSkeleton
from imocap_core.hands.state import CommonHand, HandState, HandViews
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.params import HandsParams
from imocap_core.robust import cauchy, geman_mcclure
from imocap_core.rotations import log, right_jacobian

ROTATIONS = 24  # unknowns of a frame: 3 of the wrist, 21 angles; then 3 a view of its offset
NEAREST_M = 0.1  # least depth of a projected point
_END_SHARE, _END_SPREAD_RAD = 0.65, 0.25  # the last joint of a finger follows the one before
_GROUPS = [[0, 1, 2], *([3 + 4 * f + k for k in range(4)] for f in range(4)), [*range(19, 24)]]

Equations = NormalEquations | None


def project_hands(
    views: HandViews, state: HandState
) -> tuple[Float[Tensor, "B T V 21 2"], Float[Tensor, "B T V 21 2 28"]]:
    """Pixels of the hands and their derivatives: by the rotations (24), the offset of the same view
    (3), and the logarithm of the size (1)."""
    bones, axes = views.bones[:, None] * state.size, views.axes[:, None]
    xyz, d_wrist, d_angles = hand_points(bones, axes, state.R_wrist, state.angles)
    R = views.R_forearm[..., None, :, :]  # (B, T, V, 1, 3, 3)
    place = (views.wrist_m + state.offset_m)[..., None, :]
    in_camera = (R @ xyz[:, :, None, :, :, None])[..., 0] + place
    h = (views.K[:, None, :, None] @ in_camera[..., None])[..., 0]
    depth = h[..., 2:].clamp_min(NEAREST_M)
    pixels = h[..., :2] / depth
    K = views.K[:, None, :, None]
    by_place = (K[..., :2, :] - pixels[..., None] * K[..., 2:, :]) / depth[..., None]
    turned = by_place @ R
    by_turns = turned @ torch.cat([d_wrist, d_angles], dim=-1)[:, :, None]
    by_size = turned @ xyz[:, :, None, :, :, None]
    return pixels, torch.cat([by_turns, by_place, by_size], dim=-1)


def image_cost(
    views: HandViews, state: HandState, weights: HandsParams, normal: Equations = None
) -> Float[Tensor, " B"]:
    """Robust distance of the projected hands to the detected keypoints."""
    pixels, jacobian = project_hands(views, state)
    miss = torch.where(views.weight[..., None] > 0, pixels - views.xy_px, 0.0)
    squared = views.weight * (miss**2).sum(-1)
    cost, share = geman_mcclure(squared, weights.robust_scale_sigma)
    if normal is not None:
        w = (views.weight * share)[..., None].expand_as(miss)
        rows, rest, w = (x.flatten(3, 4) for x in (jacobian, miss, w))  # (B, T, V, 42, ...)
        lever = rows * w[..., None]
        square = lever.transpose(-1, -2) @ rows
        slope = (lever * rest[..., None]).sum(-2)
        turn, offset, size = slice(0, ROTATIONS), slice(ROTATIONS, -1), slice(-1, None)
        normal.diagonal[..., turn, turn] += square[..., turn, turn].sum(2)
        normal.gradient[..., turn] += slope[..., turn].sum(2)
        normal.border[..., turn, :] += square[..., turn, size].sum(2)
        normal.corner += square[..., size, size].sum((1, 2))
        normal.corner_gradient += slope[..., size].sum((1, 2))
        for v in range(square.shape[2]):
            of_view = slice(ROTATIONS + 3 * v, ROTATIONS + 3 * v + 3)
            normal.diagonal[..., of_view, of_view] += square[:, :, v, offset, offset]
            normal.diagonal[..., turn, of_view] += square[:, :, v, turn, offset]
            normal.diagonal[..., of_view, turn] += square[:, :, v, offset, turn]
            normal.gradient[..., of_view] += slope[:, :, v, offset]
            normal.border[..., of_view, :] += square[:, :, v, offset, size]
    return cost.sum((1, 2, 3))


def prior_cost(
    views: HandViews,
    state: HandState,
    skeleton: HandSkeleton,
    weights: HandsParams,
    normal: Equations = None,
) -> Float[Tensor, " B"]:
    """Priors of poses, ranges of motion, and the wrist's rotation and offset from the body's."""
    vectors = log(views.R_body.transpose(-1, -2) @ state.R_wrist)
    wrist = vectors / weights.wrist_rad
    turn = torch.linalg.inv(right_jacobian(vectors)) / weights.wrist_rad
    offset = state.offset_m.flatten(2) / weights.offset_m
    pose = _pose_rows(state.angles, skeleton.spread) * weights.pose_prior
    rest = state.angles @ pose.T
    over = torch.relu(state.angles - skeleton.upper) - torch.relu(skeleton.lower - state.angles)
    over = over / weights.limit_rad
    used = views.valid.to(state.angles)
    if normal is not None:
        u = used[..., None]
        normal.diagonal[..., :3, :3] += u[..., None] * (turn.transpose(-1, -2) @ turn)
        normal.gradient[..., :3] += u * (turn.transpose(-1, -2) @ wrist[..., None])[..., 0]
        hit = (over != 0).to(u) / weights.limit_rad
        normal.diagonal[..., 3:24, 3:24] += u[..., None] * (
            pose.T @ pose + torch.diag_embed(hit**2)
        )
        normal.gradient[..., 3:24] += u * (rest @ pose + hit * over)
        torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)[..., 24:] += u / weights.offset_m**2
        normal.gradient[..., 24:] += u * offset / weights.offset_m
    total = sum((x**2).sum(-1) for x in (wrist, offset, rest, over))
    return (used * total).sum(1)


def _pose_rows(angles: Tensor, spread: Tensor) -> Tensor:
    """(25, 21): each angle by its spread, and the end joints against those before them."""
    rows = [*torch.diag(1 / spread)]
    for f in range(4):
        row = torch.zeros_like(spread)
        bend2, bend3 = (ANGLE_NAMES.index(n) for n in ANGLE_NAMES[4 * f + 2 : 4 * f + 4])
        row[bend3], row[bend2] = 1 / _END_SPREAD_RAD, -_END_SHARE / _END_SPREAD_RAD
        rows.append(row)
    return torch.stack(rows)


def smooth_cost(
    views: HandViews,
    state: HandState,
    weights: HandsParams,
    fps: Float[Tensor, " B"],
    normal: Equations = None,
) -> Float[Tensor, " B"]:
    """Accelerations of wrist, fingers and offset."""
    if state.angles.shape[1] < 3:
        return state.angles.new_zeros(len(state.angles))
    turn = log(state.R_wrist[:, :-1].transpose(-1, -2) @ state.R_wrist[:, 1:])
    steps = torch.cat([turn, state.angles.diff(dim=1), state.offset_m.flatten(2).diff(dim=1)], -1)
    scale = torch.full_like(steps[0, 0], 1 / weights.acceleration_rad_s2)
    scale[ROTATIONS:] = 1 / weights.offset_acceleration_m_s2
    w = (fps[:, None, None] ** 2 * scale) ** 2 * views.valid[:, 2:, None]
    change = steps.diff(dim=1)
    if normal is not None:  # rows 1, -2, 1 over three frames: small turns add up
        frames, pull = change.shape[1], w * change
        for lag, share in enumerate((1.0, -2.0, 1.0)):
            span = slice(lag, lag + frames)
            torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)[:, span] += share**2 * w
            normal.gradient[:, span] += share * pull
        torch.diagonal(normal.next1, dim1=-2, dim2=-1)[:, :frames] += -2 * w
        torch.diagonal(normal.next1, dim1=-2, dim2=-1)[:, 1 : frames + 1] += -2 * w
        torch.diagonal(normal.next2, dim1=-2, dim2=-1)[:, :frames] += w
    return (w * change**2).sum((1, 2))


def coupling_cost(
    views: HandViews,
    state: HandState,
    common: CommonHand,
    weights: HandsParams,
    normal: Equations = None,
) -> Float[Tensor, " B"]:
    """Differences from the common motion, robustly for the wrist and for each finger."""
    vectors = log(common.R_wrist.transpose(-1, -2) @ state.R_wrist)
    away = torch.cat([vectors, state.angles - common.angles], -1) / weights.coupling_rad
    trust = common.trust * views.valid
    scale = weights.agreement_rad / weights.coupling_rad
    total = torch.zeros_like(trust)
    inverse = torch.linalg.inv(right_jacobian(vectors))
    for group in _GROUPS:
        part = away[..., group]
        cost, share = cauchy((part**2).sum(-1), scale)
        total = total + trust * cost
        if normal is None:
            continue
        w = (trust * share)[..., None]
        if group[0] == 0:
            rows = inverse / weights.coupling_rad
            normal.diagonal[..., :3, :3] += w[..., None] * (rows.transpose(-1, -2) @ rows)
            normal.gradient[..., :3] += w * (rows.transpose(-1, -2) @ part[..., None])[..., 0]
        else:
            span = slice(group[0], group[-1] + 1)
            diagonal = torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)
            diagonal[..., span] += w / weights.coupling_rad**2
            normal.gradient[..., span] += w * part / weights.coupling_rad
    return total.sum(1)
