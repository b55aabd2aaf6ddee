"""Fit the pose prior to real motion: ``python tools/make_pose_prior.py DATA/train/cmu_train.npz``.

Every clip is brought onto the free body by the orientations of its segments
(`benchmarks.synthetic.retargeting`), mirrored to double the data, and described by a Gaussian
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

from benchmarks.synthetic.captured_skeleton import captured_skeleton, neutral_stance
from benchmarks.synthetic.retargeting import fit_to_trunk_and_joints, trunk_and_joints
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.state import Body
from imocap_core.process import configure_process
from imocap_core.rotations import exp, log

TARGET = Path(__file__).parents[1] / "imocap_core" / "motion" / "data" / "pose_prior.npz"
# Components for legs that are: straight below a straight trunk, straight and folded, soft, deep
# (squat, seat), folded behind (kneeling, bridges), apart with the left or the right one up.
COMPONENTS = (10, 3, 6, 4, 3, 3, 3)
ITERATIONS, RESTARTS = 30, 4  # of k-means
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
MADE, MADE_FRAMES, MADE_HZ, SEED = 2000, 8, 3.0, 0  # performances, and frames of each
STEP = 6  # every so manieth captured frame
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


def legs_of(x: np.ndarray) -> np.ndarray:
    """(N,) index into `COMPONENTS` of poses (N, 69) by what their legs do."""
    theta = np.degrees(x).reshape(len(x), 23, 3)
    hips, knees = (
        sign * theta[:, [SMPL_JOINTS.index(f"{side}_{joint}") - 1 for side in ("left", "right")], 0]
        for joint, sign in (("hip", -1.0), ("knee", 1.0))
    )
    knee, hip = knees.max(1), hips.max(1)
    apart = (np.ptp(knees, 1) > 30) | (np.ptp(hips, 1) > 40)
    left_more = np.subtract(*(knees + hips).T) > 0
    apart &= knee > 12
    straight = (knee < 12) & (hip < 30)
    matches = [apart & left_more, apart, straight, knee < 35, knee < 65, hip < 50]
    return np.select(matches, [5, 6, 0, np.where(hip < 40, 2, 1), 2, 4], 3)


def sorted_out(x: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(N,) k-means clusters of poses (N, D), the best of some starts."""
    best, least = np.zeros(len(x), int), np.inf
    for _ in range(RESTARTS):
        means = x[rng.integers(len(x))][None]
        while len(means) < count:
            away = ((x[:, None] - means) ** 2).sum(-1).min(1)
            means = np.concatenate([means, x[rng.choice(len(x), p=away / away.sum())][None]])
        for _ in range(ITERATIONS):
            square = (means**2).sum(-1) - 2 * x @ means.T
            label = square.argmin(1)
            means = np.stack([
                x[label == c].mean(0) if (label == c).any() else means[c] for c in range(count)
            ])  # fmt: skip
        total = square.min(1).sum()
        if total < least:
            best, least = label, total
    return best


def mixture_of(x: np.ndarray, rng: np.random.Generator) -> Mixture:
    """Components by legs first, then by everything, since straight legs must not share one with
    bent ones, whose mean is neither."""
    means, covariances, weights = [], [], []
    floor, legs = FLOOR_RAD**2 * np.eye(x.shape[1]), legs_of(x)
    for kind, count in enumerate(COMPONENTS):
        poses = x[legs == kind]
        label = sorted_out(poses, count, rng)
        for c in range(count):
            part = poses[label == c]
            means.append(part.mean(0))
            covariances.append(np.cov(part.T) + floor)
            weights.append(len(part) / len(x))
    return Mixture(np.stack(means), np.stack(covariances), np.array(weights))


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
    """Make motions, read the captured ones, fit, write the prior."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    parser.add_argument("--work", type=Path, required=True, help="fitted motions, read if there")
    arguments = parser.parse_args()
    configure_process()
    from lifter.made_motions import performances  # both import this file's clips
    from lifter.motions import fit_all, with_straight_legs

    arguments.work.mkdir(parents=True, exist_ok=True)
    clips = [*fit_all(arguments.train, arguments.work / "motions.npz").values()]
    velocity, acceleration = speeds([m for theta, _ in clips for m in (theta, in_a_mirror(theta))])
    captured = np.concatenate([with_straight_legs(clip)[0][::STEP, 1:] for clip in clips])
    made = performances(MADE, SEED, MADE_FRAMES, MADE_HZ)
    poses = np.concatenate([p.theta[:, :, 1:].reshape(-1, 23, 3) for p in made.values()])
    both = np.concatenate([poses, captured, mirrored(captured)])
    x = both.reshape(-1, 69).astype(float)
    best = mixture_of(x, np.random.default_rng(SEED))
    np.savez_compressed(
        TARGET,
        mean=best.mean.astype(np.float32),
        covariance=with_room(best.covariance).astype(np.float32),
        weight=best.weight.astype(np.float32),
        velocity_rad=velocity.astype(np.float32),
        acceleration_rad=acceleration.astype(np.float32),
    )
    print(f"{TARGET.name}: {len(best.weight)} components from {len(x)} poses")


if __name__ == "__main__":
    main()
