"""From artifacts to the viewer's data: one level world, one time axis, every video on both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Hands,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SyncSummary,
)
from imocap_core.body import Model
from imocap_core.camera.world import (
    BodyMotion,
    Extrinsics,
    GroundAlignment,
    find_ground_alignment,
    to_world,
)
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.viewer.block import Block
from imocap_core.viewer.body import (
    Take,
    answer_entry,
    model_entry,
    shape_entry,
    take_of,
)
from imocap_core.viewer.pictures import picture_entry, stride
from imocap_core.viewer.pictures import windows as windows_of
from imocap_core.viewer.video import (
    camera_entry,
    detected_entry,
    identity_entry,
    skeleton_entry,
    timeline_entry,
)

Array = NDArray[np.float64]

FEET = [SMPL_JOINTS.index(name) for name in ("left_foot", "right_foot")]
LEGEND = "grid 0.5 m · paths run from pale to full · body: "
ASIDE_RAD = 0.45  # the first look comes from this far beside the reference camera
ABOUT_BODY_M = 0.25  # from the outermost joints to the outermost skin


@dataclass(frozen=True)
class Artifacts:
    """What the viewer shows; hands is None where the action has none."""

    keypoints: Keypoints
    camera_motion: CameraMotion
    initial: InitialSmpl
    refined: RefineSync
    hands: Hands | None


class _Shapes:
    """The rest surfaces in use, each once."""

    def __init__(self, block: Block, model: Model) -> None:
        self._block, self._model = block, model
        self._known: dict[bytes, int] = {}
        self.entries: list[dict[str, Any]] = []

    def index(self, betas: Array) -> int:
        """Where the surface of these coefficients stands among the entries."""
        if betas.tobytes() not in self._known:
            self._known[betas.tobytes()] = len(self.entries)
            self.entries.append(shape_entry(self._block, self._model, betas))
        return self._known[betas.tobytes()]


def scene(
    made: Artifacts,
    model: Model,
    name: str,
    files: Mapping[str, Path],
    block: Block,
    progress: Callable[[float, str], None] = lambda share, what: None,
) -> dict[str, Any]:
    """The header; arrays go into `block`.

    Args:
        model: the body, with fingers (52 joints) when `made` has hands.
        name: of the action. files: the video files that are there, by video id.

    ValueError when a file is no readable video.
    """
    sync, seen = made.refined.sync, made.keypoints.videos
    level = _level(made)
    shapes = _Shapes(block, model)
    fingers = len(model.parents) > len(SMPL_JOINTS)
    windows = windows_of([v.person_box_px for v in seen], [v.size for v in seen])
    every = stride([len(v.frames) for v in seen if v.id in files])
    videos, finals = [], []
    for i, (own, part) in enumerate(zip(seen, windows, strict=True)):
        progress(i / len(seen), own.id)
        takes = _takes(made, i, level, fingers)
        finals.append(takes["final"])
        answers = {
            kind: {"shape": shapes.index(take.betas), **answer_entry(block, take)}
            for kind, take in takes.items()
        }
        file = files.get(own.id)
        shown = None if file is None else picture_entry(block, file, own.frames, every, part)
        said = {"answers": answers, "view": list(part), "pictures": shown}
        videos.append({**_seen_entry(block, made, i, level), **said})
    return {
        "title": name,
        "lead": _lead(sync),
        "legend": LEGEND + model.name.replace("_", " "),
        "reference": sync.reference,
        "timeline": timeline_entry(made.keypoints, sync),
        "model": model_entry(block, model),
        "shapes": shapes.entries,
        "videos": videos,
        **_eye(finals, [v["camera"]["centre"] for v in videos], sync),
    }


def _takes(made: Artifacts, i: int, level: GroundAlignment, fingers: bool) -> dict[str, Take]:
    """What video i alone says, and the final answer, both by the final camera."""
    final, camera = made.refined.motion.videos[i], made.refined.motion.cameras[i]
    hands = made.hands.videos if made.hands is not None else []
    found = next((h for h in hands if h.id == final.id), None)
    pose = Extrinsics(camera.R, camera.t)
    return {
        "initial": take_of(made.initial.videos[i], pose, level, None, fingers),
        "final": take_of(final, pose, level, found, fingers),
    }


def _seen_entry(block: Block, made: Artifacts, i: int, level: GroundAlignment) -> dict[str, Any]:
    """Video i apart from its bodies and pictures."""
    own, turned = made.keypoints.videos[i], made.camera_motion.videos[i]
    final, camera = made.refined.motion.videos[i], made.refined.motion.cameras[i]
    first = made.initial.videos[i]
    return {
        **identity_entry(block, made.keypoints, i, made.refined.sync),
        "camera": camera_entry(block, camera, turned, level),
        "detected": detected_entry(block, own),
        "projected": {
            "initial": skeleton_entry(block, first.joints, turned, turned.K, own.size),
            "final": skeleton_entry(block, final.joints, turned, camera.K, own.size),
        },
    }


def _level(made: Artifacts) -> GroundAlignment:
    """The ground under all final performances, y up."""
    motion = made.refined.motion
    placed = [
        to_world(BodyMotion(v.theta, v.trans, v.joints), Extrinsics(camera.R, camera.t))
        for v, camera in zip(motion.videos, motion.cameras, strict=True)
        if v.id not in made.refined.sync.excluded
    ]
    return find_ground_alignment(
        [m.joints[:, FEET] for m in placed], [m.joints[:, 0] for m in placed], "y"
    )


def _eye(takes: list[Take], centres: list[list[float]], sync: SyncSummary) -> dict[str, Any]:
    """Where to look first, and how far each performer reaches."""
    bounds = [_box(take.joints.reshape(-1, 3)) for take in takes]
    kept = [b for b, video in zip(bounds, sync.ids, strict=True) if video not in sync.excluded]
    middle = np.mean([np.mean(b, axis=0) for b in kept], axis=0)
    toward = np.array(centres[sync.ids.index(sync.reference)]) - middle
    azimuth = float(np.arctan2(toward[0], toward[2]))
    return {
        "bounds": bounds,
        "middle": middle.tolist(),
        "azimuth": azimuth + ASIDE_RAD,
        "right": [float(np.cos(azimuth)), 0.0, float(-np.sin(azimuth))],
    }


def _box(points: Array) -> list[list[float]]:
    """The eight corners of a box about a performer that stands on the ground."""
    low, high = points.min(axis=0) - ABOUT_BODY_M, points.max(axis=0) + ABOUT_BODY_M
    low[1] = max(low[1], 0.0)
    ends = np.array([low, high])
    return [ends[list(corner), [0, 1, 2]].tolist() for corner in product((0, 1), repeat=3)]


def _lead(sync: SyncSummary) -> str:
    count = len(sync.ids)
    return "1 video" if count == 1 else f"{count} videos on the time axis of {sync.reference}"
