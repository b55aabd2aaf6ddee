"""Training motions as the free body performs them: rotations, paths and nothing else.

Captured joints say nothing of faces and feet, and belong to one skeleton. Fitted once with the free
body (as tools/make_pose_prior.py does) the motions can be performed by bodies of any shape.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from make_pose_prior import CHUNK, CORRESPONDENCE, mirrored, rest_prior

from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.solver import gauss_newton
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import (
    HingeLimits,
    JointEvidence,
    PathSmoothness,
    PosePriorTerm,
    PoseSmoothness,
    ShapePrior,
)
from imocap_core.rotations import log

BATCH = 24  # pieces fitted side by side
Clip = tuple[np.ndarray, np.ndarray]  # theta (T, 24, 3) axis-angle, trans (T, 3) metres; z up


def fit_all(train: Path, kept: Path) -> dict[str, Clip]:
    """Every clip of the training file, fitted; `kept` (npz) is read when it is there."""
    if not kept.exists():
        with np.load(train) as stored:
            names = [str(n) for n in stored["names"]]
            keys = [k for k in stored.files if k.startswith("clip_") and k != "clip_ids"]
            clips = {k: stored[k].astype(float) for k in keys}
        found = _fit(clips, names)
        flat = {f"{k}/{part}": x for k, clip in found.items()
                for part, x in zip(("theta", "trans"), clip, strict=True)}  # fmt: skip
        np.savez(kept, **flat)
    with np.load(kept) as stored:
        ids = sorted({k.split("/")[0] for k in stored.files})
        return {k: (stored[f"{k}/theta"], stored[f"{k}/trans"]) for k in ids}


def in_a_mirror(clip: Clip) -> Clip:
    """The same motion with left and right exchanged (mirrored in the world's x)."""
    theta, trans = clip
    root = theta[:, :1] * np.array([1.0, -1.0, -1.0])
    return np.concatenate([root, mirrored(theta[:, 1:])], 1), trans * np.array([-1.0, 1.0, 1.0])


def _fit(clips: dict[str, np.ndarray], names: list[str]) -> dict[str, Clip]:
    body = Body.of(load_free_body(), "smpl24")
    pieces = [(k, c[s : s + CHUNK]) for k, c in clips.items() for s in range(0, len(c), CHUNK)]
    parts: dict[str, list[Clip]] = {k: [] for k in clips}
    for first in range(0, len(pieces), BATCH):
        batch = pieces[first : first + BATCH]
        fitted = _fit_batch(body, [c for _, c in batch], names)
        for (key, _), clip in zip(batch, fitted, strict=True):
            parts[key].append(clip)
        print(f"fitted {first + len(batch)} of {len(pieces)} pieces", flush=True)
    return {
        k: (np.concatenate([t for t, _ in own]), np.concatenate([p for _, p in own]))
        for k, own in parts.items()
    }


def _fit_batch(body: Body, batch: list[np.ndarray], names: list[str]) -> list[Clip]:
    longest = max(len(c) for c in batch)
    joints = torch.zeros(len(batch), longest, 24, 3, dtype=torch.float64)
    weight = torch.zeros(len(batch), longest, 24, dtype=torch.float64)
    valid = torch.zeros(len(batch), longest, dtype=torch.bool)
    trans = torch.zeros(len(batch), longest, 3, dtype=torch.float64)
    for row, clip in enumerate(batch):
        valid[row, : len(clip)] = True
        trans[row, : len(clip)] = torch.as_tensor(clip[:, names.index("hip")])
        for smpl, (captured, sigma) in CORRESPONDENCE.items():
            k = SMPL_JOINTS.index(smpl)
            joints[row, : len(clip), k] = torch.as_tensor(clip[:, names.index(captured)])
            weight[row, : len(clip), k] = sigma**-2
    eye = torch.eye(3, dtype=torch.float64).expand(len(batch), longest, 24, 3, 3).contiguous()
    state = MotionState.of(eye, trans, trans.new_zeros(len(batch), 10), valid)
    ones = torch.ones(24, dtype=torch.float64)
    evidence = JointEvidence(body, joints, weight, 10.0)
    terms = [
        evidence,
        PosePriorTerm(rest_prior(), 0.05),
        ShapePrior(1.0),
        HingeLimits(100.0),
        PoseSmoothness(10.0 * ones, 0.0 * ones, 1.0),
        PathSmoothness(1.0, 0.0),
    ]
    solution = gauss_newton(terms, state, max_steps=20, relative_tolerance=3e-3)
    xyz = body.positions(body.joints, solution.state).xyz
    seen = weight > 5000
    missed = evidence.residual(xyz).norm(dim=-1)[seen].mean()
    print(f"  limb joints missed by {1000 * missed:.1f} mm")
    theta = log(solution.state.R_local).numpy()
    path = solution.state.trans.numpy()
    return [(theta[row, : len(c)], path[row, : len(c)]) for row, c in enumerate(batch)]
