"""The people of an action's videos, tracked in the background as detections become available."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imocap_core.errors import ImocapError
from imocap_core.params import KeypointsParams
from imocap_core.pick.background import BackgroundThread
from imocap_core.pipeline.action import Action, Declaration

LONGEST_WHOLE = 3000  # of a video that is followed whole; of a longer one, its used frames


@dataclass
class TrackedOutlines:
    """The outlines of one video as JSON, or why there are none; neither while they are made."""

    document: bytes | None = None
    fault: str | None = None


class Tracks:
    """Outlines by key: a digest of what they are made from."""

    def __init__(self, thread: BackgroundThread) -> None:
        self._thread = thread
        self._outlines: dict[str, TrackedOutlines] = {}
        self._keys: dict[str, str] = {}  # by video

    def get(self, key: str) -> bytes | None:
        """The outlines of a key as JSON; None where there are none."""
        made = self._outlines.get(key)
        return None if made is None else made.document

    def update(self, action: Action, params: KeypointsParams, counts: dict[str, int]) -> None:
        """Follow everybody in the videos whose detections are there."""
        keys = {}
        for declared in action.videos:
            source = _source(action, declared)
            if source is None or (declared.video is not None and declared.id not in counts):
                continue
            whole = counts.get(declared.id, 0) <= LONGEST_WHOLE
            asked = declared.model_copy(
                update={"person": None, "frames": None if whole else declared.frames}
            )
            key = _key(action, asked, source)
            keys[declared.id] = key
            if key not in self._outlines:
                self._outlines[key] = TrackedOutlines()
                self._thread.add(key, _follow(self._outlines[key], action, asked, source, params))
        self._keys = keys

    def state(self, video: str) -> dict[str, Any]:
        """Of a video, for the page: none, waiting, ready (with the key), or fault."""
        key = self._keys.get(video)
        if key is None:
            return {"state": "none"}
        made = self._outlines[key]
        if made.fault is not None:
            return {"state": "fault", "fault": made.fault}
        return {"state": "waiting"} if made.document is None else {"state": "ready", "key": key}


def _source(action: Action, declared: Declaration) -> Path | None:
    """The detections of a video, where they are."""
    given = action.detected.get(declared.id) if declared.detected else declared.keypoints
    place = None if given is None else action.folder / given
    return place if place is not None and place.exists() else None


def _key(action: Action, asked: Declaration, source: Path) -> str:
    parts = asked.model_dump(mode="json", exclude={"id", "mirrored", "repetitions"})
    text = json.dumps([str(action.folder), str(source), source.stat().st_mtime_ns, parts])
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _follow(
    made: TrackedOutlines,
    action: Action,
    asked: Declaration,
    source: Path,
    params: KeypointsParams,
) -> Any:
    def job() -> None:
        from imocap_core.pick.outlines import outlines_of  # loads torch: not before the page opens
        from imocap_core.problem.tracked_video import followed_video

        video = None if asked.video is None else action.folder / asked.video
        try:
            followed = followed_video(asked, source, video, action.file, params)
            document = json.dumps(outlines_of(followed.people), separators=(",", ":"))
        except (ValueError, OSError, MemoryError, ImocapError) as error:
            made.fault = str(error)
            return
        made.document = document.encode()

    return job
