"""Fit the pose prior to real motion: ``python tools/make_pose_prior.py DATA/train/cmu_train.npz``.

Every clip is brought onto the free body by the orientations of its segments
(`imocap_core.synthetic.retargeting`), mirrored to double the data, and described by a Gaussian
mixture with shrunk covariances. Only the mixture's moments and the per-joint speeds are stored, no
motion. The motions are the Carnegie Mellon University motion capture database's (mocap.cs.cmu.edu,
NSF EIA-0196217).
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.special import logsumexp

from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.process import configure_process
from imocap_core.rotations import exp, log
from imocap_core.synthetic.captured_stance import captured_skeleton, neutral_stance
from imocap_core.synthetic.retargeting import fit_to_trunk_and_joints, trunk_and_joints

TARGET = Path(__file__).parents[1] / "imocap_core" / "motion" / "data" / "pose_prior.npz"
COMPONENTS = 12
RESTARTS = 10  # of expectation maximisation, whose optima are local: the likeliest is kept
FLOOR_RAD = 0.08  # spread added to every direction of every component
# One performer's skeleton was captured, and people's trunks differ: standard deviations of lumbar
# lordosis and thoracic kyphosis among adults are 9.5 and 10.1 degrees (Boulay et al., Eur. Spine J.
# 15:415-422, 2006). Added to the trunk's joints in every component.
# The number itself was chosen where `imocap benchmark trials` is no worse; the source, quoted from
# memory, says only that its size is plausible.
POSTURE_RAD = 0.2
TRUNK = ("spine1", "spine2", "spine3", "neck", "left_collar", "right_collar")
# Few training clips raise an arm, and none throws or strikes: arms need room too. Chosen on
# performances of a serve, a walk and a backhand that no table has.
REACH_RAD = 0.3
ROOM_RAD = {
    **dict.fromkeys(TRUNK, POSTURE_RAD),
    **dict.fromkeys(("left_shoulder", "right_shoulder"), REACH_RAD),
}
CHUNK = 60  # frames fitted as one motion
BATCH = 32  # motions fitted side by side
LONGEST = 180  # frames used of each clip
FittedClip = tuple[np.ndarray, np.ndarray]  # theta (T, 24, 3) axis-angle, trans (T, 3) metres; z up


def fit_clips(
    clips: Sequence[np.ndarray], names: Sequence[str], parents: Sequence[int]
) -> list[FittedClip]:
    """Every clip of captured joints (T, J, 3) of one skeleton, performed by the mean free body."""
    model = load_free_body()
    body, betas = Body.of(model, "smpl24"), torch.zeros(model.num_betas, dtype=torch.float64)
    shaped, skeleton = model.shape(betas), captured_skeleton(names, parents)
    stance = neutral_stance(skeleton, [clip[:LONGEST] for clip in clips])
    pieces = [
        (clip, trunk_and_joints(shaped, skeleton, stance, xyz[start : start + CHUNK]))
        for clip, xyz in enumerate(clips)
        for start in range(0, len(xyz), CHUNK)
    ]
    parts: list[list[FittedClip]] = [[] for _ in clips]
    for first in range(0, len(pieces), BATCH):
        batch = pieces[first : first + BATCH]
        state = fit_to_trunk_and_joints(body, [piece for _, piece in batch], betas)
        theta, trans = log(state.R_local).numpy(), state.trans.numpy()
        for row, (clip, piece) in enumerate(batch):
            frames = len(piece.joints)
            parts[clip].append((theta[row, :frames], trans[row, :frames]))
        print(f"fitted {min(first + BATCH, len(pieces))} of {len(pieces)} pieces", flush=True)
    return [(np.concatenate([p[0] for p in x]), np.concatenate([p[1] for p in x])) for x in parts]


def mirrored(theta: np.ndarray) -> np.ndarray:
    """The same articulations seen in a mirror, (T, 23, 3)."""
    swap = []
    for name in SMPL_JOINTS[1:]:
        side = {"left": "right", "right": "left"}.get(name.split("_")[0])
        other = f"{side}_{name.split('_', 1)[1]}" if side else name
        swap.append(SMPL_JOINTS.index(other) - 1)
    return theta[:, swap] * np.array([1.0, -1.0, -1.0])


def in_a_mirror(theta: np.ndarray) -> np.ndarray:
    """A whole motion (T, 24, 3) seen in a mirror."""
    return np.concatenate([theta[:, :1] * np.array([1.0, -1.0, -1.0]), mirrored(theta[:, 1:])], 1)


@dataclass(frozen=True)
class Mixture:
    """Means (C, D), covariances (C, D, D) and weights (C,) of Gaussians."""

    mean: np.ndarray
    covariance: np.ndarray
    weight: np.ndarray


def random_start(x: np.ndarray, components: int, rng: np.random.Generator) -> Mixture:
    """Components of equal weight and spread about k-means++ seeds."""
    means = x[rng.integers(len(x))][None]
    while len(means) < components:
        away = ((x[:, None] - means) ** 2).sum(-1).min(1)
        means = np.concatenate([means, x[rng.choice(len(x), p=away / away.sum())][None]])
    covariance = np.cov(x.T) + FLOOR_RAD**2 * np.eye(x.shape[1])
    weights = np.full(components, 1 / components)
    return Mixture(means, np.repeat(covariance[None], components, 0), weights)


def shipped_start() -> Mixture:
    """The packaged mixture, without the room for other people."""
    with np.load(TARGET) as stored:
        mean, covariance, weight = (
            stored[k].astype(float) for k in ("mean", "covariance", "weight")
        )
    return Mixture(mean, with_room(covariance, -1.0), weight / weight.sum())


def expectation_maximisation(x: np.ndarray, start: Mixture) -> tuple[float, Mixture]:
    """Mean log likelihood and mixture of poses (N, D), from a start."""
    floor = FLOOR_RAD**2 * np.eye(x.shape[1])
    means, covariances, weights = start.mean, start.covariance.copy(), start.weight
    components = len(weights)
    likelihood = -np.inf
    for _ in range(60):
        log_p = np.empty((len(x), components))
        for c in range(components):
            factor = np.linalg.cholesky(covariances[c])
            white = np.linalg.solve(factor, (x - means[c]).T)
            log_p[:, c] = np.log(weights[c]) - np.log(np.diag(factor)).sum() - (white**2).sum(0) / 2
        likelihood = float(logsumexp(log_p, axis=1).mean())
        share = np.exp(log_p - log_p.max(1, keepdims=True))
        share /= share.sum(1, keepdims=True)
        mass = share.sum(0) + 1e-9
        means = (share.T @ x) / mass[:, None]
        weights = mass / mass.sum()
        for c in range(components):
            centred = x - means[c]
            covariances[c] = (share[:, c, None] * centred).T @ centred / mass[c] + floor
    return likelihood, Mixture(means, covariances, weights)


def with_room(covariance: np.ndarray, sign: float = 1.0) -> np.ndarray:
    """Covariances (C, 69, 69) that leave room for other people's trunks and reaches; sign -1 takes
    it away."""
    wider = covariance.copy()
    for name, spread in ROOM_RAD.items():
        first = 3 * (SMPL_JOINTS.index(name) - 1)
        for row in range(first, first + 3):
            wider[:, row, row] += sign * spread**2
    return wider


def speeds(clips: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """RMS rotation per frame and chordal acceleration per frame^2 (24,) at 30 frames/s.

    The largest hundredth is left out (fits that lost a twist).
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
        usual = np.where(x <= np.quantile(x, 0.99, axis=0), x, np.nan)
        spreads.append(np.sqrt(np.nanmean(usual**2, axis=0)))
    return spreads[0], spreads[1]


def main() -> None:
    """Read the training clips, fit, write the prior."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    parser.add_argument(
        "--resume", action="store_true", help="start at the packaged mixture, not at random"
    )
    arguments = parser.parse_args()
    configure_process()
    with np.load(arguments.train) as stored:
        names, parents = [str(n) for n in stored["names"]], stored["parents"].tolist()
        keys = [k for k in stored.files if k.startswith("clip_") and k != "clip_ids"]
        clips = [stored[k][:LONGEST].astype(float) for k in keys]
    motions = [theta for theta, _ in fit_clips(clips, names, parents)]
    articulations = [theta[:, 1:] for theta in motions]
    both = articulations + [mirrored(a) for a in articulations]
    x = np.concatenate(both).reshape(-1, 69)[::2]
    if arguments.resume:
        starts = [shipped_start()]
    else:
        rngs = [np.random.default_rng(seed) for seed in range(RESTARTS)]
        starts = [random_start(x, COMPONENTS, rng) for rng in rngs]
    fits = [expectation_maximisation(x, start) for start in starts]
    print("mean log likelihoods:", *(f"{likelihood:.2f}" for likelihood, _ in fits))
    _, best = max(fits, key=lambda fit: fit[0])
    velocity, acceleration = speeds([*motions, *map(in_a_mirror, motions)])
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        TARGET,
        mean=best.mean.astype(np.float32),
        covariance=with_room(best.covariance).astype(np.float32),
        weight=best.weight.astype(np.float32),
        velocity_rad=velocity.astype(np.float32),
        acceleration_rad=acceleration.astype(np.float32),
    )
    print(f"{TARGET.name}: {COMPONENTS} components from {len(x)} poses; speeds {velocity.round(3)}")


if __name__ == "__main__":
    main()
