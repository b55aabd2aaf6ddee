"""Feet in contact stay where they stand; the legs follow, the pelvis keeps its path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from imocap_core.body.kinematics import world_rotations
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.foot_lock.contacts import Span, in_contact, spans_of
from imocap_core.motion.foot_lock.fade import faded
from imocap_core.motion.foot_lock.leg import leg_to, shortest_arc
from imocap_core.motion.foot_lock.places import ANKLE, BALL, Contact, contacts_of

FADE_S = 0.2
SLACK_M = 1e-6  # of a leg that is as good as straight
BACK = np.array([0.0, 0.0, -1.0])  # in the thigh's axes, where the shin goes when the knee bends
Rotations = Float[np.ndarray, "T 3 3"]


@dataclass(frozen=True, eq=False)
class LockedFeet:
    """Rotations with locked feet.

    R_local: relative to the parent, the first joint's in the world. contact (T-1, 4): steps in
    contact, of ankle and ball, left, then right. reached (T,): False where a leg is too short for
    where its foot stands.
    """

    R_local: Float[np.ndarray, "T J 3 3"]
    contact: Bool[np.ndarray, "steps 4"]
    reached: Bool[np.ndarray, " T"]


def lock_feet(
    R_local: Float[np.ndarray, "T J 3 3"],
    joints: Float[np.ndarray, "T J 3"],
    parents: tuple[int, ...],
    height_m: Float[np.ndarray, "T J"],
    fps: float,
) -> LockedFeet:
    """Lock the feet of a motion.

    Args:
        R_local, joints: of SMPL's joints (or SMPL+H's): rotations, and places in axes that do not
            move, metres.
        height_m: of the joints above the ground.
    """
    R_world = world_rotations(torch.as_tensor(R_local), parents).numpy()
    locked, reached = R_local.copy(), np.ones(len(joints), dtype=bool)
    steps = []
    for side in ("left", "right"):
        leg = [SMPL_JOINTS.index(f"{side}_{part}") for part in ("hip", "knee", "ankle", "foot")]
        hip, knee, ankle, _ = leg
        contact = in_contact(joints[:, leg[2:]], height_m[:, leg[2:]], fps)
        ankles, balls = (
            spans_of(contact[:, point], joints[:, leg[2 + point]], fps) for point in (ANKLE, BALL)
        )
        spans = ankles, balls
        steps.append(np.stack([_steps_of(s, len(contact)) for s in spans], axis=1))
        if not any(spans):
            continue
        turned, there = _leg_rotations(R_world[:, leg], joints[:, leg], spans, fps)
        reached &= there
        above = R_world[:, parents[hip]]
        for joint, R in zip((hip, knee, ankle), turned, strict=True):
            locked[:, joint] = np.swapaxes(above, 1, 2) @ R
            above = R
    return LockedFeet(locked, np.concatenate(steps, axis=1), reached)


def _leg_rotations(
    R: Float[np.ndarray, "T 4 3 3"],
    joints: Float[np.ndarray, "T 4 3"],
    spans: tuple[list[Span], list[Span]],
    fps: float,
) -> tuple[tuple[Rotations, Rotations, Rotations], Bool[np.ndarray, " T"]]:
    """World rotations of thigh, shin and foot, and where the leg is long enough."""
    hip, knee, ankle, ball = joints.swapaxes(0, 1)
    lengths = [float(np.linalg.norm(b[0] - a[0])) for a, b in ((hip, knee), (knee, ankle))]
    contacts = contacts_of(spans, hip, ankle, ball, sum(lengths) - SLACK_M)
    fade = max(1, round(FADE_S * fps))
    foot = _foot_rotations(R[:, 2], ball - ankle, contacts, fade)
    vector = np.einsum("tij,tj->ti", foot @ np.swapaxes(R[:, 2], 1, 2), ball - ankle)
    place, anchored = ankle.copy(), np.zeros(len(ankle), dtype=bool)
    for contact in sorted(contacts, key=lambda c: -c.point):  # where both stand they agree
        frames = contact.span.frames
        of_ball = contact.point == BALL
        place[frames] = contact.place - vector[frames] if of_ball else contact.place
        anchored[frames] = True
    place = ankle + faded(place - ankle, anchored, fade)
    turns = leg_to(hip, knee, ankle, place, R[:, 0] @ BACK)
    return (turns.thigh @ R[:, 0], turns.shin @ R[:, 1], foot), turns.reached | ~anchored


def _foot_rotations(
    R: Rotations, vector: Float[np.ndarray, "T 3"], contacts: list[Contact], fade: int
) -> Rotations:
    """World rotations of a foot, constant while ankle and ball stand.

    vector: from ankle to ball. Elsewhere the foot turns as it did, by a correction that fades.
    """
    turn = np.zeros((len(R), 3))
    anchored = np.zeros(len(R), dtype=bool)
    for a in (c for c in contacts if c.point == ANKLE):
        for b in (c for c in contacts if c.point == BALL):
            both = a.span.common(b.span)
            if both is None:
                continue
            frames = both.frames
            wanted = np.tile(b.place - a.place, (len(R[frames]), 1))
            lying = Rotation.from_matrix(shortest_arc(vector[frames], wanted) @ R[frames]).mean()
            along = (lying.as_matrix() @ np.swapaxes(R[frames], 1, 2))[:1] @ vector[frames][0]
            still = shortest_arc(along, wanted[:1])[0] @ lying.as_matrix()
            change = Rotation.from_matrix(still @ np.swapaxes(R[frames], 1, 2))
            turn[frames], anchored[frames] = change.as_rotvec(), True
    return np.asarray(Rotation.from_rotvec(faded(turn, anchored, fade)).as_matrix() @ R)


def _steps_of(spans: list[Span], steps: int) -> Bool[np.ndarray, " steps"]:
    contact = np.zeros(steps, dtype=bool)
    for span in spans:
        contact[span.first : span.last] = True
    return contact
