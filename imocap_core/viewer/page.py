"""view: from a result to one page that shows it in three dimensions."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl
from imocap_core.artifacts.store import Store
from imocap_core.errors import WorkFailed
from imocap_core.result.result import ActionResult
from imocap_core.result.video_body import body_model_of
from imocap_core.viewer import html as viewer
from imocap_core.viewer.block import Block
from imocap_core.viewer.scene import scene
from imocap_core.whole_files import is_whole_page, write_whole

FILE_NAME = "viewer.html"
NEEDED = ("keypoints", "camera_motion", "initial_smpl", "refine_sync")
STAMPED = '<meta name="made-from" content="'
STAMP_WITHIN = 4096  # characters from the beginning of a page


def can_be_viewed(store: Store, action: str) -> bool:
    """Whether every artifact that the page is made of is there."""
    return all(store.current(action, stage).is_file() for stage in NEEDED)


def write_viewer(result: ActionResult, out: Path, progress: Callable[[float, str], None]) -> bool:
    """Write the page, unless the file is already made from just this; whether it was written.

    WorkFailed names the artifact that is missing or unreadable, or the file that can't be written.
    """
    for kind in (CameraMotion, InitialSmpl):
        result.artifacts.get(kind)
    stamp = _stamp(result)
    if _made_from(out) == stamp:
        return False
    if out.exists() and out.stat().st_size and not _is_viewer(out):
        raise WorkFailed(f"{out} exists and is no viewer; choose another name with --out")
    block = Block()
    try:
        hands = any(video.hands is not None for video in result)
        header = scene(result, body_model_of(result.videos[0], hands), block, progress)
    except ValueError as error:
        raise WorkFailed(f"{result.action}: {error}") from None
    progress(0.95, "writing")
    try:
        write_whole(out, viewer.page(header, block, stamp))
    except OSError as error:
        raise WorkFailed(f"cannot write {out}: {error.strerror}") from None
    return True


def _stamp(result: ActionResult) -> str:
    """Digest of all that the page is made from; of videos, their sizes."""
    total = hashlib.sha256(viewer.sources().encode())
    stages = [result.artifacts.stored(stage) for stage in (*NEEDED, "uncertainty", "hands")]
    for stored in stages:
        total.update(b"" if stored is None else stored.digest.encode())
    for video in sorted(result, key=lambda v: v.id):
        if video.video is not None:
            total.update(f"{video.id} {video.video.stat().st_size}".encode())
    return total.hexdigest()


def _is_viewer(file: Path) -> bool:
    """Whether a file begins as this program's viewers do, complete or not."""
    with suppress(OSError, UnicodeDecodeError), file.open(encoding="utf-8") as stream:
        return STAMPED in stream.read(STAMP_WITHIN)
    return False


def _made_from(file: Path) -> str | None:
    """The stamp of a page; None when there is no such page, or it breaks off."""
    if not is_whole_page(file):
        return None
    with suppress(OSError, UnicodeDecodeError), file.open(encoding="utf-8") as stream:
        head = stream.read(STAMP_WITHIN)
        _, stamped, rest = head.partition(STAMPED)
        return rest.partition('"')[0] if stamped else None
    return None
