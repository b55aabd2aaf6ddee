"""TCC as the benchmark calls it: keypoints in, correspondences out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.ablations.tcc_sync import hip_columns, tcc_sync
from benchmarks.tcc import FRAMES, POSES
from imocap_core.artifacts.schemas import Keypoints, VideoKeypoints
from imocap_core.io.video import write_h264

SIZE = (96, 64)


def swinging_video(name: str, count: int, video: str | None) -> VideoKeypoints:
    """A performer who swings about; ten frames of the file are not used."""
    turn = np.linspace(0, 2, count)[:, None]
    points = np.arange(25)[None]
    xy = np.stack([48 + 12 * np.sin(turn + points), 32 + 12 * np.cos(1.5 * turn + points)], -1)
    box = np.concatenate([xy.min(axis=1), xy.max(axis=1)], axis=1)
    return VideoKeypoints(
        id=name, fps=30.0, size=SIZE, layout="body25", video=video, focal_px=None, initial=None,
        initial_format=None, frames=np.arange(10, 10 + count), xy_px=xy,
        confidence=np.ones((count, 25)), person_box_px=box, tracks_found=1, presence=1.0, note="",
    )  # fmt: skip


def film(path: Path, count: int) -> None:
    """A disc that goes its way."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    turn = np.linspace(0, 2, count + 10)
    squares = [(x - 48 - 20 * np.sin(t)) ** 2 + (y - 32 - 20 * np.cos(t)) ** 2 for t in turn]
    grey = [(200 * np.exp(-s / 60)).astype(np.uint8) for s in squares]
    write_h264(path, [np.repeat(g[..., None], 3, axis=2) for g in grey], 30.0)


@pytest.mark.parametrize("source", ["poses", "frames"])
def test_every_frame_of_every_video_is_placed(tmp_path: Path, source: str) -> None:
    keypoints = Keypoints(
        videos=[swinging_video("a", 24, "a.mp4"), swinging_video("b", 30, "b.mp4")]
    )
    for video in keypoints.videos:
        film(tmp_path / str(video.video), len(video.frames))
    settings = replace(POSES if source == "poses" else FRAMES, steps=3, sampled=8)
    sync = tcc_sync(
        keypoints, reference="b", seed=0, source=source, folder=tmp_path, settings=settings
    )  # type: ignore[arg-type]
    assert sync.method == f"TCC on {source}"
    assert sync.lengths == [24, 30]
    np.testing.assert_array_equal(sync.maps[1].reference_frame, np.arange(30.0))
    placed = sync.maps[0].reference_frame
    assert placed.min() >= 0
    assert placed.max() <= 29
    assert (np.diff(placed) >= 0).all()


def test_what_cannot_be_had_is_said() -> None:
    keypoints = Keypoints(videos=[swinging_video("a", 24, None), swinging_video("b", 30, None)])
    with pytest.raises(ValueError, match="expected one of a, b, got 'c'"):
        tcc_sync(keypoints, reference="c", seed=0)
    with pytest.raises(ValueError, match="needs the video file"):
        tcc_sync(keypoints, reference="a", seed=0, source="frames")
    with pytest.raises(ValueError, match="needs the hips"):
        hip_columns("left_hand21")
