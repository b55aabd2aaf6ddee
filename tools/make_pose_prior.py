"""Fit the pose prior to real motion: ``python tools/make_pose_prior.py DATA/train/cmu_train.npz``.

Every clip's joints are fitted with the free body (bone lengths by its shape, limb twist regularised
towards rest), mirrored to double the data, and modelled by a Gaussian mixture with shrunk
covariances. Only its moments and the per-joint speeds are stored, no motion. The motions are the
Carnegie Mellon University motion capture database's (mocap.cs.cmu.edu, NSF EIA-0196217).
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.prior import PosePrior, mixture
from imocap_core.motion.solver.gauss_newton import gauss_newton
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import (
    HingeLimits,
    JointEvidence,
    PathSmoothness,
    PosePriorTerm,
    PoseSmoothness,
    ShapePrior,
    Term,
)
from imocap_core.rotations import exp, log

TARGET = Path(__file__).parents[1] / "imocap_core" / "motion" / "data" / "pose_prior.npz"
# SMPL joint -> (captured joint, standard deviation of their distance in metres)
CORRESPONDENCE = {
    "left_hip": ("lThigh", 0.02),
    "right_hip": ("rThigh", 0.02),
    "left_knee": ("lShin", 0.01),
    "right_knee": ("rShin", 0.01),
    "left_ankle": ("lFoot", 0.01),
    "right_ankle": ("rFoot", 0.01),
    "left_foot": ("lFoot_end", 0.04),
    "right_foot": ("rFoot_end", 0.04),
    "spine2": ("abdomen", 0.06),
    "neck": ("neck", 0.03),
    "head": ("head", 0.05),
    "left_shoulder": ("lShldr", 0.02),
    "right_shoulder": ("rShldr", 0.02),
    "left_elbow": ("lForeArm", 0.01),
    "right_elbow": ("rForeArm", 0.01),
    "left_wrist": ("lHand", 0.01),
    "right_wrist": ("rHand", 0.01),
    "left_hand": ("lMid1", 0.04),
    "right_hand": ("rMid1", 0.04),
}
COMPONENTS = 12
FLOOR_RAD = 0.08  # spread added to every direction of every component
CHUNK = 60  # frames fitted as one motion
BATCH = 32  # motions fitted side by side
LONGEST = 180  # frames used of each clip


def rest_prior() -> PosePrior:
    """A wide Gaussian about the rest pose: determines what joint positions do not (twists)."""
    spread = np.full(69, 0.8)
    for name in ("left_ankle", "right_ankle", "left_foot", "right_foot", "left_hand", "right_hand"):
        first = 3 * (SMPL_JOINTS.index(name) - 1)
        spread[first : first + 3] = 0.3
    ones = np.ones(24)
    return mixture(np.zeros((1, 69)), np.diag(spread**2)[None], np.ones(1), ones, ones)


def fit_clips(clips: list[np.ndarray], names: list[str]) -> list[np.ndarray]:
    """Articulation (T, 23, 3) axis-angle of each clip of captured joints (T, 27, 3)."""
    model = load_free_body()
    body = Body.of(model, "smpl24")
    pieces = [c[s : s + CHUNK] for c in clips for s in range(0, len(c), CHUNK)]
    owner = [i for i, c in enumerate(clips) for s in range(0, len(c), CHUNK)]
    fitted: list[list[np.ndarray]] = [[] for _ in clips]
    for first in range(0, len(pieces), BATCH):
        batch = pieces[first : first + BATCH]
        for index, theta in zip(
            owner[first : first + BATCH], fit_batch(body, batch, names), strict=True
        ):
            fitted[index].append(theta)
        print(f"fitted {min(first + BATCH, len(pieces))} of {len(pieces)} pieces", flush=True)
    return [np.concatenate(parts) for parts in fitted]


def fit_batch(body: Body, batch: list[np.ndarray], names: list[str]) -> list[np.ndarray]:
    """Articulation (T, 23, 3) of each clip of up to a few hundred frames."""
    longest = max(map(len, batch))
    state = fitted(body, batch, names, torch.zeros(len(batch), longest, 3, dtype=torch.float64))
    theta = log(state.R_local[:, :, 1:]).numpy()
    return [theta[row, : len(clip)] for row, clip in enumerate(batch)]


def fitted(
    body: Body, batch: list[np.ndarray], names: list[str], trans: torch.Tensor
) -> MotionState:
    """Gauss-Newton fits of the body to captured joints (T, 27, 3), from paths (B, T, 3)."""
    longest = trans.shape[1]
    joints = torch.zeros(len(batch), longest, 24, 3, dtype=torch.float64)
    weight = torch.zeros(len(batch), longest, 24, dtype=torch.float64)
    valid = torch.zeros(len(batch), longest, dtype=torch.bool)
    for row, clip in enumerate(batch):
        valid[row, : len(clip)] = True
        for smpl, (captured, sigma) in CORRESPONDENCE.items():
            k = SMPL_JOINTS.index(smpl)
            joints[row, : len(clip), k] = torch.as_tensor(clip[:, names.index(captured)]).double()
            weight[row, : len(clip), k] = sigma**-2
    eye = torch.eye(3, dtype=torch.float64).expand(len(batch), longest, 24, 3, 3).contiguous()
    state = MotionState.of(eye, trans, trans.new_zeros(len(batch), 10), valid)
    ones = torch.ones(24, dtype=torch.float64)
    evidence = JointEvidence(body, joints, weight, 10.0)
    terms: list[Term] = [
        evidence,
        PosePriorTerm(rest_prior(), 0.05),
        ShapePrior(1.0),
        HingeLimits(100.0),
        PoseSmoothness(10.0 * ones, 0.0 * ones, 1.0),
        PathSmoothness(1.0, 0.0),
    ]
    solution = gauss_newton(terms, state, max_steps=20, relative_tolerance=3e-3)
    xyz = body.positions(body.joints, solution.state).xyz
    residual = evidence.residual(xyz).norm(dim=-1) * (weight > 5000)
    missed_mm = 1000 * residual.sum() / (residual > 0).sum()
    print(f"  {solution.status}; limb joints missed by {missed_mm:.1f} mm")
    return solution.state


def mirrored(theta: np.ndarray) -> np.ndarray:
    """The mirror images of articulations, (T, 23, 3)."""
    swap = []
    for name in SMPL_JOINTS[1:]:
        side = {"left": "right", "right": "left"}.get(name.split("_")[0])
        other = f"{side}_{name.split('_', 1)[1]}" if side else name
        swap.append(SMPL_JOINTS.index(other) - 1)
    return theta[:, swap] * np.array([1.0, -1.0, -1.0])


def expectation_maximisation(
    x: np.ndarray, components: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means (C, D), covariances (C, D, D), weights (C,) of a mixture, from k-means++ seeds."""
    means = x[rng.integers(len(x))][None]
    while len(means) < components:
        away = ((x[:, None] - means) ** 2).sum(-1).min(1)
        means = np.concatenate([means, x[rng.choice(len(x), p=away / away.sum())][None]])
    floor = FLOOR_RAD**2 * np.eye(x.shape[1])
    covariances = np.repeat((np.cov(x.T) + floor)[None], components, 0)
    weights = np.full(components, 1 / components)
    for _ in range(60):
        log_p = np.empty((len(x), components))
        for c in range(components):
            factor = np.linalg.cholesky(covariances[c])
            white = np.linalg.solve(factor, (x - means[c]).T)
            log_p[:, c] = np.log(weights[c]) - np.log(np.diag(factor)).sum() - (white**2).sum(0) / 2
        share = np.exp(log_p - log_p.max(1, keepdims=True))
        share /= share.sum(1, keepdims=True)
        mass = share.sum(0) + 1e-9
        means = (share.T @ x) / mass[:, None]
        weights = mass / mass.sum()
        for c in range(components):
            centred = x - means[c]
            covariances[c] = (share[:, c, None] * centred).T @ centred / mass[c] + floor
    return means, covariances, weights


def speeds(clips: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """RMS rotation per frame and chordal acceleration per frame^2 (24,) at 30 frames/s.

    The largest 1 % is left out (fits with wrong twists); the root's is twice that of spine1.
    """
    first, second = [], []
    for clip in clips:
        R = exp(torch.as_tensor(clip))
        first.append(log(R[:-1].transpose(-1, -2) @ R[1:]).norm(dim=-1).numpy())
        chord = R[:-2] - 2 * R[1:-1] + R[2:]
        second.append(chord.flatten(-2).norm(dim=-1).numpy() / np.sqrt(2))
    spreads = []
    for pieces in (first, second):
        x = np.concatenate(pieces)
        trimmed = np.where(x <= np.quantile(x, 0.99, axis=0), x, np.nan)
        spread = np.sqrt(np.nanmean(trimmed**2, axis=0))
        spreads.append(np.concatenate([[2 * spread[SMPL_JOINTS.index("spine1") - 1]], spread]))
    return spreads[0], spreads[1]


def main() -> None:
    """Read the training clips, fit, write the prior."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    arguments = parser.parse_args()
    with np.load(arguments.train) as stored:
        names = [str(n) for n in stored["names"]]
        keys = [k for k in stored.files if k.startswith("clip_") and k != "clip_ids"]
        clips = [stored[k][:LONGEST].astype(float) for k in keys]
    articulations = fit_clips(clips, names)
    both = articulations + [mirrored(a) for a in articulations]
    x = np.concatenate(both).reshape(-1, 69)[::2]
    rng = np.random.default_rng(0)
    mean, covariance, weight = expectation_maximisation(x, COMPONENTS, rng)
    velocity, acceleration = speeds(both)
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        TARGET,
        mean=mean.astype(np.float32),
        covariance=covariance.astype(np.float32),
        weight=weight.astype(np.float32),
        velocity_rad=velocity.astype(np.float32),
        acceleration_rad=acceleration.astype(np.float32),
    )
    print(f"{TARGET.name}: {COMPONENTS} components from {len(x)} poses; speeds {velocity.round(3)}")


if __name__ == "__main__":
    main()
