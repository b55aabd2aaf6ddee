"""Contact constraints by inverse kinematics: hands and feet at fixed places on the floor.

Keyframes are authored by eye, so feet would slide and hands would sink. Every frame is therefore
corrected by a small least-squares problem: near the authored pose, joints in contact at their
places, every joint above the floor. All frames are solved at once and independently; inputs smooth
in time give outputs smooth in time. Axes of the choreography (y up, floor at y = 0), metres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from imocap_core.conventions import SIDES, SMPL_JOINTS, sideless
from imocap_core.synthetic.yoga import Key

# points of the skin that must stay above the floor, and their clearance
_SKIN_M = {"big_toe": 0.008, "small_toe": 0.008, "heel": 0.004}
_SKIN_M |= {"middle_tip": 0.008, "thumb_tip": 0.008, "index1": 0.015, "pinky1": 0.015}
SKIN: tuple[str, ...] = tuple(f"{side}_{name}" for side in SIDES for name in _SKIN_M)
POINTS: tuple[str, ...] = SMPL_JOINTS + SKIN

Forward = Callable[
    [Float[np.ndarray, "N 24 3 3"], Float[np.ndarray, "N 3"]],
    tuple[Float[np.ndarray, "N P 3"], Float[np.ndarray, "N P 3 72"]],
]
"""Forward kinematics: local rotations and pelvis to POINTS, and their derivatives by right local
increments of the rotations."""

ContactPlace = tuple[str, str]
"""(side, "front" | "back" | "return" | "hands" | "wide" | "forward")."""

_INDEX = {name: i for i, name in enumerate(SMPL_JOINTS)}
_HAND_REACH_M = 0.17  # hands are planted this far in front of the balls of the feet
_HAND_HALF_WIDTH_M = 0.19
_FOOT_HALF_WIDTH_M = 0.09
_STRIDE_M = 1.22  # from the planted wrists back to the balls of the rear feet
_WIDE_M = 0.15  # a wide stance, further out than a narrow one
_STEP_M = 0.38  # a step to the front
_STEP_LIFT_M = 0.10
_ROLL_LIFT_M = 0.07  # of a foot that rolls over its toes
_ROLL_DEG = 30.0
_FIRM = 1 / 0.003  # weight of a joint in contact: an error of 3 mm costs 1
_FLOOR = 1 / 0.004
_ITERATIONS = 16
_GENTLE = 8  # first iterations, in which weights increase, so that far targets cause no divergence
_GENTLE_DECADES = 2.0
_RAMP = 0.6  # share of the way to the next key in which a contact fades
_FADE_DECADES = 4.0  # decrease of its weight over this ramp, before it is 0

# distance of a joint centre from the skin below it, in contact poses
_CLEARANCE_M = {"pelvis": 0.10, "spine1": 0.11, "spine2": 0.12, "spine3": 0.13, "neck": 0.09}
_CLEARANCE_M |= {"head": 0.12, "hip": 0.09, "knee": 0.06, "shoulder": 0.08, "elbow": 0.05}
_CLEARANCE_M |= {"collar": 0.09, "ankle": 0.05, "foot": 0.02, "wrist": 0.06, "hand": 0.035}

# deviation in degrees about (x, y, z) from the authored rotation that costs 1
_GIVE_DEG = {"pelvis": (8, 4, 4), "spine1": (8, 4, 4), "spine2": (8, 4, 4), "spine3": (8, 4, 4)}
_GIVE_DEG |= {"hip": (25, 10, 10), "knee": (30, 3, 3), "ankle": (25, 8, 8), "foot": (20, 2, 2)}
_GIVE_DEG |= {"neck": (5, 3, 3), "head": (5, 3, 3), "collar": (6, 8, 8)}
_GIVE_DEG |= {
    "shoulder": (20, 25, 25),
    "elbow": (12, 25, 3),
    "wrist": (10, 12, 30),
    "hand": (1, 1, 1),
}
_GIVE_HIPS_M = (0.06, 0.20, 0.20)


def per_name(table: Mapping[str, object], names: Sequence[str]) -> Float[np.ndarray, "N ..."]:
    """Rows of a table by names without their side."""
    return np.array([table[sideless(name)] for name in names], dtype=np.float64)


@dataclass(frozen=True)
class ContactTargets:
    """Target positions of points, with weights in 1/m; 0 where a point is free."""

    position: Float[np.ndarray, "N P 3"]
    weight: Float[np.ndarray, "N P 3"]


def contact_places(
    joints_rest: Float[np.ndarray, "24 3"], sole_height: float
) -> dict[ContactPlace, Float[np.ndarray, "3"]]:
    """Places of the balls of the feet and of the wrists for one body, as joint centres.

    joints_rest: rest joints, metres. sole_height: lowest point of the rest surface, metres.
    """
    plan: dict[ContactPlace, np.ndarray] = {}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        ankle, ball = (joints_rest[_INDEX[f"{side}_{name}"]] for name in ("ankle", "foot"))
        height = ball[1] - sole_height
        length = np.hypot(*(ball - ankle)[[0, 2]])
        x = sign * _FOOT_HALF_WIDTH_M
        plan[side, "front"] = plan[side, "return"] = np.array([1.15 * x, height, 0.7 * length])
        reach = plan[side, "front"][2] + _HAND_REACH_M
        plan[side, "hands"] = np.array([sign * _HAND_HALF_WIDTH_M, _CLEARANCE_M["wrist"], reach])
        plan[side, "back"] = np.array([x, max(height, 0.03), reach - _STRIDE_M])
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        near = plan[side, "front"]
        plan[side, "wide"] = near + np.array([sign * _WIDE_M, 0.0, 0.0])
        plan[side, "forward"] = near + np.array([sign * 0.3 * _WIDE_M, 0.0, _STEP_M])
    return plan


def contact_targets(
    keys: Sequence[Key],
    plan: Mapping[ContactPlace, Float[np.ndarray, "3"]],
    joints_rest: Float[np.ndarray, "24 3"],
    time_s: Float[np.ndarray, " N"],
) -> ContactTargets:
    """Targets of all points at N times: feet in contact or stepping in an arc, palms on the floor.

    A foot between two places follows an arc; soles that are flat before and after stay flat;
    contacts that begin or end fade within the interval between two keys.
    """
    position, weight = (np.zeros((len(time_s), len(POINTS), 3)) for _ in range(2))
    key_times = np.array([key.time_s for key in keys])
    before = np.clip(np.searchsorted(key_times, time_s, side="right") - 1, 0, len(keys) - 2)
    share = (time_s - key_times[before]) / (key_times[before + 1] - key_times[before])
    share = np.clip(share, 0.0, 1.0)[:, None]
    for side in SIDES:
        ankle, ball, wrist, hand = (
            _INDEX[f"{side}_{n}"] for n in ("ankle", "foot", "wrist", "hand")
        )
        legs = [getattr(key, side) for key in keys]
        places = np.array([plan[side, leg.place] for leg in legs])
        start, end = places[before], places[before + 1]
        stepping = np.linalg.norm(end - start, axis=1, keepdims=True) > 1e-9
        toes = np.array([leg.toes for leg in legs])
        rolling = np.abs(toes[before + 1] - toes[before])[:, None] > _ROLL_DEG
        lift = np.where(stepping, _STEP_LIFT_M, _ROLL_LIFT_M * rolling)
        position[:, ball] = start + (end - start) * _smooth(share)
        position[:, ball, 1:2] += lift * np.sin(np.pi * share) ** 2
        weight[:, ball] = _FIRM

        heel = joints_rest[ankle] - joints_rest[ball]
        flat_sole = np.array([np.sign(heel[0]) * 0.01, heel[1], -np.hypot(heel[0], heel[2])])
        position[:, ankle] = position[:, ball] + flat_sole
        flat = _fade(np.array([leg.flat for leg in legs], float), before, share)
        weight[:, ankle] = _FIRM * flat

        reach = np.linalg.norm(joints_rest[hand] - joints_rest[wrist])
        position[:, wrist] = plan[side, "hands"]
        lower = _CLEARANCE_M["hand"] - _CLEARANCE_M["wrist"]
        position[:, hand] = plan[side, "hands"] + np.array([0.0, lower, reach])
        planted = _fade(np.array([key.arms.planted for key in keys], float), before, share)
        weight[:, wrist] = _FIRM * planted
        weight[:, hand] = 0.3 * _FIRM * planted
    return ContactTargets(position, weight)


def _smooth(share: Float[np.ndarray, "N 1"]) -> Float[np.ndarray, "N 1"]:
    return share**2 * (3 - 2 * share)


def _fade(
    on: Float[np.ndarray, " M"], before: Int[np.ndarray, " N"], share: Float[np.ndarray, "N 1"]
) -> Float[np.ndarray, "N 1"]:
    """Contact strength from its value (0 or 1) at the M keys.

    It fades by orders of magnitude, because the effect of a weight on a least-squares solution
    depends on its ratio to the other weights: a linear ramp would release the contact suddenly.
    """
    start, end = on[before][:, None], on[before + 1][:, None]
    leaving = start * _strength(share / _RAMP)
    arriving = end * _strength((1 - share) / _RAMP)
    return np.where((start > 0) & (end > 0), 1.0, leaving + arriving)


def _strength(faded: Float[np.ndarray, "N 1"]) -> Float[np.ndarray, "N 1"]:
    return np.where(faded < 1, 10 ** (-_FADE_DECADES * faded), 0.0)


def solve_contacts(
    forward: Forward,
    guess: Float[np.ndarray, "N 24 3 3"],
    hips: Float[np.ndarray, "N 3"],
    targets: ContactTargets,
) -> tuple[Float[np.ndarray, "N 24 3 3"], Float[np.ndarray, "N 3"]]:
    """Inverse kinematics: poses near the guess that meet their targets and stay above the floor.

    guess: local rotations. hips: pelvis positions. Returns both, corrected by a fixed number of
    Gauss-Newton steps with 75 unknowns per frame.
    """
    frames = len(guess)
    give = np.concatenate([np.deg2rad(per_name(_GIVE_DEG, SMPL_JOINTS)).ravel(), _GIVE_HIPS_M])
    prior = np.diag(1.0 / give**2)
    clearance = per_name(_CLEARANCE_M | _SKIN_M, POINTS)
    rotations, pelvis = guess, hips
    for iteration in range(_ITERATIONS):
        firmness = 10 ** (-_GENTLE_DECADES * max(0.0, 1 - iteration / _GENTLE))
        xyz, d_pose = forward(rotations, pelvis)
        by_hips = np.broadcast_to(np.eye(3), (*xyz.shape, 3))
        jacobian = np.concatenate([d_pose, by_hips], axis=-1)
        weight = targets.weight.copy()
        miss = weight * (xyz - targets.position)
        below = (xyz[..., 1] < clearance) & (weight[..., 1] == 0)
        weight[..., 1] += _FLOOR * below
        miss[..., 1] += _FLOOR * below * (xyz[..., 1] - clearance)
        weight, miss = firmness * weight, firmness * miss
        rows = (weight[..., None] * jacobian).reshape(frames, -1, len(give))
        moved = _log(np.swapaxes(guess, -1, -2) @ rotations).reshape(frames, -1)
        away = np.concatenate([moved, pelvis - hips], axis=1)
        gradient = np.einsum("nrk,nr->nk", rows, miss.reshape(frames, -1)) + away @ prior
        step = -np.linalg.solve(np.swapaxes(rows, 1, 2) @ rows + prior, gradient[..., None])[..., 0]
        turn = Rotation.from_rotvec(step[:, :-3].reshape(-1, 3)).as_matrix()
        rotations = rotations @ turn.reshape(guess.shape)
        pelvis = pelvis + step[:, -3:]
    return rotations, pelvis


def _log(matrices: Float[np.ndarray, "... 3 3"]) -> Float[np.ndarray, "... 3"]:
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec().reshape(matrices.shape[:-1])
