"""npz, npy: 2D keypoints of one clip as plain arrays, for detectors without a file format.

RTMLib returns ``keypoints`` (P, K, 2) and ``scores`` (P, K) per frame and leaves saving to its
user. The file has them stacked over frames, (T, P, K, 2) and (T, P, K), with one person also
without P. ``keypoints`` (..., 3) contains the scores. ``frames`` (T,) are the frame numbers;
without it they count from 0. A person who is not in a frame is NaN, or has no score above 0.

An npy file is `keypoints` alone; without scores every finite point counts as certain. FreeMoCap's
2D data is of this kind, (cameras, T, points, 2) with MediaPipe's 33 body points first: of several
cameras each video needs its own part.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.people import LAYOUT_OF_COUNT, DetectedPeople, cleaned, detections
from imocap_core.io.npz import load_arrays, numbers

OF_MEDIAPIPE = ("mediapipe33", "blazepose33")
WITH_HANDS = 75  # points: MediaPipe's body and two hands, or more


def read_keypoints_npz(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got."""
    arrays = load_arrays(path)
    if path.suffix.lower() == ".npy":
        arrays = _of_npy(arrays["keypoints"], layout, path)
    one_person = "keypoints" in arrays and arrays["keypoints"].ndim == 3
    dims = ("T", "K") if one_person else ("T", "P", "K")
    table = numbers(arrays, "keypoints", (*dims, "2 or 3"), path)
    count, got = len(layout_names(layout)), table.shape[-2]
    if got != count:
        fitting = LAYOUT_OF_COUNT.get(got)
        advice = f"set layout: {fitting}" if fitting else "check `layout`"
        raise ValueError(
            f"{path}: keypoints: expected the {count} points of {layout}, got {got}; {advice} in "
            "action.yaml"
        )
    if table.shape[-1] == 2:
        scores = numbers(arrays, "scores", table.shape[:-1], path)
        table = np.concatenate([table, scores[..., None]], axis=-1)
    if table.shape[-1] != 3:
        raise ValueError(
            f"{path}: keypoints: expected x, y and optionally a score of every point, got "
            f"{table.shape[-1]} numbers"
        )
    frames = np.arange(len(table))
    if "frames" in arrays:
        frames = numbers(arrays, "frames", (len(table),), path).astype(np.int64)
    if len(set(frames.tolist())) < len(frames) or (len(frames) and frames.min() < 0):
        raise ValueError(f"{path}: frames: expected different numbers from 0, got {frames}")
    people = cleaned(table if not one_person else table[:, None])
    present = {int(n): _present(in_frame) for n, in_frame in zip(frames, people, strict=True)}
    return detections(present, layout, path)


def _of_npy(
    table: Shaped[np.ndarray, "..."], layout: str, path: Path
) -> dict[str, Shaped[np.ndarray, "..."]]:
    """The arrays of an npz for those of an npy: (T, K, 2 or 3), FreeMoCap's of one camera."""
    if table.ndim == 4 and len(table) == 1 and layout in OF_MEDIAPIPE:
        table = table[0]
    if table.ndim == 4 and table.shape[2] >= WITH_HANDS and layout in OF_MEDIAPIPE:
        raise ValueError(
            f"{path}: expected the points of one camera, got those of {len(table)} (FreeMoCap's "
            f"2D data); save each camera's own: numpy.save('v1.npy', numpy.load(FILE)[0])"
        )
    if table.dtype.kind not in "fiu" or table.ndim not in (3, 4):
        raise ValueError(
            f"{path}: expected an array (frames, points, 2 or 3), got {table.dtype} {table.shape}"
        )
    if layout in OF_MEDIAPIPE and table.ndim == 3:
        table = table[:, :33, :2]
    if table.shape[-1] == 2:
        return {"keypoints": table, "scores": np.isfinite(table).all(axis=-1).astype(float)}
    return {"keypoints": table}


def _present(people: Float[np.ndarray, "P K 3"]) -> list[Float[np.ndarray, "K 3"]]:
    """The people of one frame who have a point."""
    return [person for person in people if (person[:, 2] > 0).any()]
