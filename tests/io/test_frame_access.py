"""A frame by its number is the same picture however it is come to."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from imocap_core.io.frame_access import FrameReader, FrameStamps, all_frames
from imocap_core.io.video import read_rgb

COUNT = 90


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A moving square, with a key frame every 20 frames and B-frames between."""
    file = tmp_path_factory.mktemp("clip") / "clip.mp4"
    with av.open(str(file), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        stream.options = {"g": "20", "bf": "3", "x264-params": "scenecut=0"}
        for t in range(COUNT):
            picture = np.full((64, 96, 3), 2 * t, np.uint8)
            picture[20:40, t : t + 6] = 255
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return file


@pytest.fixture(scope="module")
def stamps(clip: Path) -> FrameStamps:
    frames = list(all_frames(clip))
    return FrameStamps([f.stamp for f in frames], [f.number for f in frames if f.is_key])


def test_frames_come_in_any_order(clip: Path, stamps: FrameStamps) -> None:
    pictures = dict(read_rgb(clip))
    assert len(pictures) == COUNT
    assert len(stamps.key_frames) > 2
    reader = FrameReader(clip, stamps)
    for number in (88, 3, 45, 46, 44, 0, COUNT - 1, 60, 21, 20, 19):
        (decoded,) = reader.frames(number, number)
        assert decoded.number == number
        np.testing.assert_array_equal(decoded.rgb(96), pictures[number])
    reader.close()


def test_without_time_stamps_they_are_counted(clip: Path, stamps: FrameStamps) -> None:
    reader = FrameReader(clip, FrameStamps([None] * COUNT, stamps.key_frames))
    pictures = dict(read_rgb(clip))
    for number in (50, 10):
        (decoded,) = reader.frames(number, number)
        np.testing.assert_array_equal(decoded.rgb(96), pictures[number])


def test_a_span_comes_whole_and_ends_with_the_video(clip: Path, stamps: FrameStamps) -> None:
    reader = FrameReader(clip, stamps)
    assert [f.number for f in reader.frames(30, 34)] == [30, 31, 32, 33, 34]
    assert [f.number for f in reader.frames(COUNT - 2, COUNT + 5)] == [COUNT - 2, COUNT - 1]
    assert [f.number for f in reader.frames(5, 5)] == [5]


def test_pictures_are_reduced(clip: Path) -> None:
    first = next(all_frames(clip))
    assert first.rgb(48).shape == (32, 48, 3)
    assert first.gray(48).shape == (32, 48)
    assert first.rgb(500).shape == (64, 96, 3)
