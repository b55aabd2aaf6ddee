"""What the detectors' answers become: arrays in the forms that imocap_core/formats reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
WIDTH = {"pose_landmarks": (33, 4), "pose_world_landmarks": (33, 4)}
HAND = (21, 3)


def landmarks_of(answers: Sequence[Mapping[str, Any]]) -> Arrays:
    """MediaPipe's answers, one a frame: arrays (T, 33, 4) and, with hands, (T, 21, 3) of their
    names; NaN where a frame has none."""
    names = answers[0] if answers else WIDTH
    found: Arrays = {"frames": np.arange(len(answers))}
    for name in names:
        rows = np.full((len(answers), *WIDTH.get(name, HAND)), np.nan)
        for t, answer in enumerate(answers):
            if answer[name] is not None:
                rows[t] = answer[name]
        found[name] = rows
    return found


def people_of(answers: Sequence[Mapping[str, Any]]) -> Arrays:
    """RTMPose's answers: `keypoints` (T, P, K, 2) pixels and `scores` (T, P, K), P as many as there
    are at most; NaN and 0 where a frame has fewer."""
    most = max((len(answer["scores"]) for answer in answers), default=0)
    points = max((len(p) for answer in answers for p in answer["scores"]), default=1)
    keypoints = np.full((len(answers), max(most, 1), points, 2), np.nan)
    scores = np.zeros(keypoints.shape[:3])
    for t, answer in enumerate(answers):
        for p, (xy, score) in enumerate(zip(answer["keypoints"], answer["scores"], strict=True)):
            keypoints[t, p], scores[t, p] = xy, score
    return {"frames": np.arange(len(answers)), "keypoints": keypoints, "scores": scores}


def somebody(arrays: Arrays) -> int:
    """In how many frames anybody was found."""
    seen = arrays["pose_landmarks"] if "pose_landmarks" in arrays else arrays["keypoints"]
    return int(np.isfinite(seen).reshape(len(seen), -1).any(axis=1).sum())
