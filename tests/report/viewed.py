"""A made scene as the viewer's page, and the page's data read back."""

import base64
import json
import re
import zlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.artifacts.schemas import CameraMotion, Hands, Sync, VideoHands
from imocap_core.artifacts.schemas.base import Artifact
from imocap_core.body import load_free_body
from imocap_core.io.video import write_h264
from imocap_core.result.artifacts import Artifacts
from imocap_core.result.read import read_result
from imocap_core.result.result import ActionResult
from imocap_core.viewer import html as viewer
from imocap_core.viewer.html import Block, Entry
from imocap_core.viewer.viewer_scene import scene
from tests.report.made import SIZE, Made


def read_entry(entry: Entry, data: bytes) -> np.ndarray:
    """The array of an entry, as the page reads it (flat)."""
    return np.frombuffer(data, f"<{entry['$']}", entry["count"], entry["at"])


def inflated(blob: str) -> bytes:
    """The bytes of a block, from its text in the page."""
    return zlib.decompress(base64.b64decode(blob, validate=True))


def given_artifacts(action: str, *artifacts: Artifact) -> Artifacts:
    """Artifacts that are at hand as values."""
    values = Artifacts(action, lambda stage: None, f"run it with: imocap run {action}")
    values._decoded.update({type(artifact): artifact for artifact in artifacts})
    return values


@dataclass(frozen=True)
class Page:
    """A page's text, taken apart."""

    text: str

    @cached_property
    def header(self) -> dict[str, Any]:
        found = re.search(r'id="header">(.*?)</script>', self.text, re.S)
        header: dict[str, Any] = json.loads(found[1])
        return header

    @cached_property
    def data(self) -> bytes:
        found = re.search(r'id="blob">(.*?)</script>', self.text, re.S)
        return inflated(found[1])

    def array(self, entry: dict[str, Any], *shape: int) -> np.ndarray:
        return read_entry(entry, self.data).reshape(shape)


def result_of(
    made: Made,
    hands: bool = False,
    sync: Sync | None = None,
    camera_motion: CameraMotion | None = None,
    name: str = "waving",
) -> ActionResult:
    """The made scene as a result without files."""
    body = load_free_body(hands=True)
    videos = [_hands(made, v) for v in range(len(made.ids))] if hands else []
    refined = made.refined
    if sync is not None:
        refined = refined.model_copy(update={"sync": sync})
    artifacts = given_artifacts(
        name, made.keypoints, camera_motion or made.camera_motion, made.initial, refined,
        made.claimed,
        Hands(videos=videos, model=body.name, model_digest=body.digest, size=1.0, status="made"),
    )  # fmt: skip
    return read_result(artifacts, ActionResult)


def _hands(made: Made, v: int) -> VideoHands:
    count, rng = len(made.frames[v]), np.random.default_rng(v)
    return VideoHands(
        id=made.ids[v], frames=made.frames[v], fingers=0.4 * rng.standard_normal((count, 2, 15, 3)),
        wrists=0.3 * rng.standard_normal((count, 2, 3)), points_m=np.zeros((count, 2, 21, 3)),
        visible=np.ones((count, 2), dtype=np.int64),
    )  # fmt: skip


def page_of(
    made: Made,
    name: str = "waving",
    hands: bool = False,
    files: dict[str, Path] | None = None,
    sync: Sync | None = None,
    camera_motion: CameraMotion | None = None,
) -> Page:
    result, block = result_of(made, hands, sync, camera_motion, name), Block()
    videos = tuple(replace(v, video=(files or {}).get(v.id)) for v in result.videos)
    result = replace(result, videos=videos)
    header = scene(result, load_free_body(hands=hands), block)
    return Page(viewer.page(header, block, "0123abcd"))


def write_clip(file: Path, count: int) -> Path:
    """A small video whose brightness tells the frame."""
    size = (SIZE[1], SIZE[0], 3)
    write_h264(file, (np.full(size, 40 + 8 * t, np.uint8) for t in range(count)), 30.0)
    return file
