"""Training motions retargeted to the free body: joint rotations and root paths.

Captured joints do not include faces and feet, and belong to one skeleton. Fitted once with the free
body (as in tools/make_pose_prior.py), the motions apply to bodies of any shape.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from make_pose_prior import CHUNK, fitted, mirrored

from imocap_core.body import load_free_body
from imocap_core.motion.kinematics import Body
from imocap_core.rotations import log

BATCH = 24  # pieces fitted in one batch
FittedClip = tuple[np.ndarray, np.ndarray]  # theta (T, 24, 3) axis-angle, trans (T, 3) m; z up


def fit_all(train: Path, cache: Path) -> dict[str, FittedClip]:
    """Every clip of the training file, fitted; `cache` (npz) is read when it exists."""
    if not cache.exists():
        with np.load(train) as stored:
            names = [str(n) for n in stored["names"]]
            keys = [k for k in stored.files if k.startswith("clip_") and k != "clip_ids"]
            clips = {k: stored[k].astype(float) for k in keys}
        fitted_clips = _fit(clips, names)
        flat = {f"{k}/{part}": x for k, clip in fitted_clips.items()
                for part, x in zip(("theta", "trans"), clip, strict=True)}  # fmt: skip
        np.savez(cache, **flat)
    with np.load(cache) as stored:
        ids = sorted({k.split("/")[0] for k in stored.files})
        return {k: (stored[f"{k}/theta"], stored[f"{k}/trans"]) for k in ids}


def mirrored_clip(clip: FittedClip) -> FittedClip:
    """The mirror image of a motion (in the world's x), left and right swapped."""
    theta, trans = clip
    root = theta[:, :1] * np.array([1.0, -1.0, -1.0])
    return np.concatenate([root, mirrored(theta[:, 1:])], 1), trans * np.array([-1.0, 1.0, 1.0])


def _fit(clips: dict[str, np.ndarray], names: list[str]) -> dict[str, FittedClip]:
    body = Body.of(load_free_body(), "smpl24")
    pieces = [(k, c[s : s + CHUNK]) for k, c in clips.items() for s in range(0, len(c), CHUNK)]
    parts: dict[str, list[FittedClip]] = {k: [] for k in clips}
    for first in range(0, len(pieces), BATCH):
        batch = pieces[first : first + BATCH]
        fitted_pieces = _fit_batch(body, [c for _, c in batch], names)
        for (key, _), piece in zip(batch, fitted_pieces, strict=True):
            parts[key].append(piece)
        print(f"fitted {first + len(batch)} of {len(pieces)} pieces", flush=True)
    return {
        k: (np.concatenate([t for t, _ in of_clip]), np.concatenate([p for _, p in of_clip]))
        for k, of_clip in parts.items()
    }


def _fit_batch(body: Body, batch: list[np.ndarray], names: list[str]) -> list[FittedClip]:
    """Rotations and paths of the free body on clips of captured joints (T, J, 3)."""
    trans = torch.zeros(len(batch), max(map(len, batch)), 3, dtype=torch.float64)
    for row, clip in enumerate(batch):
        trans[row, : len(clip)] = torch.as_tensor(clip[:, names.index("hip")])
    state = fitted(body, batch, names, trans)
    theta, path = log(state.R_local).numpy(), state.trans.numpy()
    return [(theta[row, : len(c)], path[row, : len(c)]) for row, c in enumerate(batch)]
