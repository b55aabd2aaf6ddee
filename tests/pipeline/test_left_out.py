"""One bad video never moves the others: their keypoints are those that they have without it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.artifacts.schemas import Keypoints
from imocap_core.params import KeypointsParams, Params
from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.stage import Context, Inputs
from stages import keypoints
from tests.io.damaged_video import FPS, SIZE, write_damaged

PARAMS = Params(keypoints=KeypointsParams())
FRAMES = 60


def declared(folder: Path, name: str, **changes: Any) -> Declaration:
    """A video of somebody who walks, beside a smaller bystander."""
    detections = folder / name
    detections.mkdir()
    rng = np.random.default_rng(3)
    walker, bystander = rng.uniform(-1, 1, (2, 25, 2)) * [9, 30]
    for t in range(FRAMES):
        places = (walker + [20 + t, 48], 0.5 * bystander + [100, 48])
        bodies = [np.column_stack([p, np.full(25, 0.9)]).ravel().tolist() for p in places]
        people = [{"pose_keypoints_2d": body} for body in bodies]
        (detections / f"c_{t:06d}_keypoints.json").write_text(json.dumps({"people": people}))
    fields = {"keypoints": name, "format": "openpose", "layout": "body25", "fps": FPS, "size": SIZE}
    return Declaration(id=name, **{**fields, **changes})


def run(folder: Path, *videos: Declaration) -> Keypoints:
    reads = frozenset(("declarations", "detections", "videos"))
    action = Action(folder, "made", videos)
    context = Context("keypoints", 0, reads, lambda share, what: None, folder, action)
    return keypoints.run(context, Inputs("keypoints", {}), PARAMS)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"size": (3840, 2160)}, "v3: expected pixels of a picture of 3840 x 2160"),
        ({"focal_px": 1e9}, "action.yaml: videos.v3.focal_px: expected 26 to 6400 pixels"),
        ({"frames": (0, 90)}, "action.yaml: videos.v3.frames: expected at most [0, 60]"),
        ({"person": {"track": 9}}, "action.yaml: videos.v3.person: "),
        ({"format": "alphapose"}, "v3: expected a file, found a folder"),
        ({"video": "v3.mp4", "fps": None, "size": None}, "v3.mp4: broken, decoding failed after"),
    ],
)
def test_a_bad_video_is_left_out(tmp_path: Path, changes: dict[str, Any], reason: str) -> None:
    good = [declared(tmp_path, "v1"), declared(tmp_path, "v2")]
    bad = declared(tmp_path, "v3", **changes)
    write_damaged(tmp_path / "v3.mp4", FRAMES, 20, 29, unreadable=True)
    result = run(tmp_path, good[0], bad, good[1])
    expected = run(tmp_path, *good)
    for video, other in zip(result.videos, expected.videos, strict=True):
        assert video.id == other.id
        assert np.array_equal(video.xy_px, other.xy_px, equal_nan=True)
    assert expected.left_out is None
    (left_out,) = result.left_out or []
    assert left_out.id == "v3"
    assert left_out.reason.startswith(reason)
    with pytest.raises(ValueError, match="v3"):
        run(tmp_path, good[0], bad)


def test_a_corrupt_file_of_keypoints_leaves_its_video_out(tmp_path: Path) -> None:
    videos = [declared(tmp_path, name) for name in ("v1", "v2", "v3")]
    (tmp_path / "v2" / "c_000030_keypoints.json").write_text('{"people": [{"pose_')
    result = run(tmp_path, *videos)
    assert [video.id for video in result.videos] == ["v1", "v3"]
    (left_out,) = result.left_out or []
    assert left_out.reason.startswith("v2/c_000030_keypoints.json: ")


def test_keypoints_in_damaged_frames_are_missing(tmp_path: Path) -> None:
    write_damaged(tmp_path / "v1.mp4", FRAMES, 20, 29, unreadable=False)
    (video,) = run(tmp_path, declared(tmp_path, "v1", video="v1.mp4")).videos
    ((first, last),) = video.damaged or []
    assert 15 <= first < last <= 35
    missing = (video.confidence == 0).all(axis=1)
    assert missing.nonzero()[0].tolist() == list(range(first, last + 1))
    assert np.isnan(video.xy_px[missing]).all()
