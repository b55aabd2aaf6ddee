"""view: from the artifacts of an action to one page that shows them in three dimensions."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from imocap_core.artifacts.codec import ArtifactCorrupt
from imocap_core.artifacts.schemas import CameraMotion, Hands, InitialSmpl, Keypoints, RefineSync
from imocap_core.artifacts.store import Kind, Store, Stored
from imocap_core.body import Model, load_free_body
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.action import Action
from imocap_core.viewer import html as viewer
from imocap_core.viewer.block import Block
from imocap_core.viewer.scene import Artifacts, scene

FILE_NAME = "viewer.html"
NEEDED = ("keypoints", "camera_motion", "initial_smpl", "refine_sync")
LOOK_AT = 4096  # characters of a page, within which its stamp stands


def can_be_viewed(store: Store, action: str) -> bool:
    """Whether every artifact that the page is made of is there."""
    return all(store.current(action, stage).is_file() for stage in NEEDED)


def write_viewer(
    store: Store, action: Action, out: Path, progress: Callable[[float, str], None]
) -> bool:
    """Write the page, unless the file is already made from just this; whether it was written.

    WorkFailed names the artifact that is missing or unreadable, or the file that can't be written.
    """
    stored = {stage: _load(store, action.name, stage) for stage in NEEDED}
    hands = _load(store, action.name, "hands") if _has(store, action.name, "hands") else None
    keypoints = _decode(stored["keypoints"], Keypoints, action.name)
    files = video_files(action, keypoints)
    stamp = _stamp([*stored.values(), *([hands] if hands else [])], files)
    if _made_from(out) == stamp:
        return False
    made = Artifacts(
        keypoints=keypoints,
        camera_motion=_decode(stored["camera_motion"], CameraMotion, action.name),
        initial=_decode(stored["initial_smpl"], InitialSmpl, action.name),
        refined=_decode(stored["refine_sync"], RefineSync, action.name),
        hands=None if hands is None else _decode(hands, Hands, action.name),
    )
    _check_together(made, action.name)
    block = Block()
    try:
        header = scene(made, _model(made), action.name, files, block, progress)
    except ValueError as error:
        raise WorkFailed(f"{action.name}: {error}") from None
    progress(0.95, "writing")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(viewer.page(header, block, stamp), encoding="utf-8", newline="\n")
    except OSError as error:
        raise WorkFailed(f"cannot write {out}: {error.strerror}") from None
    return True


def video_files(action: Action, keypoints: Keypoints) -> dict[str, Path]:
    """The video files that are there, by video id."""
    named = {v.id: action.folder / v.video for v in keypoints.videos if v.video is not None}
    return {video: file for video, file in named.items() if file.is_file()}


def _model(made: Artifacts) -> Model:
    """The body of these artifacts: with fingers where hands were found."""
    body = load_free_body()
    if made.refined.motion.model_digest != body.digest:
        raise WorkFailed(
            f"the motion is of the body {made.refined.motion.model}, expected {body.name} as this "
            f"version ships it; run the action again, the viewer draws no other body"
        )
    return load_free_body(hands=True) if made.hands is not None and made.hands.videos else body


def _check_together(made: Artifacts, action: str) -> None:
    """All artifacts must be of the same frames of the same videos."""
    frames = [(v.id, v.frames.tolist()) for v in made.keypoints.videos]
    others = [
        [(v.id, v.frames.tolist()) for v in videos]
        for videos in (made.initial.videos, made.refined.motion.videos)
    ]
    if made.hands is not None and made.hands.videos:
        others.append([(v.id, v.frames.tolist()) for v in made.hands.videos])
    if any(other != frames for other in others):
        raise WorkFailed(
            f"{action}: its artifacts are of different frames; run it with: imocap run {action}"
        )


def _has(store: Store, action: str, stage: str) -> bool:
    return store.current(action, stage).is_file()


def _load(store: Store, action: str, stage: str) -> Stored:
    try:
        stored = store.load(action, stage)
    except ArtifactCorrupt as error:
        raise WorkFailed(f"{error}; run it with: imocap run {action}") from None
    if stored is None:
        raise WorkFailed(f"{action} has no {stage} artifact yet; run it with: imocap run {action}")
    return stored


def _decode(stored: Stored, kind: type[Kind], action: str) -> Kind:
    try:
        return stored.decode(kind)
    except ArtifactCorrupt:
        raise WorkFailed(
            f"{stored.file} does not fit this version's {kind.__name__}; run it with: "
            f"imocap run {action}"
        ) from None


def _stamp(stored: list[Stored], files: dict[str, Path]) -> str:
    """Digest of all that the page is made from; of videos, their sizes."""
    total = hashlib.sha256(viewer.sources().encode())
    for one in stored:
        total.update(one.digest.encode())
    for video, file in sorted(files.items()):
        total.update(f"{video} {file.stat().st_size}".encode())
    return total.hexdigest()


def _made_from(file: Path) -> str | None:
    """The stamp of a page; None when there is no such page."""
    with suppress(OSError, UnicodeDecodeError), file.open(encoding="utf-8") as stream:
        head = stream.read(LOOK_AT)
        _, found, rest = head.partition('<meta name="made-from" content="')
        return rest.partition('"')[0] if found else None
    return None
