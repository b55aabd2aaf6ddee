"""From a result to the viewer's data: one level world, one time axis, and the page."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.adapters.relative_motion import paths_of_initial, relative_motions
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    SyncSummary,
    Uncertainty,
    VideoMotion,
)
from imocap_core.artifacts.store import Store
from imocap_core.body import Model
from imocap_core.camera.projection import camera_from_world
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.diagnostics.findings import Finding
from imocap_core.errors import WorkFailed
from imocap_core.files import is_whole_page, write_whole
from imocap_core.result.artifacts import verdict_of_artifacts
from imocap_core.result.body import body_model
from imocap_core.result.read import read_monocular
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult
from imocap_core.result.video_motion import contact_frames
from imocap_core.viewer import html, viewer_video
from imocap_core.viewer import html as viewer
from imocap_core.viewer.viewer_video import windows as windows_of


def contact_spans(
    contacts: Mapping[str, Sequence[tuple[int, int]]], phase_s: Float[np.ndarray, " T"]
) -> dict[str, list[list[float]]]:
    """Contacts of each side from their first to their last frame, in seconds of the reference.

    phase_s: of every frame, never falling.
    """
    return {
        side: [[float(phase_s[first]), float(phase_s[last])] for first, last in spans]
        for side, spans in contacts.items()
    }


_LEGEND = "grid 0.5 m · paths start pale · "
_ASIDE_RAD = 0.45  # the view opens from this far beside the reference camera
_ABOUT_BODY_M = 0.25  # from the outermost joints to the outermost skin


class _Shapes:
    """The rest surfaces in use, each once."""

    def __init__(self, block: html.Block, model: Model) -> None:
        self._block, self._model = block, model
        self._index: dict[bytes, int] = {}
        self.entries: list[dict[str, Any]] = []

    def index(self, betas: Float[np.ndarray, " B"]) -> int:
        """The index of the surface of these coefficients among the entries."""
        if betas.tobytes() not in self._index:
            self._index[betas.tobytes()] = len(self.entries)
            shaped = self._model.shape(torch.as_tensor(betas))
            self.entries.append(html.shape_entry(self._block, shaped))
        return self._index[betas.tobytes()]


def scene(
    result: ActionResult,
    model: Model,
    block: html.Block,
    progress: Callable[[float, str], None] = lambda share, what: None,
    small: bool = False,
) -> dict[str, Any]:
    """The header; arrays go into `block`.

    Args:
        result: as it was read, in the reference camera's axes.
        model: the body, with fingers (52 joints) when the result has hands.
        small: fewer and smaller pictures.

    ValueError when a file is no readable video, WorkFailed when an artifact is missing.
    """
    keypoints, sync = result.artifacts.get(Keypoints), result.sync.summary
    alone = read_monocular(result.artifacts)
    level = result.levelled("y")
    shapes = _Shapes(block, model)
    fingers = len(model.parents) > len(SMPL_JOINTS)
    detected = keypoints.videos
    windows = windows_of([_straight_boxes(v) for v in result], [v.size for v in detected])
    filmed = [len(video) for video in result if video.video is not None]
    most, longest_px = viewer_video.SMALL if small else viewer_video.PICTURES
    every, videos, finals, count = viewer_video.stride(filmed, most), [], [], len(sync.ids)
    for i, (video, window) in enumerate(zip(level, windows, strict=True)):
        progress(i / len(level), video.id)
        motions = {
            "initial": html.monocular_motion(alone[i], video.camera, fingers),
            "final": html.final_motion(video, fingers),
        }
        finals.append(motions["final"])
        answers = {
            kind: {"shape": shapes.index(motion.betas), **html.motion_entry(block, motion)}
            for kind, motion in motions.items()
        }
        pictures = None
        if video.video is not None:
            frames, lens = video.keypoints.frames, video.camera.lens
            pictures = viewer_video.picture_entry(
                block, video.video, frames, every, window, lens, longest_px
            )
        entry = _video_entry(block, result, level, i, alone[i])
        videos.append({**entry, "answers": answers, "view": list(window), "pictures": pictures})
    return {
        "title": result.action,
        "lead": f"{count} videos, played at {sync.reference}'s pace" if count > 1 else "1 video",
        "legend": _LEGEND + model.name.replace("_", " "),
        "verdict": _verdict_entry(result),
        "reference": sync.reference,
        "timeline": viewer_video.timeline_entry(keypoints, sync),
        "model": html.model_entry(block, model),
        "shapes": shapes.entries,
        "videos": videos,
        **_eye(finals, [v["camera"]["centre"] for v in videos], sync),
    }


def _straight_boxes(video: VideoResult) -> Float[np.ndarray, "T 4"]:
    """Boxes about the performer in pictures without the lens's distortion."""
    boxes, lens = video.keypoints.person_box_px, video.camera.lens
    return boxes if lens is None else lens.undistorted(boxes.reshape(-1, 2)).reshape(-1, 4)


def _video_entry(
    block: html.Block, result: ActionResult, level: ActionResult, i: int, alone: VideoMotion
) -> dict[str, Any]:
    """Everything about video i but its bodies and pictures."""
    video, keypoints = result.videos[i], result.artifacts.get(Keypoints)
    camera = video.camera
    cameras = result.artifacts.get(CameraMotion)
    alone = relative_motions([alone], paths_of_initial(result.artifacts.get(InitialSmpl), cameras))[
        0
    ]
    K_alone = cameras.videos[i].K
    final = camera_from_world(video.body_joints, camera.R, camera.t)
    if camera.path_m is not None:
        final = final - camera.path_m[:, None]
    return {
        **viewer_video.identity_entry(block, keypoints, i, result.sync.summary),
        "camera": viewer_video.camera_entry(block, level.videos[i].camera),
        "detected": viewer_video.detected_entry(block, video.keypoints, camera.lens),
        "contacts": contact_spans(
            contact_frames(level.videos[i]),
            viewer_video.phase_of(result.sync.summary, keypoints, i),
        ),
        "sigma": viewer_video.uncertainty_entry(
            block, result.artifacts.find(Uncertainty), video.id
        ),
        "projected": {
            "initial": viewer_video.skeleton_entry(block, alone.joints, camera, K_alone),
            "final": viewer_video.skeleton_entry(block, final, camera, camera.K),
        },
    }


def _verdict_entry(result: ActionResult) -> dict[str, Any] | None:
    """The verdict, and where on the common axis its findings about spans are."""
    verdict, keypoints = verdict_of_artifacts(result.artifacts), result.artifacts.get(Keypoints)
    if verdict is None:
        return None
    ids = [video.id for video in keypoints.videos]

    def plain(sentence: str) -> str:  # commands stand between backticks
        return sentence.replace("`", "")

    def entry(finding: Finding) -> dict[str, Any]:
        span: list[float | None] = [None, None]
        i = ids.index(finding.video) if finding.video in ids else -1
        if i >= 0 and finding.first_frame is not None:
            phase_s = viewer_video.phase_of(result.sync.summary, keypoints, i)
            ends = [finding.first_frame, finding.last_frame or finding.first_frame]
            index = np.clip(np.searchsorted(keypoints.videos[i].frames, ends), 0, len(phase_s) - 1)
            span = phase_s[index].tolist()
        text = {"sentence": plain(finding.sentence), "serious": finding.serious}
        return {"video": i, "first": span[0], "last": span[1], **text}

    findings = [entry(f) for f in verdict.findings]
    return {"level": verdict.level, "summary": [*map(plain, verdict.summary)], "findings": findings}


def _eye(
    motions: Sequence[html.ShownMotion], centres: Sequence[list[float]], sync: SyncSummary
) -> dict[str, Any]:
    """Where the view opens, and how far each performer reaches."""
    bounds = [_box(motion.joints.reshape(-1, 3)) for motion in motions]
    used = [b for b, video in zip(bounds, sync.ids, strict=True) if video not in sync.excluded]
    middle = np.mean([np.mean(b, axis=0) for b in used], axis=0)
    toward = np.array(centres[sync.ids.index(sync.reference)]) - middle
    azimuth = float(np.arctan2(toward[0], toward[2]))
    return {
        "bounds": bounds,
        "middle": middle.tolist(),
        "azimuth": azimuth + _ASIDE_RAD,
        "right": [float(np.cos(azimuth)), 0.0, float(-np.sin(azimuth))],
    }


def _box(points: Float[np.ndarray, "N 3"]) -> list[list[float]]:
    """The eight corners of a box about a performer that stands on the ground."""
    low, high = points.min(axis=0) - _ABOUT_BODY_M, points.max(axis=0) + _ABOUT_BODY_M
    low[1] = max(low[1], 0.0)
    ends = np.array([low, high])
    return [ends[list(corner), [0, 1, 2]].tolist() for corner in product((0, 1), repeat=3)]


FILE_NAME = "viewer.html"
NEEDED = ("keypoints", "camera_motion", "initial_smpl", "refine_sync")
_STAMPED = '<meta name="made-from" content="'
_STAMP_WITHIN = 4096  # characters from the beginning of a page


def can_be_viewed(store: Store, action: str) -> bool:
    """Whether every artifact that the page is made of is there."""
    return all(store.current(action, stage).is_file() for stage in NEEDED)


def write_viewer(
    result: ActionResult, out: Path, progress: Callable[[float, str], None], small: bool = False
) -> bool:
    """Write the page, unless the file is already made from just this; whether it was written.

    WorkFailed names the artifact that is missing or unreadable, or the file that can't be written.
    """
    for kind in (CameraMotion, InitialSmpl):
        result.artifacts.get(kind)
    stamp = _stamp(result, small)
    if _made_from(out) == stamp:
        return False
    if out.exists() and out.stat().st_size and _STAMPED not in _head(out):
        raise WorkFailed(f"{out} exists and is no viewer; choose another name with --out")
    block, hands = html.Block(), any(video.hands is not None for video in result)
    try:
        model = body_model(result.model, result.action, hands)
        header = scene(result, model, block, progress, small)
    except ValueError as error:
        raise WorkFailed(f"{result.action}: {error}") from None
    progress(0.95, "writing")
    try:
        write_whole(out, viewer.page(header, block, stamp))
    except OSError as error:
        raise WorkFailed(f"cannot write {out}: {error.strerror}") from None
    return True


def _stamp(result: ActionResult, small: bool) -> str:
    """Digest of all that the page is made from; of videos, their sizes."""
    total = hashlib.sha256(f"{viewer.sources()}{small or ''}".encode())
    stages = [result.artifacts.stored(stage) for stage in (*NEEDED, "uncertainty", "hands")]
    for stored in stages:
        total.update(b"" if stored is None else stored.digest.encode())
    for video in sorted(result, key=lambda v: v.id):
        if video.video is not None:
            total.update(f"{video.id} {video.video.stat().st_size}".encode())
    return total.hexdigest()


def _head(file: Path) -> str:
    """The beginning of a page, complete or not; nothing where it can't be read."""
    with suppress(OSError, UnicodeDecodeError), file.open(encoding="utf-8") as stream:
        return stream.read(_STAMP_WITHIN)
    return ""


def _made_from(file: Path) -> str | None:
    """The stamp of a page; None when there is no such page, or it breaks off."""
    _, stamped, rest = _head(file).partition(_STAMPED)
    return rest.partition('"')[0] if stamped and is_whole_page(file) else None
