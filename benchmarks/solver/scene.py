"""A synthetic action of any length, as the solver takes it, for measuring the solver's speed.

Poses are drawn from the pose prior and joined smoothly; every video shows another performance that
deviates from them, before another camera on a circle, with a detector's noise. Correspondences are
the true ones, frame to frame, and every start has a smooth error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from imocap_core.body import load_free_body
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body, MotionState
from imocap_core.params import FitParams
from imocap_core.rotations import exp

FPS = 30.0
LAYOUT = "body25"
K = np.array([[1000.0, 0, 500], [0, 1000.0, 500], [0, 0, 1]])
DISTANCE_M = 4.5
KEY_FRAMES = 20  # between two poses
NOISE_PX, NOISE_SHARE = 3.0, 0.01
DEVIATION_RAD, DEVIATION_M = 0.05, 0.05
ERROR_RAD, ERROR_M = 0.1, 0.1  # of the start
SMOOTH_FRAMES = 10.0


@dataclass(frozen=True)
class MadeScene:
    """The input of `recover_motion`."""

    scene: Scene
    start: MotionState


def made_scene(videos: int, frames: int, weights: FitParams, seed: int) -> MadeScene:
    """`videos` performances of one synthetic motion, `frames` frames each."""
    rng = np.random.default_rng([seed, videos, frames])
    body = Body.of(load_free_body(), LAYOUT)
    theta, path = _motion(frames, rng)
    observations, starts = [], []
    for turn_rad in 2 * np.pi * np.arange(videos) / videos:
        state = _performance(body, theta, path, float(turn_rad), rng)
        observations.append(_observed(body, state, rng))
        error = _smooth((frames, 75), rng) * np.array([ERROR_RAD] * 72 + [ERROR_M] * 3)
        starts.append(state.retract(torch.as_tensor(error)[None], torch.zeros_like(state.betas)))
    maps = [np.arange(frames, dtype=np.float64) for _ in range(videos)]
    confidence = [np.ones(frames) for _ in range(videos)]
    scene = Scene(
        body,
        load_pose_prior(),
        observations,
        make_timeline(maps, confidence, frames),
        confidence,
        0,
        weights,
    )
    parts = (torch.cat([getattr(s, name) for s in starts]) for name in ("R_local", "trans"))
    R_local, trans = parts
    valid = torch.ones(videos, frames, dtype=torch.bool)
    return MadeScene(scene, MotionState.of(R_local, trans, trans.new_zeros(videos, 10), valid))


def _motion(
    frames: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "T 24 3"], Float[np.ndarray, "T 3"]]:
    """Axis angles, upright and slowly turning in y-up axes, and the path of the root about the
    origin, metres."""
    keys = -(-frames // KEY_FRAMES) + 1
    poses = load_pose_prior().sample(keys, rng, spread=0.5)
    times = np.arange(frames) / KEY_FRAMES
    articulation = CubicSpline(np.arange(keys), poses)(times).reshape(frames, 23, 3)
    turn = np.zeros((frames, 1, 3))
    turn[:, 0, 1] = 0.5 * _smooth((frames, 1), rng)[:, 0]
    return np.concatenate([turn, articulation], axis=1), 0.2 * _smooth((frames, 3), rng)


def _performance(
    body: Body,
    theta: Float[np.ndarray, "T 24 3"],
    path: Float[np.ndarray, "T 3"],
    turn_rad: float,
    rng: np.random.Generator,
) -> MotionState:
    """One performance (batch of 1) in the axes of a camera at `turn_rad` on the circle."""
    frames = len(theta)
    R_local = exp(torch.as_tensor(theta + DEVIATION_RAD * _smooth((frames, 24, 3), rng)))
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    R_cam_from_world = np.diag([1.0, -1.0, -1.0]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    R_local[:, 0] = torch.as_tensor(R_cam_from_world) @ R_local[:, 0]
    root = (path + DEVIATION_M * _smooth((frames, 3), rng)) @ R_cam_from_world.T
    root = root + np.array([0.0, 0.0, DISTANCE_M])
    trans = torch.as_tensor(root) - body.model.joints_template[0]
    valid = torch.ones(1, frames, dtype=torch.bool)
    return MotionState.of(R_local[None], trans[None], trans.new_zeros(1, 10), valid)


def _observed(body: Body, state: MotionState, rng: np.random.Generator) -> Observation:
    """Keypoints of one performance with a detector's noise."""
    xyz = body.positions(body.keypoints, state)[0].numpy()
    xy = xyz[..., :2] / xyz[..., 2:] * K[0, 0] + K[:2, 2]
    xy = xy + rng.normal(0.0, NOISE_PX, xy.shape)
    return Observation(xy, np.ones(xy.shape[:2]), K, FPS, noise_share=NOISE_SHARE)


def _smooth(shape: tuple[int, ...], rng: np.random.Generator) -> Float[np.ndarray, "T ..."]:
    """Noise of unit variance along the first axis, smooth over about a third of a second."""
    noise = gaussian_filter1d(rng.normal(size=shape), SMOOTH_FRAMES, axis=0, mode="reflect")
    return noise * np.sqrt(2 * SMOOTH_FRAMES * np.sqrt(np.pi))
