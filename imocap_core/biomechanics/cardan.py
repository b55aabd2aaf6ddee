"""Rotations as three angles about the axes of a joint coordinate system.

Grood & Suntay (J. Biomech. Eng. 105:136-144, 1983): the first axis is fixed to the proximal
segment, the third to the distal one, the second floats. All angles are in radians.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.segments import turn_about

Angles = Float[np.ndarray, "T 3"]
Y = np.array([0.0, 1.0, 0.0])
LEAST_ELEVATION = np.radians(5.0)  # below it, or this near to 180 degrees, there is no plane


def zxy(R: Float[np.ndarray, "T 3 3"]) -> Angles:
    """Angles a, b, c of R = Rz(a) Rx(b) Ry(c): flexion, abduction, axial rotation."""
    b = np.arcsin(np.clip(R[:, 2, 1], -1, 1))
    a = np.arctan2(-R[:, 0, 1], R[:, 1, 1])
    c = np.arctan2(-R[:, 2, 0], R[:, 2, 2])
    return np.stack([a, b, c], axis=1)


def yxz(R: Float[np.ndarray, "T 3 3"]) -> Angles:
    """Angles a, b, c of R = Ry(a) Rx(b) Rz(c): rotation, obliquity, tilt (Baker, Gait &
    Posture 13:1-6, 2001)."""
    b = np.arcsin(np.clip(-R[:, 1, 2], -1, 1))
    a = np.arctan2(R[:, 0, 2], R[:, 2, 2])
    c = np.arctan2(R[:, 1, 0], R[:, 1, 1])
    return np.stack([a, b, c], axis=1)


def yxy(R: Float[np.ndarray, "T 3 3"]) -> Angles:
    """Plane of elevation, elevation (0 to pi) and axial rotation of R = Ry(p) Rx(-e) Ry(r).

    Plane and axial rotation are NaN where the elevation is too near to 0 or pi to tell them apart.
    """
    plane, elevation, rotation = yxy_everywhere(R).T
    together = np.minimum(elevation, np.pi - elevation) < LEAST_ELEVATION
    plane, rotation = (np.where(together, np.nan, angle) for angle in (plane, rotation))
    return np.stack([plane, elevation, rotation], axis=1)


def yxy_everywhere(R: Float[np.ndarray, "T 3 3"]) -> Angles:
    """The same at every elevation: the three angles always give R, though near an elevation of 0
    or pi plane and axial rotation take from one another and may jump. At these the plane is 0."""
    elevation = np.arccos(np.clip(R[:, 1, 1], -1, 1))
    plane = np.where(np.sin(elevation) < 1e-6, 0.0, np.arctan2(-R[:, 0, 1], -R[:, 2, 1]))
    raised = turn_about(Y, -plane) @ R  # Rx(-e) Ry(r)
    rotation = np.arctan2(raised[:, 0, 2], raised[:, 0, 0])
    return np.stack([plane, elevation, rotation], axis=1)


def continuous(angle: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    """An angle without jumps of a whole turn, its median within half a turn of 0; NaN stays."""
    out = np.array(angle)
    there = np.isfinite(out)
    if there.any():
        out[there] = np.unwrap(out[there])
        out -= 2 * np.pi * np.round(np.median(out[there]) / (2 * np.pi))
    return out
