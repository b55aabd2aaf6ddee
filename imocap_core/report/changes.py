"""What has changed since the last run of an action: videos, motion, expected error."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.store import Stored
from imocap_core.errors import ImocapError
from imocap_core.pipeline.generation import LAST_RUN
from imocap_core.pipeline.runner import Job
from imocap_core.result.artifacts import artifacts_of_stages
from imocap_core.result.read import read_result
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult


def last_result(job: Job, stored: Mapping[str, Stored]) -> ActionResult | None:
    """The result of the last recorded run, from the cache; None where that is this result, or the
    cache no longer has it."""
    store, name = job.store, job.action.name
    try:
        record = json.loads((store.folder / name / LAST_RUN).read_text(encoding="utf-8"))
        keys = {entry["stage"]: str(entry["key"]) for entry in record["stages"]}
        digests = {entry["stage"]: entry["digest"] for entry in record["stages"]}
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    if digests.get("refine_sync") == stored["refine_sync"].digest:
        return None
    cached = {s: store.find(name, s, keys[s]) for s in stored if keys.get(s, "").isalnum()}
    results = {stage: result for stage, result in cached.items() if result}
    try:
        return read_result(artifacts_of_stages(name, results), ActionResult)
    except ImocapError:
        return None


def compared(before: ActionResult | None, after: ActionResult) -> str:
    """A sentence on what a change was worth: the videos that came and went, how far the motion of
    the others has moved, and the expected errors."""
    was = after.ids if before is None else before.ids
    changes = [f"+{i}" for i in after.ids if i not in was]
    changes += [f"-{i}" for i in was if i not in after.ids]
    named = f" ({' '.join(changes)})" if changes else ""
    parts = [f"{len(after.ids)} video{'s' * (len(after.ids) != 1)}{named}"]
    moved, errors = moved_mm(before, after), [expected_error_mm(r) for r in (before, after)]
    if moved is not None:
        parts.append(f"the motion of {'the others' if changes else 'all'} moved by {moved:.0f} mm")
    if errors[1] is not None:
        then = "" if errors[0] is None else f" ({errors[0]:.0f} before)"
        parts.append(f"expected error {errors[1]:.0f} mm{then}")
    return "; ".join(parts) + "."


def moved_mm(before: ActionResult | None, after: ActionResult) -> float | None:
    """Mean distance of root-relative joints of the videos in both results, in camera axes."""
    if before is None:
        return None
    distances = []
    for video in after:
        if video.id not in before.ids or before[video.id].joints.shape != video.joints.shape:
            continue
        joints_m = [_in_camera(each) for each in (before[video.id], video)]
        distances.append(np.linalg.norm(joints_m[0] - joints_m[1], axis=-1).mean())
    return 1000 * float(np.mean(distances)) if distances else None


def _in_camera(video: VideoResult) -> Float[np.ndarray, "T J 3"]:
    relative = video.joints - video.joints[:, :1]
    return np.asarray(np.einsum("tij,tkj->tki", video.camera.R_per_frame, relative))


def expected_error_mm(result: ActionResult | None) -> float | None:
    """Mean standard deviation of all joints; None before the stage uncertainty has run."""
    videos = () if result is None else result
    sds = [video.uncertainty for video in videos if video.uncertainty is not None]
    return float(np.mean([np.nanmean(sd) for sd in sds])) if sds else None
