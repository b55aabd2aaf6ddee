"""Small made scenes for the motion tests: known truth, computed in a second."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from imocap_core.body import load_free_body
from imocap_core.motion.multiview.scene import Cameras, JointMotion, Scene
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior, mixture
from imocap_core.motion.state import Body, MotionState
from imocap_core.params import FitParams
from imocap_core.rotations import exp

TURNS_DEG = [0.0, 80.0, -70.0]  # of the views about the vertical
FRAMES = 20
FOCAL_PX = 600.0
K = np.array([[FOCAL_PX, 0, 320], [0, FOCAL_PX, 180], [0, 0, 1.0]])
FACING = torch.tensor([np.pi, 0.0, 0.0], dtype=torch.float64)  # upright, towards the camera

WEIGHTS = FitParams(
    robust_scale_sigma=4.0, pose_prior=0.05, shape_prior=50.0, hidden_shape_prior=50.0,
    size_prior=50.0, limits=100.0, velocity=0.02, acceleration=0.3, acceleration_scale=3.0,
    foot_speed_m_s=0.2, foot_hold_m_s=0.02,
    path_acceleration_m_s2=6.0, evidence_mm=80.0,
)  # fmt: skip


@dataclass(frozen=True)
class Made:
    """A motion (1, T) in the world and what cameras see of it."""

    body: Body
    state: MotionState
    R: np.ndarray  # (M, 3, 3)
    t: np.ndarray  # (M, 3)
    observations: list[Observation]

    def cameras(self, count: int | None = None) -> Cameras:
        """The true ones, or the first of them."""
        K = np.stack([o.K for o in self.observations])
        return Cameras(*(torch.as_tensor(x[:count]) for x in (self.R, self.t, K)))


def wide_prior() -> PosePrior:
    """A single wide Gaussian about the rest pose."""
    ones = np.ones(24)
    return mixture(np.zeros((1, 69)), 0.25 * np.eye(69)[None], np.ones(1), 0.1 * ones, 0.05 * ones)


def waving(
    frames: int, body: Body, rng: np.random.Generator, *, path_m: float = 0.1
) -> MotionState:
    """A smooth motion of all big joints, facing the camera four metres away."""
    phase = torch.linspace(0, 2 * np.pi, frames, dtype=torch.float64)[:, None, None]
    amplitude = torch.as_tensor(rng.normal(0, 0.25, (1, 24, 3)))
    offset = torch.as_tensor(rng.uniform(0, 2 * np.pi, (1, 24, 3)))
    theta = amplitude * torch.sin(phase + offset)
    for still in (10, 11, 13, 14, 20, 21, 22, 23):
        theta[:, still] = 0.0
    R_local = exp(theta)
    R_local[:, 0] = exp(FACING) @ exp(0.3 * theta[:, 0])
    trans = torch.tensor([0.0, 0.0, 4.0], dtype=torch.float64) + path_m * torch.sin(
        phase[:, 0] + torch.tensor([0.0, 1.0, 2.0], dtype=torch.float64)
    )
    valid = torch.ones(1, frames, dtype=torch.bool)
    return MotionState.of(R_local[None], trans[None], trans.new_zeros(1, 10), valid)


def scene(
    frames: int,
    turns_deg: list[float],
    rng: np.random.Generator,
    *,
    noise_px: float = 1.0,
    path_m: float = 0.1,
) -> Made:
    """Cameras on a circle about the performer, the first of them the world's axes."""
    body = Body.of(load_free_body(), "body25")
    state = waving(frames, body, rng, path_m=path_m)
    xyz = body.positions(body.keypoints, state)[0].numpy()
    centre = np.array([0.0, 0.0, 4.0])
    R, t, observations = [], [], []
    for turn in np.deg2rad(turns_deg):
        c, s = np.cos(turn), np.sin(turn)
        R_cam = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        shift = centre - R_cam @ centre
        x = xyz @ R_cam.T + shift
        xy = x[..., :2] / x[..., 2:] * FOCAL_PX + K[:2, 2]
        xy = xy + rng.normal(0, noise_px, xy.shape)
        R.append(R_cam)
        t.append(shift)
        observations.append(Observation(xy, np.ones(xy.shape[:2]), K, 30.0, noise_share=0.01))
    return Made(body, state, np.stack(R), np.stack(t), observations)


def filmed(
    given: Made | Scene, state: MotionState, rng: np.random.Generator | None = None
) -> list[Observation]:
    """The observations with the keypoints of motions in their cameras' axes; rng: of noise."""
    xyz = given.body.positions(given.body.keypoints, state).numpy()
    xy = xyz[..., :2] / xyz[..., 2:] * FOCAL_PX + K[:2, 2]
    xy = xy if rng is None else xy + rng.normal(0, 1.0, xy.shape)
    return [replace(o, xy_px=x) for o, x in zip(given.observations, xy, strict=True)]


def result_at(state: MotionState, cameras: Cameras) -> JointMotion:
    """A result with these motions and cameras and nothing else."""
    return JointMotion(state, cameras, None, None, [], "made", 0.0)


def mpjpe_mm(body: Body, found: MotionState, truth: MotionState) -> float:
    """Root-relative mean joint error of two batches, millimetres."""
    a, b = (body.positions(body.joints, s) for s in (found, truth))
    a, b = a - a[:, :, :1], b - b[:, :, :1]
    return float(1000 * (a - b).norm(dim=-1).mean())
