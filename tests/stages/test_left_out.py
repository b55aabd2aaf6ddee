"""One bad video never moves the others: their keypoints are those that they have without it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.artifacts.schemas import Keypoints
from imocap_core.artifacts.schemas.video_schemas import LeftOutVideo
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.params import KeypointsParams, Params
from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.stage import Context, Inputs
from stages import keypoints
from tests.io.damaged_video import FPS, SIZE, write_damaged
from tests.made_keypoints import write_openpose

PARAMS = Params(keypoints=KeypointsParams())
FRAMES = 60


def declared(folder: Path, name: str, **changes: Any) -> Declaration:
    """A video of somebody who walks, beside a smaller bystander."""
    rng, there = np.random.default_rng(3), np.full((25, 1), 0.9)
    walker, bystander = rng.uniform(-1, 1, (2, 25, 2)) * [9, 30]
    places = ((walker + [20 + t, 48], 0.5 * bystander + [100, 48]) for t in range(FRAMES))
    write_openpose(folder / name, ([np.hstack([p, there]) for p in both] for both in places))
    fields = {"keypoints": name, "format": "openpose", "layout": "body25", "fps": FPS, "size": SIZE}
    return Declaration(id=name, **{**fields, **changes})


def run(folder: Path, *videos: Declaration) -> Keypoints:
    reads = frozenset(("declarations", "detections", "videos", "initial"))
    action = Action(folder, "made", videos)
    context = Context("keypoints", 0, reads, lambda share, what: None, folder, action)
    return keypoints.run(context, Inputs("keypoints", {}), PARAMS)


@dataclass(frozen=True)
class Others:
    """Two good videos in a folder, and their keypoints without any other."""

    folder: Path
    videos: list[Declaration]
    expected: Keypoints

    def beside(self, name: str, **changes: Any) -> LeftOutVideo:
        """What is said of a bad third one, after checking that it moves none of these."""
        bad = declared(self.folder, name, **changes)
        result = run(self.folder, self.videos[0], bad, self.videos[1])
        for video, other in zip(result.videos, self.expected.videos, strict=True):
            assert video.id == other.id
            assert np.array_equal(video.xy_px, other.xy_px, equal_nan=True)
        (left_out,) = result.left_out or []
        assert left_out.id == name
        return left_out


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> Others:
    folder = tmp_path_factory.mktemp("action")
    good = [declared(folder, "v1"), declared(folder, "v2")]
    expected = run(folder, *good)
    assert expected.left_out is None
    return Others(folder, good, expected)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"size": (3840, 2160)}, "v3: expected pixels of a picture of 3840 x 2160"),
        ({"focal_px": 1e9}, "action.yaml: videos.v3.focal_px: expected 26 to 6400 pixels"),
        (
            {"frames": (5, 90)},
            "action.yaml: videos.v3.frames: expected at most [0, 60], as the clip has 60 frames, "
            "got [5, 90]",
        ),
        ({"size": (32, 24)}, "v3: expected pixels of a picture of 32 x 24"),
        ({"person": {"track": 9}}, "action.yaml: videos.v3.person: "),
        ({"format": "coco"}, "v3: expected a file, found a folder"),
        ({"video": "v3.mp4", "fps": None, "size": None}, "v3.mp4: broken, decoding failed after"),
    ],
)
def test_a_bad_video_is_left_out(others: Others, changes: dict[str, Any], reason: str) -> None:
    if "video" in changes:
        write_damaged(others.folder / "v3.mp4", FRAMES, 20, 29, unreadable=True)
    assert others.beside("v3", **changes).reason.startswith(reason)
    with pytest.raises(ValueError, match="v3"):
        run(others.folder, others.videos[0], declared(others.folder, "v3", **changes))


def test_a_corrupt_file_of_keypoints_leaves_its_video_out(tmp_path: Path) -> None:
    videos = [declared(tmp_path, name) for name in ("v1", "v2", "v3")]
    (tmp_path / "v2" / "c_000030_keypoints.json").write_text('{"people": [{"pose_')
    result = run(tmp_path, *videos)
    assert [video.id for video in result.videos] == ["v1", "v3"]
    (left_out,) = result.left_out or []
    assert left_out.reason.startswith("v2/c_000030_keypoints.json: ")


JOINTS = np.random.default_rng(1).normal(0, 0.4, (FRAMES, 24, 3)) + (0, 0, 4)
POSES, PLACES = np.zeros((FRAMES, 72)), np.tile([0.0, 0.0, 4.0], (FRAMES, 1))
ESTIMATES = {
    "shorter": ("joints_npz", {"joints": JOINTS[:50]}, "expected a row for each of the 60"),
    "nowhere": ("joints_npz", {"joints": np.full_like(JOINTS, np.nan)}, "joints: expected numbers"),
    "in millimetres": ("joints_npz", {"joints": 1000 * JOINTS}, "joints: expected metres"),
    "enormous": ("joints_npz", {"joints": 1e308 * np.sign(JOINTS)}, "joints: expected metres"),
    "not finite": ("smpl_npz", {"poses": POSES * np.nan, "trans": PLACES}, "poses, trans: every"),
    "behind": ("smpl_npz", {"poses": POSES, "trans": -PLACES}, "trans: expected metres in front"),
}


def write_estimate(file: Path, arrays: dict[str, np.ndarray]) -> Path:
    named = {"joint_names": np.array(SMPL_JOINTS)} if "joints" in arrays else {}
    np.savez(file, **arrays, **named)  # type: ignore[arg-type]
    return file


@pytest.mark.parametrize("case", [*ESTIMATES, "cut off"])
def test_a_wrong_estimate_leaves_its_video_out(others: Others, case: str) -> None:
    kind, arrays, fault = ESTIMATES.get(case, ("joints_npz", {"joints": JOINTS}, "is not a read"))
    file = write_estimate(others.folder / "estimate.npz", arrays)
    if case == "cut off":
        file.write_bytes(file.read_bytes()[:2000])
    left_out = others.beside("v3", initial="estimate.npz", initial_format=kind)
    assert left_out.reason.startswith(f"estimate.npz: {fault}")
    assert "repair what `initial` of v3 names in action.yaml, or remove" in left_out.reason


@pytest.mark.parametrize(
    ("kind", "arrays"),
    [("joints_npz", {"joints": JOINTS}), ("smpl_npz", {"poses": POSES, "trans": PLACES})],
)
def test_a_usable_estimate_changes_nothing_else(tmp_path, kind, arrays):
    write_estimate(tmp_path / "estimate.npz", arrays)
    video = declared(tmp_path, "v1", initial="estimate.npz", initial_format=kind)
    result = run(tmp_path, video)
    assert [v.id for v in result.videos] == ["v1"]
    assert result.left_out is None


def test_keypoints_in_damaged_frames_are_missing(tmp_path: Path) -> None:
    write_damaged(tmp_path / "v1.mp4", FRAMES, 20, 29, unreadable=False)
    (video,) = run(tmp_path, declared(tmp_path, "v1", video="v1.mp4")).videos
    ((first, last),) = video.damaged or []
    assert 15 <= first < last <= 35
    missing = (video.confidence == 0).all(axis=1)
    assert missing.nonzero()[0].tolist() == list(range(first, last + 1))
    assert np.isnan(video.xy_px[missing]).all()
