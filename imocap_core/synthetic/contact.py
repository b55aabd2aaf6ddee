"""Hands and feet stay where they stand: contact targets, and the poses that meet them.

Keyframes are authored by eye, so feet would slide and hands would sink. Every frame is therefore
corrected by a small least-squares problem: stay near the authored pose, put the planted joints on
their places, keep every joint above the floor. All frames are solved at once and independently;
inputs smooth in time give outputs smooth in time. Stage axes (y up, floor at y = 0), metres.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.conventions import SMPL_JOINTS, sideless
from imocap_core.render.arrays import Floats
from imocap_core.synthetic.yoga import Key

# the joints, then points of the skin that are kept out of the floor; P of them
_SKIN_M = {"big_toe": 0.008, "small_toe": 0.008, "heel": 0.004}  # and how far above they stay
_SKIN_M |= {"middle_tip": 0.008, "thumb_tip": 0.008, "index1": 0.015, "pinky1": 0.015}
SKIN: tuple[str, ...] = tuple(f"{side}_{name}" for side in ("left", "right") for name in _SKIN_M)
POINTS: tuple[str, ...] = SMPL_JOINTS + SKIN

# (R_local (N, 24, 3, 3), pelvis (N, 3)) -> POINTS (N, P, 3) and their derivatives (N, P, 3, 72)
# by right local increments of the rotations
Forward = Callable[[Floats, Floats], tuple[Floats, Floats]]
Place = tuple[str, str]  # (side, "front" | "back" | "return" | "hands" | "wide" | "forward")

_INDEX = {name: i for i, name in enumerate(SMPL_JOINTS)}
_SIDES = ("left", "right")
_HAND_REACH_M = 0.17  # hands are planted this far in front of the balls of the feet
_HAND_HALF_WIDTH_M = 0.19
_FOOT_HALF_WIDTH_M = 0.09
_STRIDE_M = 1.22  # from the planted wrists back to the balls of the rear feet
_WIDE_M = 0.15  # a wide stance, further out than a narrow one
_STEP_M = 0.38  # a step to the front
_STEP_LIFT_M = 0.10
_ROLL_LIFT_M = 0.07  # of a foot that rolls over its toes
_ROLL_DEG = 30.0
_FIRM = 1 / 0.003  # weight of a planted joint: off by 3 mm costs 1
_FLOOR = 1 / 0.004
_ITERATIONS = 16
_GENTLE = 8  # first iterations, in which contacts firm up: a far target must not fling a limb
_GENTLE_DECADES = 2.0
_RAMP = 0.6  # share of the way to the next key in which a contact fades
_FADE_DECADES = 4.0  # by how much before it is gone

# how far a joint centre is from the skin below it, in contact poses
_CLEARANCE_M = {"pelvis": 0.10, "spine1": 0.11, "spine2": 0.12, "spine3": 0.13, "neck": 0.09}
_CLEARANCE_M |= {"head": 0.12, "hip": 0.09, "knee": 0.06, "shoulder": 0.08, "elbow": 0.05}
_CLEARANCE_M |= {"collar": 0.09, "ankle": 0.05, "foot": 0.02, "wrist": 0.06, "hand": 0.035}

# how many degrees about (x, y, z) a joint gives way before it costs 1
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


def per_name(table: Mapping[str, object], names: Sequence[str]) -> Floats:
    """Rows of a table for names with or without their side."""
    return np.array([table[sideless(name)] for name in names], dtype=np.float64)


@dataclass(frozen=True)
class Targets:
    """Where points should be. position, weight (N, P, 3); weight in 1/m, 0 = free."""

    position: Floats
    weight: Floats


def floor_plan(joints_rest: Floats, sole_height: float) -> dict[Place, Floats]:
    """Places of the balls of the feet and of the wrists for one body: place -> joint centre (3,).

    joints_rest (24, 3) rest joints; sole_height (metres) lowest point of the rest surface.
    """
    plan: dict[Place, Floats] = {}
    for side, sign in zip(_SIDES, (1.0, -1.0), strict=True):
        ankle, ball = (joints_rest[_INDEX[f"{side}_{name}"]] for name in ("ankle", "foot"))
        height = ball[1] - sole_height
        length = np.hypot(*(ball - ankle)[[0, 2]])
        x = sign * _FOOT_HALF_WIDTH_M
        plan[side, "front"] = plan[side, "return"] = np.array([1.15 * x, height, 0.7 * length])
        reach = plan[side, "front"][2] + _HAND_REACH_M
        plan[side, "hands"] = np.array([sign * _HAND_HALF_WIDTH_M, _CLEARANCE_M["wrist"], reach])
        plan[side, "back"] = np.array([x, max(height, 0.03), reach - _STRIDE_M])
    for side, sign in zip(_SIDES, (1.0, -1.0), strict=True):
        near = plan[side, "front"]
        plan[side, "wide"] = near + np.array([sign * _WIDE_M, 0.0, 0.0])
        plan[side, "forward"] = near + np.array([sign * 0.3 * _WIDE_M, 0.0, _STEP_M])
    return plan


def contact_targets(
    keys: Sequence[Key], plan: Mapping[Place, Floats], joints_rest: Floats, time_s: Floats
) -> Targets:
    """Targets of all points at times (N,): feet stand or step in an arc, palms plant and lift.

    A foot on its way between two places is led along an arc; soles that are flat before and after
    stay flat; contacts that begin or end fade within the interval.
    """
    position, weight = (np.zeros((len(time_s), len(POINTS), 3)) for _ in range(2))
    key_times = np.array([key.time_s for key in keys])
    before = np.clip(np.searchsorted(key_times, time_s, side="right") - 1, 0, len(keys) - 2)
    share = (time_s - key_times[before]) / (key_times[before + 1] - key_times[before])
    share = np.clip(share, 0.0, 1.0)[:, None]
    for side in _SIDES:
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
        level = np.array([np.sign(heel[0]) * 0.01, heel[1], -np.hypot(heel[0], heel[2])])
        position[:, ankle] = position[:, ball] + level
        flat = _fade(np.array([leg.flat for leg in legs], float), before, share)
        weight[:, ankle] = _FIRM * flat

        reach = np.linalg.norm(joints_rest[hand] - joints_rest[wrist])
        position[:, wrist] = plan[side, "hands"]
        lower = _CLEARANCE_M["hand"] - _CLEARANCE_M["wrist"]
        position[:, hand] = plan[side, "hands"] + np.array([0.0, lower, reach])
        planted = _fade(np.array([key.arms.planted for key in keys], float), before, share)
        weight[:, wrist] = _FIRM * planted
        weight[:, hand] = 0.3 * _FIRM * planted
    return Targets(position, weight)


def _smooth(share: Floats) -> Floats:
    return share**2 * (3 - 2 * share)


def _fade(on: Floats, before: np.ndarray, share: Floats) -> Floats:
    """Contact strength (N, 1) from its value (0 or 1) at the keys.

    It fades by orders of magnitude, because what a weight does to a least-squares solution goes
    with its ratio to the other weights: a linear ramp would let go all at once.
    """
    start, end = on[before][:, None], on[before + 1][:, None]
    leaving = start * _faint(share / _RAMP)
    arriving = end * _faint((1 - share) / _RAMP)
    return np.where((start > 0) & (end > 0), 1.0, leaving + arriving)


def _faint(way_off: Floats) -> Floats:
    return np.where(way_off < 1, 10 ** (-_FADE_DECADES * way_off), 0.0)


def plant(forward: Forward, guess: Floats, hips: Floats, targets: Targets) -> tuple[Floats, Floats]:
    """Poses near the guess that meet their targets and stay above the floor.

    guess (N, 24, 3, 3) local rotations; hips (N, 3) pelvis positions. Returns the same two,
    corrected, after a fixed number of Gauss-Newton steps (each frame has its own 75 unknowns).
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


def _log(matrices: Floats) -> Floats:
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec().reshape(matrices.shape[:-1])
