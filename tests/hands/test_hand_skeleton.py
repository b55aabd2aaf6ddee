"""Laws of the hand: it is SMPL+H's, its derivatives are right, positive angles close it."""

import torch

from imocap_core.body import load_free_body
from imocap_core.hands.hand_skeleton import (
    ANGLE_NAMES,
    HandSkeleton,
    hand_points,
    hand_skeleton,
    joint_vectors,
)
from imocap_core.rotations import exp

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
