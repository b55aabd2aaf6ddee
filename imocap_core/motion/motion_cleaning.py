"""Clean motion for characters: feet in contact stay in place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from imocap_core.body.kinematics import world_rotations
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.terms.contact import contact_share
from imocap_core.sequences import runs

SPEED_M_S = 0.05  # of a foot whose contact counts a quarter, as in the fit of the common motion
LEAST_SHARE = 0.25
SHORTEST_S = 0.15  # of a contact
GAP_S = 0.1  # shorter ones end no contact
AWAY_M = 0.01  # from where it stands, at a contact's ends
HEIGHT_M = 0.2  # above the ground: a foot that is held still in the air is none on the ground


@dataclass(frozen=True)
class Span:
    """Frames from `first` to `last`, both included."""

    first: int
    last: int

    @property
    def frames(self) -> slice:
        """As an index."""
        return slice(self.first, self.last + 1)

    def common(self, other: Span) -> Span | None:
        """The frames of both; None when there is none."""
        first, last = max(self.first, other.first), min(self.last, other.last)
        return Span(first, last) if first <= last else None


def in_contact(
    points: Float[np.ndarray, "T F 3"], height_m: Float[np.ndarray, "T F"], fps: float
) -> Bool[np.ndarray, "steps F"]:
    """Whether points of the feet are in contact from each frame to the next.

    As the fit holds them (`contact_share`), on the result's own motion, near the ground only.
    """
    steps = torch.as_tensor(np.diff(points, axis=0))[None]
    share = contact_share(steps, fps, speed_m_s=SPEED_M_S)[0].numpy()
    low = np.maximum(height_m[1:], height_m[:-1]) < HEIGHT_M
    return (share >= LEAST_SHARE) & low


def spans_of(
    contact: Bool[np.ndarray, " steps"], path: Float[np.ndarray, "T 3"], fps: float
) -> list[Span]:
    """The frames of each contact of one point, whose path is in metres.

    Gaps of less than `GAP_S` are closed. A contact begins and ends within `AWAY_M` of its median
    place: the estimate looks at 0.4 s. Those shorter than `SHORTEST_S` are left out.
    """
    steps = runs(contact, gap=math.ceil(GAP_S * fps) - 1)
    spans = [Span(first, last + 1) for first, last in steps]  # step t is from frame t to t + 1
    trimmed = [_trimmed(span, path) for span in spans]
    return [span for span in trimmed if span.last - span.first >= SHORTEST_S * fps]


def _trimmed(span: Span, path: Float[np.ndarray, "T 3"]) -> Span:
    stands = path[span.frames]
    away = np.linalg.norm(stands - np.median(stands, axis=0), axis=1)
    near = np.flatnonzero(away <= AWAY_M)
    return Span(span.first + int(near[0]), span.first + int(near[-1])) if len(near) else span


def faded(
    correction: Float[np.ndarray, "T n"], anchored: Bool[np.ndarray, " T"], fade: int
) -> Float[np.ndarray, "T n"]:
    """The correction in anchored frames; elsewhere that of the nearest anchored frame before, times
    a weight that falls smoothly from 1 to 0 within `fade` frames (or within the gap, where that is
    shorter), plus that of the nearest after, likewise."""
    filled = np.where(anchored[:, None], correction, 0.0)
    frames = np.flatnonzero(anchored)
    for t in np.flatnonzero(~anchored):
        after = int(np.searchsorted(frames, t))
        before, next_one = frames[after - 1 : after], frames[after : after + 1]
        gap = int(next_one[0] - before[0]) if len(before) and len(next_one) else 2 * fade
        for edge in (*before, *next_one):
            weight = 1.0 - abs(int(edge) - int(t)) / max(1, min(fade, gap))
            filled[t] += smooth_step(weight) * correction[edge]
    return filled


def smooth_step(x: float) -> float:
    """From 0 to 1 with slope 0 at both ends; 0 below 0, 1 above 1."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


TINY = 1e-9


@dataclass(frozen=True, eq=False)
class LegTurns:
    """Rotations of the world that thigh and shin make. reached: False where the place is farther
    away than the leg is long: the leg is straight there and points at it."""

    thigh: Float[np.ndarray, "T 3 3"]
    shin: Float[np.ndarray, "T 3 3"]
    reached: Bool[np.ndarray, " T"]


def leg_to(
    hip: Float[np.ndarray, "T 3"],
    knee: Float[np.ndarray, "T 3"],
    ankle: Float[np.ndarray, "T 3"],
    place: Float[np.ndarray, "T 3"],
    back: Float[np.ndarray, "T 3"],
) -> LegTurns:
    """Turn thigh and shin such that the ankle comes to `place`, metres, world.

    The knee bends by the law of cosines in its own plane; what it bends more, it bends towards
    `back` (unit vectors, where a shin goes in flexion). Then the leg turns about the hip on the
    shortest arc. An ankle that is there already turns nothing.
    """
    thigh, shin = knee - hip, ankle - knee
    l1, l2 = np.linalg.norm(thigh, axis=1), np.linalg.norm(shin, axis=1)
    wanted = np.linalg.norm(place - hip, axis=1)
    distance = np.clip(wanted, np.abs(l1 - l2) + TINY, l1 + l2 - TINY)
    along = thigh / l1[:, None]
    sideways = _across(shin / l2[:, None], along)
    bend = np.linalg.norm(sideways, axis=1)
    cosine = np.clip((distance**2 - l1**2 - l2**2) / (2 * l1 * l2), -1.0, 1.0)
    sine = np.sqrt(1 - cosine**2)
    more = np.maximum(sine - bend, 0.0)
    backwards = unit(_across(back, along))
    plane = unit(sideways + (more + TINY)[:, None] * backwards)
    bent = l2[:, None] * (cosine[:, None] * along + sine[:, None] * plane)
    turn = shortest_arc(knee + bent - hip, place - hip)
    reached = np.abs(wanted - distance) <= 2 * TINY
    return LegTurns(turn, turn @ shortest_arc(shin, bent), reached)


def shortest_arc(
    a: Float[np.ndarray, "T 3"], b: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """The smallest rotations that turn the directions of `a` to those of `b`, which must not be
    opposite."""
    u, v = unit(a), unit(b)
    q = np.concatenate([np.cross(u, v), 1 + (u * v).sum(1, keepdims=True)], axis=1)
    return np.asarray(Rotation.from_quat(q).as_matrix())


def unit(vectors: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
    """Directions of vectors that are not 0."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def _across(
    vectors: Float[np.ndarray, "T 3"], along: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3"]:
    """The part of vectors that is perpendicular to unit vectors."""
    return vectors - (vectors * along).sum(1, keepdims=True) * along


ANKLE, BALL = 0, 1
ROUNDS = 500
EXACT_M = 1e-9


@dataclass(eq=False)
class Contact:
    """A contact of the ankle or the ball of a foot with its place, world, metres.

    centres: places of the hip (for the ball less the foot's vector, as the ankle is above), of each
    frame in which the leg must reach the place.
    """

    point: int
    span: Span
    place: Float[np.ndarray, "3"]
    centres: Float[np.ndarray, "N 3"]


def contacts_of(
    spans: tuple[list[Span], list[Span]],
    hip: Float[np.ndarray, "T 3"],
    ankle: Float[np.ndarray, "T 3"],
    ball: Float[np.ndarray, "T 3"],
    reach_m: float,
) -> list[Contact]:
    """The contacts of one foot; those at the same time have the foot's length between them.

    A place is the mean over the contact, moved as little as it takes: alternating projections onto
    the spheres about the hips that the leg reaches (convex), and onto the foot's length.
    """
    contacts = []
    for span in spans[ANKLE]:
        place = ankle[span.frames].mean(axis=0)
        contacts.append(Contact(ANKLE, span, place, hip[span.frames]))
    for span in spans[BALL]:
        alone = np.ones(span.last - span.first + 1, dtype=bool)
        for other in spans[ANKLE]:
            alone[max(other.first - span.first, 0) : max(other.last + 1 - span.first, 0)] = False
        centres = (hip + ball - ankle)[span.frames][alone]
        contacts.append(Contact(BALL, span, ball[span.frames].mean(axis=0), centres))
    pairs = [
        (a, b)
        for a in contacts
        for b in contacts
        if (a.point, b.point) == (ANKLE, BALL) and a.span.common(b.span)
    ]
    length = float(np.linalg.norm(ball[0] - ankle[0]))
    for _ in range(ROUNDS):
        change = max((_into_reach(c, reach_m) for c in contacts), default=0.0)
        change = max([change, *(_to_length(a, b, length) for a, b in pairs)])
        if change < EXACT_M:
            break
    return contacts


def _into_reach(contact: Contact, reach_m: float) -> float:
    """Move a place into the farthest sphere; by how much."""
    if len(contact.centres) == 0:
        return 0.0
    away = contact.place - contact.centres
    distance = np.linalg.norm(away, axis=1)
    t = int(distance.argmax())
    over = float(distance[t] - reach_m)
    if over <= 0:
        return 0.0
    contact.place = contact.place - away[t] * over / distance[t]
    return over


def _to_length(a: Contact, b: Contact, length: float) -> float:
    """Move two places to a distance from each other; by how much."""
    between = b.place - a.place
    distance = float(np.linalg.norm(between))
    shift = between * (distance - length) / (2 * distance)
    a.place, b.place = a.place + shift, b.place - shift
    return abs(distance - length)


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
