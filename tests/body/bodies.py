"""Small made-up bodies and a slow, obvious twin of the fast code, for the laws in this folder."""

import numpy as np
import torch

from imocap_core.body import Model

PARENTS = (-1, 0, 1, 2, 1, 0, 5)


def made_body(
    rng: np.random.Generator,
    vertices: int = 40,
    parents: tuple[int, ...] = PARENTS,
    shapes: int = 10,
    dtype: torch.dtype = torch.float64,
) -> Model:
    """A random but valid body: weights and regressor rows sum to 1."""
    joints = len(parents)
    weights = rng.random((vertices, joints)) ** 6
    weights /= weights.sum(1, keepdims=True)
    regressor = rng.random((joints, vertices)) ** 3
    regressor /= regressor.sum(1, keepdims=True)

    def tensor(array: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(array, dtype=dtype)

    return Model(
        name="made",
        joint_names=tuple(f"j{j}" for j in range(joints)),
        parents=parents,
        v_template=tensor(rng.normal(size=(vertices, 3))),
        shapedirs=tensor(0.1 * rng.normal(size=(vertices, 3, shapes))),
        J_regressor=tensor(regressor),
        weights=tensor(weights),
        faces=torch.as_tensor(rng.integers(0, vertices, (50, 3))),
    )


def rodrigues_naive(axis_angle: np.ndarray) -> np.ndarray:
    """Matrix exponential by its power series: no formula shared with the code under test."""
    x, y, z = axis_angle
    generator = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result, term = np.eye(3), np.eye(3)
    for n in range(1, 60):
        term = term @ generator / n
        result = result + term
    return result


def skin_naive(
    model: Model, coefficients: np.ndarray, rotations: np.ndarray, transl: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """SMPL as published, one vertex and one joint at a time: vertices (V, 3), joints (J, 3)."""
    template, shapedirs = model.v_template.double().numpy(), model.shapedirs.double().numpy()
    shaped = template + shapedirs[..., : len(coefficients)] @ coefficients
    rest = model.J_regressor.double().numpy() @ shaped
    world = []
    for j, parent in enumerate(model.parents):
        local = np.eye(4)
        local[:3, :3] = rotations[j]
        local[:3, 3] = rest[j] - (rest[parent] if parent >= 0 else 0)
        world.append(local if parent < 0 else world[parent] @ local)
    weights = model.weights.double().numpy()
    vertices = np.zeros_like(shaped)
    for v in range(len(shaped)):
        for j, transform in enumerate(world):
            vertices[v] += weights[v, j] * (
                transform[:3, :3] @ (shaped[v] - rest[j]) + transform[:3, 3]
            )
    return vertices + transl, np.stack([t[:3, 3] for t in world]) + transl
