"""Training motions retargeted to the free body: joint rotations and root paths.

Captured joints do not include faces and feet, and belong to one skeleton. Brought once onto the
free body (as in tools/make_pose_prior.py), the motions apply to bodies of any shape.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from make_pose_prior import FittedClip, fit_clips, in_a_mirror


def fit_all(train: Path, cache: Path) -> dict[str, FittedClip]:
    """Every clip of the training file, fitted; `cache` (npz) is read when it exists."""
    if not cache.exists():
        with np.load(train) as stored:
            names, parents = [str(n) for n in stored["names"]], stored["parents"].tolist()
            keys = [k for k in stored.files if k.startswith("clip_") and k != "clip_ids"]
            clips = {k: stored[k].astype(float) for k in keys}
        fitted_clips = dict(zip(keys, fit_clips([*clips.values()], names, parents), strict=True))
        flat = {f"{k}/{part}": x for k, clip in fitted_clips.items()
                for part, x in zip(("theta", "trans"), clip, strict=True)}  # fmt: skip
        np.savez(cache, **flat)
    with np.load(cache) as stored:
        ids = sorted({k.split("/")[0] for k in stored.files})
        return {k: (stored[f"{k}/theta"], stored[f"{k}/trans"]) for k in ids}


def mirrored_clip(clip: FittedClip) -> FittedClip:
    """The mirror image of a motion (in the world's x), left and right swapped."""
    theta, trans = clip
    return in_a_mirror(theta), trans * np.array([-1.0, 1.0, 1.0])
