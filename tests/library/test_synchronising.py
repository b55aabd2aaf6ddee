"""imocap.synchronise: of joints, of keypoint arrays, of files; known offsets come back."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import imocap
from tests.report.made import FPS, SIZE
from tools.chaos.small_action import quick

FAST = {f"{group}.{name}": value for group, name, value in quick() if group == "initial_smpl"}


def waving(frames: np.ndarray) -> np.ndarray:
    """Joints (T, 24, 3) of a body that waves, at any frames."""
    t = frames / 30.0
    rest = np.random.default_rng(3).uniform(-1, 1, (24, 3))
    swing = np.stack([np.sin(2.1 * t), np.cos(1.3 * t), np.sin(3.7 * t + 1)], axis=-1)
    moving = np.zeros((24, 1))
    moving[16:22] = np.linspace(0.3, 0.6, 6)[:, None]
    return np.asarray(rest + moving * swing[:, None])


def test_joints_that_begin_later_are_found() -> None:
    frames = np.arange(60.0)
    sync = imocap.synchronise([waving(frames), waving(frames[12:])], fps=30, reference="v1")
    assert sync.ids == ("v1", "v2")
    assert sync.reference == "v1"
    found = sync.matches("v2", "v1")
    matched = np.isfinite(found.index)
    assert matched.mean() > 0.9
    assert np.abs(found.index - (np.arange(48) + 12))[matched].mean() < 0.5
    assert sync["v2"].phase_s.shape == (48,)
    assert sync.status


def test_the_same_call_gives_the_same_answer() -> None:
    clips = [waving(np.arange(40.0)), waving(np.arange(5.0, 45.0))]
    one, two = (imocap.synchronise(clips, fps=30) for _ in range(2))
    np.testing.assert_array_equal(one["v2"].reference_frame, two["v2"].reference_frame)
    np.testing.assert_array_equal(one["v1"].phase_s, two["v1"].phase_s)


def test_keypoints_as_arrays_and_as_files(two_videos, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = list(two_videos.model.points("body25").columns)
    arrays = []
    for video in two_videos.keypoints.videos:
        points = np.zeros((24, 25, 3))
        points[:, columns, :2] = video.xy_px
        points[:, columns, 2] = 0.9
        arrays.append(points)
    of_arrays = imocap.synchronise(arrays, fps=FPS, layout="body25", size=SIZE, params=FAST)
    assert not (tmp_path / "artifacts").exists()
    folders = [two_videos.write_openpose(tmp_path / f"v{v + 1}", v) for v in range(2)]
    of_files = imocap.synchronise(folders, fps=FPS, size=SIZE, params=FAST, root=tmp_path)
    assert (tmp_path / "artifacts").is_dir()
    assert of_arrays.ids == of_files.ids == ("v1", "v2")
    for name in of_arrays.ids:
        np.testing.assert_allclose(of_arrays[name].phase_s, of_files[name].phase_s, atol=0.2)


J = waving(np.arange(10.0))


@pytest.mark.parametrize(
    ("clips", "options", "sentence"),
    [
        ([J], {"fps": 30}, "clips: expected two or more, got 1"),
        ([J, J], {}, "fps: expected the frames per second"),
        ([J, J[:, :20]], {"fps": 30}, r"expected SMPL's joints .*got \(10, 20, 3\)"),
        ([J, J], {"fps": 30, "reference": "v3"}, "reference 'v3': there is no such clip"),
        ([J, J], {"layout": "body25"}, "2D keypoints as arrays need layout, fps and size"),
        ([J, J[0]], {"layout": "body25", "fps": 30.0, "size": (640, 360)}, r"2D keypoints \(T, K"),
        (["nowhere", "nothing"], {"fps": 30}, "there is no nowhere; expected keypoints"),
        ([J, J], {"fps": 30, "params": {"sync.magic": 1}}, r"sync\.magic: unknown parameter"),
    ],
)
def test_wrong_use(clips: list[Any], options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(imocap.WrongUse, match=sentence):
        imocap.synchronise(clips, **options)


def test_a_video_without_keypoints_needs_a_working_folder(tmp_path: Path) -> None:
    clips = [tmp_path / "a.mp4", tmp_path / "b.mp4"]
    for clip in clips:
        clip.write_bytes(b"")
    with pytest.raises(imocap.WrongUse, match="a, b: no keypoints beside the video; give root="):
        imocap.synchronise(clips)
