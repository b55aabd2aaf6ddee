"""Poses of the free body from goals: where trunk, hands and feet are, not how joints turn.

Axes: y up, the floor at 0; the body at rest faces +z with +x to its left. Angles in degrees, zero
in the T-pose. Arrays have one row a pose. Sides are left, right; "outwards" is away from the body's
middle on both.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import torch

from benchmarks.synthetic.captured_skeleton import natural_arm
from imocap_core.body import load_free_body
from imocap_core.body.kinematics import centre_of_mass
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.rotations import exp, log

J = {name: k for k, name in enumerate(SMPL_JOINTS)}
MODEL = load_free_body()
PARENTS = MODEL.parents
_SHAPED = MODEL.shape(torch.zeros(10, dtype=torch.float64))
REST = _SHAPED.joints_rest.numpy().reshape(-1, 3)
SOLE = REST[J["left_ankle"], 1] - float(MODEL.v_template[:, 1].min())  # ankle above the floor
SIDES, OUTWARDS = ("left", "right"), (1.0, -1.0)
LEGS = [[J[f"{s}_{p}"] for p in ("hip", "knee", "ankle", "foot")] for s in SIDES]
ARMS = [[J[f"{s}_{p}"] for p in ("shoulder", "elbow", "wrist")] for s in SIDES]
SPINE_SHARES = np.array([0.4, 0.3, 0.3])
COLLAR_SHARE, COLLAR_FROM_DEG = 0.15, 30.0  # rise by the arm's elevation
CHEST, PELVIS, HEAD, WORLD, MIDDLE = range(5)  # axes of a hand's goal
THICKNESS_M = np.full(24, 0.06)  # of the body about its joints
THICKNESS_M[[J["pelvis"], J["spine1"], J["spine2"], J["spine3"]]] = 0.11
THICKNESS_M[[J["head"], J["left_hip"], J["right_hip"]]] = 0.1
THICKNESS_M[[J["left_hand"], J["right_hand"], J["left_foot"], J["right_foot"]]] = 0.03
THICKNESS_M[[J["left_wrist"], J["right_wrist"]]] = 0.04


def about(axis: str, degrees: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) about x, y or z."""
    vector = np.zeros((*np.shape(degrees), 3))
    vector[..., "xyz".index(axis)] = np.radians(degrees)
    return exp(torch.as_tensor(vector)).numpy()


def rotvec(R: np.ndarray) -> np.ndarray:
    """Axis-angle vectors of rotations, radians."""
    return log(torch.as_tensor(np.ascontiguousarray(R))).numpy()


def from_rotvec(vectors: np.ndarray) -> np.ndarray:
    """Rotations of axis-angle vectors, radians."""
    return exp(torch.as_tensor(vectors)).numpy()


def unit(x: np.ndarray) -> np.ndarray:
    """Vectors of length 1."""
    return x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9)


def apply(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rotated vectors."""
    return np.einsum("...ij,...j->...i", R, x)


@dataclass(frozen=True)
class Pose:
    """N poses: local rotations (N, 24, 3, 3) and the pelvis joint's place (N, 3), metres."""

    R_local: np.ndarray
    root: np.ndarray

    def posed(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (N, 24, 3, 3) and places (N, 24, 3) of all joints in the world."""
        R, xyz = self.R_local.copy(), np.zeros((*self.root.shape[:-1], 24, 3))
        xyz[..., 0, :] = self.root
        for joint, parent in enumerate(PARENTS[1:], 1):
            R[..., joint, :, :] = R[..., parent, :, :] @ self.R_local[..., joint, :, :]
            xyz[..., joint, :] = xyz[..., parent, :] + apply(
                R[..., parent, :, :], REST[joint] - REST[parent]
            )
        return R, xyz


@dataclass
class Goals:
    """Goals of N poses.

    lean, roll, yaw (N,): of the pelvis (forwards; to the right; to the left). spine, neck (N, 3):
    forwards, turn to the left, bend to the right. Legs: `feet` (N, 2, 3) the ankles' places above
    the floor (0: flat) where `planted`, with `foot_yaw` outwards, `heel` raised and `knee_out`;
    the pelvis at `height`, or as high as the straighter leg's `least_knee` allows; balanced over
    both feet by `share` on the left. Where not planted `leg` (N, 2, 4): flexion, abduction, outward
    rotation of the hip, flexion of the knee; `toes` (N, 2) pointed; the lowest part of the body
    touches the floor, or is `height` above it. Arms: `hands` (N, 2, 3) the wrists' places in
    `axes` (N, 2), x outwards; `elbow` (N, 2, 3) where elbows point to in the chest's axes, nan:
    as usual; `swivel` (N, 2) from there, outwards. flat_hands: palms on the floor.
    """

    lean: np.ndarray
    roll: np.ndarray
    yaw: np.ndarray
    spine: np.ndarray
    neck: np.ndarray
    feet: np.ndarray
    foot_yaw: np.ndarray
    heel: np.ndarray
    knee_out: np.ndarray
    least_knee: np.ndarray
    height: np.ndarray
    share: np.ndarray
    leg: np.ndarray
    toes: np.ndarray
    hands: np.ndarray
    axes: np.ndarray
    elbow: np.ndarray
    swivel: np.ndarray
    wrist: np.ndarray
    planted: np.ndarray
    flat_hands: np.ndarray
    ahead: np.ndarray
    level: np.ndarray

    def but(self, **changes: np.ndarray) -> Goals:
        """The same goals but for some."""
        return replace(self, **{k: np.broadcast_to(v, getattr(self, k).shape)
                                for k, v in changes.items()})  # fmt: skip

    def rows(self, which: np.ndarray) -> Goals:
        """Some poses."""
        return Goals(**{f.name: getattr(self, f.name)[which] for f in fields(self)})


def stacked(keys: list[Goals]) -> Goals:
    """Keys one after another."""
    return Goals(**{f.name: np.concatenate([getattr(k, f.name) for k in keys])
                    for f in fields(Goals)})  # fmt: skip


def pose_of(goals: Goals) -> Pose:
    """Poses that reach their goals."""
    R = _trunk(goals)
    planted = goals.planted
    R_legs = _free_legs(goals)
    for leg in LEGS:
        R[:, leg] = R_legs[:, leg]
    root = np.zeros((len(R), 3))
    root[:, [0, 2]] = goals.feet[:, :, [0, 2]].mean(1)
    root[:, 1] = 0.9
    for _ in range(4):
        _reach_with_arms(goals, R, root)
        _, xyz = Pose(R, root).posed()
        middle = (
            goals.share[:, None] * goals.feet[:, 0] + (1 - goals.share[:, None]) * goals.feet[:, 1]
        )
        off = (middle - centre_of_mass(xyz))[:, [0, 2]]
        off[:, 1] += 0.04 + goals.ahead  # between heel and ball
        root[:, [0, 2]] += np.where(planted[:, None], off, 0.0)
        root[:, 1] = np.where(planted, _height(goals, R, root), root[:, 1])
        stand_on(goals.feet, goals, R, root, planted)
    lowest = (Pose(R, root).posed()[1][..., 1] - THICKNESS_M).min(1)
    lift = np.where(np.isnan(goals.height), 0.0, goals.height)
    root[:, 1] -= np.where(planted, 0.0, lowest - lift)
    root[:, [0, 2]] = np.where(planted[:, None], root[:, [0, 2]], 0.0)
    _reach_with_arms(goals, R, root)
    return Pose(R, root)


def _trunk(goals: Goals) -> np.ndarray:
    R = np.tile(np.eye(3), (len(goals.lean), 24, 1, 1))
    R[:, 0] = about("y", goals.yaw) @ about("z", -goals.roll) @ about("x", goals.lean)
    for joint, share in zip(("spine1", "spine2", "spine3"), SPINE_SHARES, strict=True):
        R[:, J[joint]] = from_rotvec(np.radians(goals.spine) * (1, 1, -1) * share)
    for joint in ("neck", "head"):
        R[:, J[joint]] = from_rotvec(np.radians(goals.neck) * (1, 1, -1) * 0.5)
    return R


def _free_legs(goals: Goals) -> np.ndarray:
    R = np.tile(np.eye(3), (len(goals.lean), 24, 1, 1))
    for side, (hip, knee, ankle, _) in enumerate(LEGS):
        flexion, abduction, turn, bend = goals.leg[:, side].T
        out = OUTWARDS[side]
        R[:, hip] = about("z", out * abduction) @ about("x", -flexion) @ about("y", out * turn)
        R[:, knee] = about("x", bend)
        R[:, ankle] = about("x", goals.toes[:, side])
    return R


def _foot(goals: Goals, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (N, 3, 3) of a planted foot in the world, and the ankle's shift (N, 3) where the
    heel is raised over the ball."""
    yaw = goals.foot_yaw[:, side] * OUTWARDS[side] + goals.yaw
    R = about("y", yaw)
    ball = REST[LEGS[side][3]] - REST[LEGS[side][2]]
    raised = R @ about("x", goals.heel[:, side])
    return raised, apply(R, ball) - apply(raised, ball)


def _height(goals: Goals, R: np.ndarray, root: np.ndarray) -> np.ndarray:
    """(N,) of the pelvis: given, or what the straighter leg reaches with its least flexion."""
    heights = []
    for side, (hip, knee, ankle, _) in enumerate(LEGS):
        thigh, shank = REST[knee] - REST[hip], REST[ankle] - REST[knee]
        straight = np.linalg.norm(thigh + apply(about("x", goals.least_knee), shank), axis=-1)
        hip_xyz = apply(R[:, 0], REST[hip] - REST[0])
        away = goals.feet[:, side] + _foot(goals, side)[1] - root - hip_xyz
        across = np.linalg.norm(away[:, [0, 2]], axis=-1)
        rise = np.sqrt(np.maximum(straight**2 - across**2, 0.01))
        target = goals.feet[:, side, 1] + SOLE + _foot(goals, side)[1][:, 1]
        heights.append(np.where(goals.feet[:, side, 1] > 0.03, 9.0, target + rise - hip_xyz[:, 1]))
    least = np.minimum(*heights)
    return np.where(np.isnan(goals.height), least, np.minimum(goals.height, least))


def stand_on(
    feet: np.ndarray, goals: Goals, R: np.ndarray, root: np.ndarray, rows: np.ndarray
) -> None:
    """Turn the legs (in R) so that the ankles are at their places, in some rows."""
    for side, (hip, knee, ankle, _) in enumerate(LEGS):
        foot_R, shift = _foot(goals, side)
        place = feet[:, side] + shift + (0.0, SOLE, 0.0)
        hip_xyz = root + apply(R[:, 0], REST[hip] - REST[0])
        out = np.radians(goals.knee_out[:, side]) * OUTWARDS[side]
        ahead = np.stack([np.sin(out), 0 * out, np.cos(out)], -1)
        pole = apply(R[:, 0], ahead) + 0.5 * apply(foot_R, np.array([0.0, 0.0, 1.0]))
        hip_R, bend = _two_bones_of_a_leg(REST[knee] - REST[hip], REST[ankle] - REST[knee],
                                          place - hip_xyz, pole)  # fmt: skip
        R[rows, hip] = (R[:, 0].swapaxes(-1, -2) @ hip_R)[rows]
        R[rows, knee] = bend[rows]
        turned = rotvec((hip_R @ bend).swapaxes(-1, -2) @ foot_R)
        turned = np.clip(turned, np.radians([-42, -30, -30]), np.radians([60, 30, 30]))
        R[rows, ankle] = from_rotvec(turned)[rows]


def _two_bones_of_a_leg(
    thigh: np.ndarray, shank: np.ndarray, to: np.ndarray, pole: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotations of the hip in the world and of the knee in the thigh: the ankle at `to` from the
    hip, the knee towards the pole."""
    a = thigh[1] * shank[1] + thigh[2] * shank[2]
    b = thigh[2] * shank[1] - thigh[1] * shank[2]
    c = ((to**2).sum(-1) - thigh @ thigh - shank @ shank) / 2 - thigh[0] * shank[0]
    angle = np.arctan2(b, a) + np.arccos(np.clip(c / np.hypot(a, b), -0.95, 1.0))
    bend = about("x", np.degrees(angle))
    along = unit(thigh + apply(bend, shank))
    goal = unit(to)
    return _frame(goal, np.cross(pole, goal)) @ _frame(along, np.array([1.0, 0, 0])).swapaxes(
        -1, -2
    ), bend


def _frame(along: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Axes (columns): along; the part of `side` across it; their cross product."""
    side = np.broadcast_to(side, along.shape)
    across = unit(side - (side * along).sum(-1, keepdims=True) * along)
    return np.stack([along, across, np.cross(along, across)], -1)


def _reach_with_arms(goals: Goals, R: np.ndarray, root: np.ndarray) -> None:
    R_world, xyz = Pose(R, root).posed()
    middle = (xyz[:, J["left_shoulder"]] + xyz[:, J["right_shoulder"]]) / 2
    frames = [J["spine3"], 0, J["head"], J["spine3"]]
    for side, (shoulder, *_) in enumerate(ARMS):
        out = OUTWARDS[side]
        mirrored = goals.hands[:, side] * (out, 1.0, 1.0)
        place = np.empty_like(root)
        origins = [xyz[:, shoulder], xyz[:, 0], xyz[:, J["head"]], middle]
        for axes, origin, joint in zip((CHEST, PELVIS, HEAD, MIDDLE), origins, frames, strict=True):
            rows = goals.axes[:, side] == axes
            local = goals.hands[:, side] if axes == MIDDLE else mirrored
            place[rows] = (origin + apply(R_world[:, joint], local))[rows]
        world = goals.axes[:, side] == WORLD
        place[world] = goals.hands[world, side]
        reach(R, root, side, place, goals.elbow[:, side] * (out, 1, 1), goals.swivel[:, side])
        wrist = goals.wrist[:, side] * (1.0, out, out)
        R[:, ARMS[side][2]] = from_rotvec(np.radians(wrist))
    lay_hands(goals.flat_hands, goals.yaw, R)


def reach(
    R: np.ndarray, root: np.ndarray, side: int, place: np.ndarray, elbow: np.ndarray,
    swivel: np.ndarray,
) -> None:  # fmt: skip
    """Turn collar, shoulder and elbow (in R) so that the wrist is at its place (N, 3)."""
    shoulder, low, wrist = ARMS[side]
    collar, out = PARENTS[shoulder], OUTWARDS[side]
    upper, fore = abs(REST[low, 0] - REST[shoulder, 0]), abs(REST[wrist, 0] - REST[low, 0])
    for _ in range(2):
        R_world, xyz = Pose(R, root).posed()
        chest = R_world[:, J["spine3"]]
        to = apply(chest.swapaxes(-1, -2), place - xyz[:, shoulder])
        above = np.degrees(np.arccos(np.clip(-unit(to)[:, 1], -1, 1))) - COLLAR_FROM_DEG
        R[:, collar] = about("z", out * COLLAR_SHARE * np.maximum(above, 0.0))
    length = np.clip(np.linalg.norm(to, axis=-1), 0.3 * upper, 0.999 * (upper + fore))
    bend = np.arccos(np.clip((length**2 - upper**2 - fore**2) / (2 * upper * fore), -1, 1))
    goal = unit(to)
    usual = natural_arm(np.array([out, 0.0, 0.0]), goal)[..., 2] * -1.0
    pole = np.where(np.isnan(elbow), usual, elbow)
    pole = apply(from_rotvec(np.radians(swivel)[:, None] * goal * out), pole)
    along = np.stack([out * (upper + fore * np.cos(bend)), 0 * bend, fore * np.sin(bend)], -1)
    hinge = np.cross(goal, pole) * out
    R_arm = _frame(goal, hinge) @ _frame(unit(along), np.array([0.0, 1, 0])).swapaxes(-1, -2)
    R[:, shoulder] = R[:, collar].swapaxes(-1, -2) @ R_arm
    R[:, low] = about("y", -out * np.degrees(bend))


def lay_hands(rows: np.ndarray, yaw: np.ndarray, R: np.ndarray) -> None:
    """Palms on the floor in some rows, fingers ahead."""
    R_world, _ = Pose(R, np.zeros((len(R), 3))).posed()
    for side, (_, low, wrist) in enumerate(ARMS):
        out = OUTWARDS[side]
        finger = apply(about("y", yaw), np.array([0.0, 0.0, 1.0])) * out
        flat = _frame(finger, np.array([0.0, 1.0, 0.0]))
        turn = rotvec(R_world[:, low].swapaxes(-1, -2) @ flat)
        turn *= np.minimum(
            1.0, 1.5 / np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-9)
        )
        R[rows, wrist] = from_rotvec(turn)[rows]


def plausible(pose: Pose) -> np.ndarray:
    """(N,) bool: joints within their ranges, hands and elbows outside the trunk and the head."""
    R, xyz = pose.posed()
    good = (xyz[..., 1] > -0.04).all(-1)
    for side, (hip, knee, _, _) in enumerate(LEGS):
        turn = np.degrees(rotvec(pose.R_local[:, hip])) * (1, OUTWARDS[side], OUTWARDS[side])
        good &= (turn > (-145, -55, -40)).all(-1) & (turn < (35, 75, 75)).all(-1)
        bend = np.degrees(rotvec(pose.R_local[:, knee]))[:, 0]
        good &= (bend > -6) & (bend < 155)
    low, high = xyz[:, 0], xyz[:, J["neck"]]
    along = unit(high - low)
    for side in (0, 1):
        shoulder, elbow, wrist = (xyz[:, k] for k in ARMS[side])
        hand = xyz[:, J[f"{SIDES[side]}_hand"]]
        for point in (elbow, wrist, (elbow + wrist) / 2, hand, xyz[:, LEGS[side][1]]):
            local = apply(R[:, J["spine1"]].swapaxes(-1, -2), point - low)
            rise = ((point - low) * along).sum(-1)
            axis = apply(R[:, J["spine1"]].swapaxes(-1, -2), along)
            local = local - rise[:, None] * axis
            inside = (local[:, 0] / 0.14) ** 2 + ((local[:, 2] - 0.02) / 0.105) ** 2 < 1
            good &= ~(inside & (rise > -0.05) & (rise < 0.45))
        skull = xyz[:, J["head"]] + apply(R[:, J["head"]], np.array([0.0, 0.06, 0.02]))
        good &= np.linalg.norm(wrist - skull, axis=-1) > 0.1
        behind = apply(R[:, J["spine3"]].swapaxes(-1, -2), elbow - shoulder)
        good &= behind[:, 2] > -0.24
    return good
