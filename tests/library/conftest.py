"""A small action on disk, and its run: two videos of 24 frames, every stage at its quickest."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import imocap
from imocap_core.io.video import write_h264
from tests.report.made import FPS, SIZE, Made
from tools.chaos.small_action import quick


@dataclass(frozen=True)
class SmallRun:
    """A working folder with an action `serve` that has been run, and what its run reported."""

    root: Path
    result: imocap.Result
    reports: list[tuple[str, float, str]]


@pytest.fixture(scope="session")
def two_videos() -> Made:
    return Made(count=2, frames=24)


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory, two_videos: Made) -> SmallRun:
    root = tmp_path_factory.mktemp("work")
    folder = root / "actions" / "serve"
    videos = []
    for v, name in enumerate(two_videos.ids):
        two_videos.write_openpose(folder / "keypoints" / name, v)
        grey = (np.full((SIZE[1], SIZE[0], 3), 5 * n, np.uint8) for n in range(24))
        write_h264(folder / f"{name}.mp4", grey, FPS)
        files = {"video": f"{name}.mp4", "keypoints": f"keypoints/{name}"}
        videos.append({"id": name, **files, "format": "openpose", "layout": "body25"})
    params: dict[str, dict[str, Any]] = {}
    for group, name, value in quick():
        params.setdefault(group, {})[name] = value
    (folder / "action.yaml").write_text(
        yaml.safe_dump({"name": "serve", "videos": videos, "params": params})
    )
    reports: list[tuple[str, float, str]] = []
    result = imocap.run("serve", root=root, progress=lambda *report: reports.append(report))
    return SmallRun(root, result, reports)
