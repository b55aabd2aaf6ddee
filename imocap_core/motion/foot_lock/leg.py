"""Inverse kinematics of a leg: the ankle to a place, hip and bones' lengths kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

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
