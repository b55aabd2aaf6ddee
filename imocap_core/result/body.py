"""The body model of a result, and what needs it: joints with fingers, and surfaces."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.body import Model, load_free_body
from imocap_core.body.model import rotations_from_pose
from imocap_core.errors import WorkFailed

CHUNK = 32  # bodies posed at once


def body_model(model: str, action: str, hands: bool) -> Model:
    """The body model that an action was captured with, with fingers (52 joints) when `hands`.

    model: its name and digest, as artifacts say. WorkFailed when this version has another one.
    """
    name, digest = model.split()
    body = load_free_body()
    if (body.name, body.digest) != (name, digest):
        raise WorkFailed(
            f"{action} was made with the body model {name} ({digest[:12]}), and this version has "
            f"{body.name} ({body.digest[:12]}); run it with: imocap run {action}"
        )
    return load_free_body(hands=True) if hands else body


def posed_joints(
    model: Model,
    betas: Float[np.ndarray, " B"],
    poses: Float[np.ndarray, "T P"],
    trans: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, "T J 3"]:
    """Joints, metres, of a shape in axis-angle poses (T, 3 J), radians."""
    shaped = model.shape(torch.as_tensor(betas))
    R_local = torch.as_tensor(local_rotations(poses))
    return shaped.pose(R_local, torch.as_tensor(trans)).joints.numpy()


def posed_surface(
    model: Model,
    betas: Float[np.ndarray, " B"],
    poses: Float[np.ndarray, "T P"],
    trans: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, "T V 3"]:
    """Vertices, metres, of a shape in axis-angle poses (T, 3 J), radians."""
    shaped = model.shape(torch.as_tensor(betas))
    vertices = np.empty((len(poses), len(model.v_template), 3))
    for first in range(0, len(poses), CHUNK):
        part = slice(first, first + CHUNK)
        R_local = torch.as_tensor(local_rotations(poses[part]))
        posed = shaped.pose(R_local, torch.as_tensor(trans[part]))
        vertices[part] = posed.mesh().vertices.numpy()
    return vertices


def local_rotations(poses: Float[np.ndarray, "T P"]) -> Float[np.ndarray, "T J 3 3"]:
    """Rotation matrices of axis-angle poses (T, 3 J), radians."""
    return rotations_from_pose(torch.as_tensor(poses)).numpy()
