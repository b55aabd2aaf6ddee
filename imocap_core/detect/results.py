"""Detectors' answers as arrays, in the formats that imocap_core/io/detectors reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

Arrays = dict[str, Float[np.ndarray, "..."] | Int[np.ndarray, "..."]]
WIDTH = {"pose_landmarks": (33, 4), "pose_world_landmarks": (33, 4)}
HAND = (21, 3)


def landmark_arrays(answers: Sequence[Mapping[str, Any]]) -> Arrays:
    """MediaPipe's answers, one a frame, by name: (T, 33, 4) and, for hands, (T, 21, 3); NaN where a
    frame has no person or hand. `frames` (T,) counts them."""
    names = answers[0] if answers else WIDTH
    arrays: Arrays = {"frames": np.arange(len(answers))}
    for name in names:
        rows = np.full((len(answers), *WIDTH.get(name, HAND)), np.nan)
        for t, answer in enumerate(answers):
            if answer[name] is not None:
                rows[t] = answer[name]
        arrays[name] = rows
    return arrays


def everybody_arrays(answers: Sequence[Mapping[str, Any]]) -> Arrays:
    """BlazePose's answers as MediaPipe's for several people: (T, P, 33, 4) by name; P is the
    largest number of people in a frame; NaN where a frame has fewer. `frames` (T,) counts them.

    An answer has `people`, and people who were overlooked `ago` frames earlier.
    """
    people: list[list[Mapping[str, Any]]] = [list(answer["people"]) for answer in answers]
    for t, answer in enumerate(answers):
        for person in answer["earlier"]:
            people[t - person["ago"]].append(person)
    most = max((len(in_frame) for in_frame in people), default=0)
    arrays: Arrays = {"frames": np.arange(len(answers))}
    for name, shape in WIDTH.items():
        arrays[name] = np.full((len(people), max(most, 1), *shape), np.nan)
        for t, in_frame in enumerate(people):
            for p, person in enumerate(in_frame):
                arrays[name][t, p] = person[name]
    return arrays


def people_arrays(answers: Sequence[Mapping[str, Any]]) -> Arrays:
    """RTMPose's answers: `keypoints` (T, P, K, 2) pixels and `scores` (T, P, K); P is the largest
    number of people in a frame; NaN and 0 where a frame has fewer. `frames` (T,) counts them."""
    most = max((len(answer["scores"]) for answer in answers), default=0)
    points = max((len(p) for answer in answers for p in answer["scores"]), default=1)
    keypoints = np.full((len(answers), max(most, 1), points, 2), np.nan)
    scores = np.zeros(keypoints.shape[:3])
    for t, answer in enumerate(answers):
        for p, (xy, score) in enumerate(zip(answer["keypoints"], answer["scores"], strict=True)):
            keypoints[t, p], scores[t, p] = xy, score
    return {"frames": np.arange(len(answers)), "keypoints": keypoints, "scores": scores}


def frames_with_people(arrays: Arrays) -> int:
    """The number of frames with at least one person."""
    points = arrays["pose_landmarks"] if "pose_landmarks" in arrays else arrays["keypoints"]
    return int(np.isfinite(points).reshape(len(points), -1).any(axis=1).sum())
