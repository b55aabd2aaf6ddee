"""A small action on disk, and its run: two videos of 24 frames, every stage at its quickest."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import imocap
from imocap_core.io.video import write_h264
from tests.pipeline.conftest import toy  # noqa: F401  (a fixture)
from tests.report.made import FPS, SIZE, Made

QUICK: dict[str, Any] = {
    "initial_smpl": {
        **{"library_poses": 60, "library_directions": 12, "starts": 1, "max_steps": 2},
        "hypotheses": 1,
    },
    "motion": {"rounds": 1, "max_steps": 2},
    "refine.max_rounds": 1,
    "evaluate.figures": False,
}


@dataclass(frozen=True)
class SmallRun:
    """A working folder with an action `serve` that has been run, and what its run reported."""

    root: Path
    result: imocap.Result
    reports: list[tuple[str, float, str]]


def openpose(folder: Path, made: Made, v: int) -> Path:
    """What OpenPose would write of a made video."""
    folder.mkdir(parents=True)
    columns = list(made.model.points("body25").columns)
    for n, xy in enumerate(made.keypoints.videos[v].xy_px):
        person = np.zeros((25, 3))
        person[columns] = np.column_stack([xy, np.full(len(xy), 0.9)])
        (folder / f"c_{n:06d}_keypoints.json").write_text(
            json.dumps({"people": [{"pose_keypoints_2d": person.ravel().tolist()}]})
        )
    return folder


@pytest.fixture(scope="session")
def two_videos() -> Made:
    return Made(count=2, frames=24)


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory, two_videos: Made) -> SmallRun:
    root = tmp_path_factory.mktemp("work")
    folder = root / "actions" / "serve"
    videos = []
    for v, name in enumerate(two_videos.ids):
        openpose(folder / "keypoints" / name, two_videos, v)
        grey = (np.full((SIZE[1], SIZE[0], 3), 5 * n, np.uint8) for n in range(24))
        write_h264(folder / f"{name}.mp4", grey, FPS)
        videos.append(
            {
                "id": name,
                "video": f"{name}.mp4",
                "keypoints": f"keypoints/{name}",
                "format": "openpose",
                "layout": "body25",
            }
        )
    (folder / "action.yaml").write_text(
        yaml.safe_dump({"name": "serve", "videos": videos, "params": _nested(QUICK)})
    )
    reports: list[tuple[str, float, str]] = []
    result = imocap.run("serve", root=root, progress=lambda *report: reports.append(report))
    return SmallRun(root, result, reports)


def _nested(params: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """As action.yaml writes parameters."""
    groups: dict[str, dict[str, Any]] = {}
    for key, value in params.items():
        group, dot, name = key.partition(".")
        groups.setdefault(group, {}).update({name: value} if dot else value)
    return groups
