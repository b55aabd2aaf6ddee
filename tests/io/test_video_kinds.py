"""Videos as they come: every compression, size, orientation and sound track is read back."""

import os

import numpy as np
import pytest

from imocap_core.io.frame_access import check_video
from imocap_core.io.video import probe, read_gray
from tests.io.made_videos import FPS, level, turn, write_video


@pytest.fixture(autouse=True)
def ordinary_priority():
    """SVT-AV1's encoder, run by root, leaves the process with real-time priority: it and its
    children would keep the tests beside it from the processor."""
    yield
    if hasattr(os, "sched_setscheduler") and os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def left_levels(path):
    return [float(p[:, : p.shape[1] // 4].mean()) for _, p in read_gray(path)]


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("a.mp4", "libx264"),
        ("a.mov", "libx264"),
        ("a.mkv", "libx264"),
        ("a.mp4", "libx265"),
        ("a.mp4", "libsvtav1"),
        ("a.webm", "libvpx-vp9"),
        ("a.webm", "libvpx"),
        ("a.avi", "mpeg4"),
    ],
)
def test_every_compression_is_read_back(tmp_path, name, codec):
    path = write_video(tmp_path / name, codec, audio="libopus" if codec == "libvpx-vp9" else None)
    info = check_video(path)
    assert (info.size, info.frame_count) == ((96, 64), 10)
    assert info.fps == pytest.approx(FPS, abs=0.01)
    assert np.allclose(left_levels(path), [level(n) for n in range(10)], atol=6)


@pytest.mark.parametrize("audio", ["aac", "libmp3lame"])
def test_sound_beside_the_pictures_changes_nothing(tmp_path, audio):
    path = write_video(tmp_path / "a.mp4", audio=audio)
    assert check_video(path).frame_count == 10
    assert len(left_levels(path)) == 10


def test_odd_sizes_stay(tmp_path):
    path = write_video(tmp_path / "a.webm", "libvpx-vp9", size=(97, 65))
    assert check_video(path).size == (97, 65)
    assert next(read_gray(path))[1].shape == (65, 97)


def test_a_sideways_picture_is_turned_upright(tmp_path):
    path = write_video(tmp_path / "a.mp4")
    turn(path)
    assert probe(path).size == (64, 96)
    upright = next(read_gray(path))[1]
    assert upright.shape == (96, 64)
    assert abs(upright[:40].mean() - upright[56:].mean()) > 30  # the halves are above each other


def test_frames_before_an_edit_list_do_not_count(tmp_path):
    """As phones trim a video: its header counts frames that are not shown."""
    path = write_video(tmp_path / "a.mp4", first_pts=-4, options={"use_editlist": "1"})
    shown = len(left_levels(path))
    assert 3 <= shown < 10
    assert check_video(path).frame_count == shown
