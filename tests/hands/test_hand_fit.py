"""Made hands, filmed from two sides: what is recovered, what is said of hands unseen; the
linearisation of every term; the skeleton."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from imocap_core.body import load_free_body
from imocap_core.hands.hand_fit import FittedHands, cheapest_path, fit_hands
from imocap_core.hands.hand_objective import (
    ArmsAndHands,
    CommonHand,
    HandState,
    HandViews,
    HandWeights,
    coupling_cost,
    image_cost,
    point_weights,
    prior_cost,
    smooth_cost,
)
from imocap_core.hands.hand_skeleton import (
    ANGLE_NAMES,
    HandSkeleton,
    hand_points,
    hand_skeleton,
    joint_vectors,
)
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.normal import NormalEquations
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


MODEL = load_free_body(hands=True)
SHAPED = MODEL.shape(torch.linspace(-1, 1, 10, dtype=torch.float64))
HANDS: HandSkeleton = hand_skeleton(SHAPED)


def test_the_hand_is_that_of_the_body() -> None:
    rng = torch.Generator().manual_seed(0)
    angles = 0.5 * torch.randn(2, 21, generator=rng, dtype=torch.float64)
    R_wrist = exp(torch.randn(2, 3, generator=rng, dtype=torch.float64))
    R_local = torch.eye(3, dtype=torch.float64).repeat(52, 1, 1)
    R_local[20], R_local[21] = R_wrist
    R_local[22:] = exp(joint_vectors(HANDS.axes, angles)).reshape(30, 3, 3)
    posed = SHAPED.pose(R_local, torch.zeros(3, dtype=torch.float64))
    xyz, _, _ = hand_points(HANDS.bones, HANDS.axes, R_wrist, angles)
    for number, side in enumerate(("left", "right")):
        true = posed.keypoints(MODEL.points(f"{side}_hand21"))
        # a fingertip is skin: it hangs on the bones before it a little too
        assert (true - true[0] - xyz[number]).norm(dim=-1).max() < 0.004
        joints = [k for k in range(21) if k not in (4, 8, 12, 16, 20)]
        assert (true - true[0] - xyz[number])[joints].abs().max() < 1e-6


def test_derivatives_are_finite_differences() -> None:
    rng = torch.Generator().manual_seed(1)
    angles = 0.6 * torch.randn(2, 21, generator=rng, dtype=torch.float64)
    R_wrist = exp(torch.randn(2, 3, generator=rng, dtype=torch.float64))
    _, d_wrist, d_angles = hand_points(HANDS.bones, HANDS.axes, R_wrist, angles)
    step = 1e-6
    for k in range(21):
        moved = angles.clone()
        moved[:, k] += step
        there, _, _ = hand_points(HANDS.bones, HANDS.axes, R_wrist, moved)
        moved[:, k] -= 2 * step
        back, _, _ = hand_points(HANDS.bones, HANDS.axes, R_wrist, moved)
        assert torch.allclose((there - back) / (2 * step), d_angles[..., k], atol=1e-8)
    for k in range(3):
        turn = torch.zeros(3, dtype=torch.float64)
        turn[k] = step
        there, _, _ = hand_points(HANDS.bones, HANDS.axes, R_wrist @ exp(turn), angles)
        back, _, _ = hand_points(HANDS.bones, HANDS.axes, R_wrist @ exp(-turn), angles)
        assert torch.allclose((there - back) / (2 * step), d_wrist[..., k], atol=1e-8)


def test_positive_bends_bring_every_tip_to_the_palm_and_hands_are_mirror_twins() -> None:
    still = torch.eye(3, dtype=torch.float64).expand(2, 3, 3)
    bend = torch.tensor([0.7 * ("bend" in name) for name in ANGLE_NAMES], dtype=torch.float64)
    closed, _, _ = hand_points(HANDS.bones, HANDS.axes, still, bend.expand(2, 21))
    opened, _, _ = hand_points(HANDS.bones, HANDS.axes, still, torch.zeros(2, 21).double())
    palm = opened[:, [0, 5, 17]].mean(1, keepdim=True)
    tips = [4, 8, 12, 16, 20]
    nearer = (closed - palm)[:, tips].norm(dim=-1) < (opened - palm)[:, tips].norm(dim=-1)
    assert nearer.all()
    fingers = tips[1:]
    assert (closed[:, fingers, 1] < opened[:, fingers, 1]).all()  # palms face down at rest
    twin = closed[1] * torch.tensor([-1.0, 1.0, 1.0]).double()
    assert (twin - closed[0]).norm(dim=-1).max() < 0.005


WEIGHTS = replace(
    PARAMS, wrist_rad=0.7, offset_m=0.03, pose_prior=0.5, acceleration_rad_s2=30.0,
    offset_acceleration_m_s2=3.0,
)  # fmt: skip
B, T, V = 2, 4, 2
RATES = torch.tensor([15.0, 10.0]).double()


def random(*shape: int, seed: int, scale: float = 1.0) -> Tensor:
    made = torch.Generator().manual_seed(seed)
    return scale * torch.randn(*shape, generator=made, dtype=torch.float64)


VIEWS = HandViews(
    bones=SKELETON.bones,
    axes=SKELETON.axes,
    R_forearm=exp(random(B, T, V, 3, seed=0)),
    wrist_m=torch.tensor([0.1, 0.2, 3.0]).double().expand(B, T, V, 3),
    K=torch.tensor([[500.0, 0, 300], [0, 500, 200], [0, 0, 1]]).double().expand(B, V, 3, 3),
    xy_px=random(B, T, V, 21, 2, seed=1, scale=5.0) + torch.tensor([317.0, 233.0]).double(),
    weight=torch.rand(B, T, V, 21, generator=torch.Generator().manual_seed(2)).double(),
    R_body=exp(random(B, T, 3, seed=3, scale=0.1)),
    valid=torch.tensor([[True] * 4, [True, True, True, False]]),
)
STATE = HandState(
    exp(random(B, T, 3, seed=4, scale=0.02)),  # turns between frames are small, as in motion
    random(B, T, 21, seed=5, scale=0.6),
    random(B, T, V, 3, seed=6, scale=0.02),
    1.05,
)
COMMON = CommonHand(
    exp(random(B, T, 3, seed=7, scale=0.4)),
    random(B, T, 21, seed=8, scale=0.5),
    torch.rand(B, T).double(),
)
Cost = Callable[[HandState, NormalEquations | None], Tensor]
TERMS: dict[str, tuple[Cost, float]] = {
    "image": (lambda s, n: image_cost(VIEWS, s, WEIGHTS, n), 1e-6),
    "prior": (lambda s, n: prior_cost(VIEWS, s, SKELETON, WEIGHTS, n), 1e-6),
    "coupling": (lambda s, n: coupling_cost(VIEWS, s, COMMON, WEIGHTS, n), 1e-6),
    "smooth": (lambda s, n: smooth_cost(VIEWS, s, WEIGHTS, RATES, n), 0.1),  # turns add up nearly
}


@pytest.mark.parametrize("name", TERMS)
def test_gradients_are_half_of_those_of_the_cost(name: str) -> None:
    term, tolerance = TERMS[name]
    normal = NormalEquations.zeros(B, T, 24 + 3 * V, 1, STATE.angles)
    term(STATE, normal)
    step = 1e-6
    for seed in range(6):
        way = random(B, T, 24 + 3 * V, seed=20 + seed)
        there, back = (term(STATE.retract(sign * step * way), None) for sign in (1, -1))
        slope = (there - back) / (4 * step)
        told = (normal.gradient * way).sum((1, 2))
        assert torch.allclose(slope, told, rtol=tolerance, atol=tolerance * float(told.abs().max()))


def test_the_size_s_derivative_too() -> None:
    normal = NormalEquations.zeros(B, T, 24 + 3 * V, 1, STATE.angles)
    image_cost(VIEWS, STATE, WEIGHTS, normal)
    step = 1e-6
    there, back = (
        image_cost(VIEWS, replace(STATE, size=STATE.size * (1 + sign * step)), WEIGHTS)
        for sign in (1, -1)
    )
    assert torch.allclose((there - back) / (4 * step), normal.corner_gradient[:, 0], rtol=1e-5)


def test_the_cheapest_path_prefers_a_steady_wrist_to_a_slightly_cheaper_jump() -> None:
    R = exp(torch.tensor([[0.0, 0, 0], [3.0, 0, 0]]).double()).expand(3, 2, 3, 3)
    cost = torch.tensor([[0.0, 5.0], [1.0, 0.9], [0.0, 5.0]]).double()
    path = cheapest_path(cost, R, torch.tensor([0.1, 0.1]).numpy())
    assert path.tolist() == [0, 0, 0]
    dear = torch.tensor([[0.0, 500.0], [900.0, 0.0], [0.0, 500.0]]).double()
    assert cheapest_path(dear, R, torch.tensor([0.1, 0.1]).numpy()).tolist() == [0, 1, 0]
