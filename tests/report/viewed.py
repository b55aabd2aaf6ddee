"""A made scene as the viewer's page, and the page's data read back."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.artifacts.schemas import CameraMotion, Hands, Sync, VideoHands
from imocap_core.body import Model, load_free_body
from imocap_core.io.video import write_h264
from imocap_core.viewer import html as viewer
from imocap_core.viewer.block import Block, read_entry
from imocap_core.viewer.scene import Artifacts, scene
from tests.report.made import SIZE, Made


@dataclass(frozen=True)
class Page:
    """A page's text, taken apart."""

    text: str

    @cached_property
    def header(self) -> dict[str, Any]:
        found = re.search(r'id="header">(.*?)</script>', self.text, re.S)
        assert found is not None
        header: dict[str, Any] = json.loads(found[1])
        return header

    @cached_property
    def data(self) -> bytes:
        found = re.search(r'id="blob">(.*?)</script>', self.text, re.S)
        assert found is not None
        return base64.b64decode(found[1], validate=True)

    def array(self, entry: dict[str, Any], *shape: int) -> np.ndarray:
        return read_entry(entry, self.data).reshape(shape)


def artifacts(made: Made, hands: bool = False) -> Artifacts:
    found = [_hands(made, v) for v in range(len(made.ids))] if hands else []
    body = load_free_body(hands=True)
    return Artifacts(
        keypoints=made.keypoints,
        camera_motion=made.camera_motion,
        initial=made.initial,
        refined=made.refined,
        hands=Hands(
            videos=found, model=body.name, model_digest=body.digest, size=1.0, status="made"
        ),
    )


def _hands(made: Made, v: int) -> VideoHands:
    count, rng = len(made.frames[v]), np.random.default_rng(v)
    return VideoHands(
        id=made.ids[v],
        frames=made.frames[v],
        fingers=0.4 * rng.standard_normal((count, 2, 15, 3)),
        wrists=0.3 * rng.standard_normal((count, 2, 3)),
        points_m=np.zeros((count, 2, 21, 3)),
        seen=np.ones((count, 2), dtype=np.int64),
    )


def body_of(hands: bool) -> Model:
    return load_free_body(hands=hands)


def page_of(
    made: Made,
    name: str = "waving",
    hands: bool = False,
    files: dict[str, Path] | None = None,
    sync: Sync | None = None,
    camera_motion: CameraMotion | None = None,
) -> Page:
    block, shown = Block(), artifacts(made, hands)
    if sync is not None:
        shown = replace(shown, refined=made.refined.model_copy(update={"sync": sync}))
    if camera_motion is not None:
        shown = replace(shown, camera_motion=camera_motion)
    header = scene(shown, body_of(hands), name, files or {}, block)
    return Page(viewer.page(header, block, "0123abcd"))


def write_clip(file: Path, count: int) -> Path:
    """A small video whose brightness tells the frame."""
    size = (SIZE[1], SIZE[0], 3)
    write_h264(file, (np.full(size, 40 + 8 * t, np.uint8) for t in range(count)), 30.0)
    return file
