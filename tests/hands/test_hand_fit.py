"""Made hands, filmed from two sides: what is recovered, and what is said of hands unseen."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from imocap_core.body import load_free_body
from imocap_core.hands.hand_fit import FittedHands, fit_hands
from imocap_core.hands.hand_objective import ArmsAndHands, HandWeights, point_weights
from imocap_core.hands.hand_skeleton import ANGLE_NAMES, hand_points, hand_skeleton
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.rotations import exp

SKELETON = hand_skeleton(load_free_body(hands=True).shape(torch.zeros(10, dtype=torch.float64)))
PARAMS = HandWeights(
    robust_scale_sigma=4.0, wrist_rad=0.8, offset_m=0.04, pose_prior=0.3, limit_rad=0.05,
    coupling_rad=0.15, agreement_rad=0.5, acceleration_rad_s2=40.0, offset_acceleration_m_s2=4.0,
    size_spread=0.15, stride_s=0.2, max_steps=15,
)  # fmt: skip
FRAMES, FPS, NOISE_PX = 30, 15.0, 1.0
K = torch.tensor([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]], dtype=torch.float64)


def vector(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def true_angles() -> Tensor:
    """(2, T, 21): from open to a fist, the left with its index finger left pointing."""
    way = 0.5 - 0.5 * torch.cos(torch.linspace(0, np.pi, FRAMES).double())
    closed = vector(*[1.1 if "bend" in n and "thumb" not in n else 0.25 for n in ANGLE_NAMES])
    closed[[k for k, n in enumerate(ANGLE_NAMES) if "spread" in n]] = 0.05
    pointing = closed.clone()
    pointing[:4] = 0.0
    return torch.stack([way[:, None] * pointing, way[:, None] * closed])


def made(
    size: float = 1.1, sides: tuple[float, ...] = (0.0, 1.5)
) -> tuple[list[ArmsAndHands], list[Tensor]]:
    """Videos from cameras turned about the vertical, and their true points (2, T, 21, 3)."""
    rng = np.random.default_rng(3)
    time = torch.linspace(0, 1, FRAMES).double()
    R_wrist = exp(torch.stack([2.2 * time, 0.3 * time, 0.4 - 0.8 * time], -1)).expand(2, -1, 3, 3)
    R_arm = exp(vector(0.2, 0.4, 1.0)).expand(2, FRAMES, 3, 3)
    xyz, _, _ = hand_points(
        SKELETON.bones[:, None] * size, SKELETON.axes[:, None], R_wrist, true_angles()
    )
    videos, truths = [], []
    for side in sides:
        R_arm_seen = exp(vector(0, side, 0)) @ R_arm
        place = vector(0.1, -0.2, 3.5).expand(2, FRAMES, 3)
        points = (R_arm_seen[:, :, None] @ xyz[..., None])[..., 0] + place[:, :, None]
        h = points @ K.T
        pixels = (h[..., :2] / h[..., 2:]).numpy()
        xy = pixels + rng.normal(0, NOISE_PX, pixels.shape)
        hand_px = np.full((2, FRAMES), 900 * 0.2 / 3.5)
        weight = point_weights(xy, np.ones(xy.shape[:3]), hand_px, HandWeights(noise_share=0.02))
        # the body has the wrist 3 cm elsewhere, and unturned
        body_place = place + 0.03 * torch.nn.functional.normalize(vector(1, -1, 1), dim=0)
        body = exp(vector(0.4, 0, 0)).expand(2, FRAMES, 3, 3)
        videos.append(ArmsAndHands(R_arm_seen, body_place, body, K, FPS, xy, weight))
        truths.append(points)
    return videos, truths


def error_mm(found: FittedHands, true: Tensor) -> float:
    """Mean over points, relative to the wrist."""
    points = found.points_m.transpose(0, 1)
    away = (points - points[:, :, :1]) - (true - true[:, :, :1])
    return float(1000 * away.norm(dim=-1).mean())


def fitted(videos: list[ArmsAndHands]) -> tuple[list[FittedHands], float]:
    frames = np.arange(FRAMES, dtype=float)
    timeline = make_timeline([frames] * len(videos), [np.ones(FRAMES)] * len(videos), FRAMES)
    return fit_hands(SKELETON, videos, timeline, 0, PARAMS)


@pytest.fixture(scope="module")
def two() -> tuple[list[FittedHands], float]:
    return fitted(made()[0])


def test_two_views_recover_fingers_wrist_and_size(two: tuple[list[FittedHands], float]) -> None:
    _, truths = made()
    found, size = two
    rest, _, _ = hand_points(
        SKELETON.bones[:, None],
        SKELETON.axes[:, None],
        made()[0][0].R_body,
        torch.zeros(2, FRAMES, 21).double(),
    )
    still = (made()[0][0].R_forearm[:, :, None] @ rest[..., None])[..., 0].transpose(0, 1)
    unfitted = error_mm(replace(found[0], points_m=still), truths[0])
    assert size == pytest.approx(1.1, abs=0.03)
    for hands, true in zip(found, truths, strict=True):
        error = error_mm(hands, true)
        assert error < 5.5
        assert error < unfitted / 8
        assert hands.visible.all()


@pytest.mark.long
def test_a_hand_unseen_in_one_video_is_told_by_the_other() -> None:
    videos, truths = made()
    weight = videos[1].weight.copy()
    weight[0, 8:22] = 0.0
    found, _ = fitted([videos[0], replace(videos[1], weight=weight)])
    assert found[1].visible[:, 1].all()
    assert found[1].visible[:, 0].sum() == FRAMES - 14
    assert error_mm(found[1], truths[1]) < 7.0


def test_a_hand_never_seen_keeps_the_body_s_wrist_and_the_rest_pose() -> None:
    videos, _ = made(sides=(0.0,))
    weight = videos[0].weight.copy()
    weight[1] = 0.0
    found, _ = fit_hands(SKELETON, [replace(videos[0], weight=weight)], None, 0, PARAMS)
    hands = found[0]
    assert not hands.visible[:, 1].any()
    assert hands.visible[:, 0].all()
    assert hands.finger_vectors[:, 1].abs().max() < 1e-3
    assert (hands.R_wrist[:, 1] - videos[0].R_body[1]).abs().max() < 1e-3


def test_videos_need_a_timeline() -> None:
    with pytest.raises(ValueError, match="timeline"):
        fit_hands(SKELETON, made()[0], None, 0, PARAMS)
