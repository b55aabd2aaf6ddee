"""Damaged parts of a video are noticed while it is looked through."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.adapters.detected_people import survey_video
from imocap_core.io import video
from tests.io.damaged_video import FPS, SIZE, write_damaged

FRAMES = np.arange(100)


def test_a_damaged_middle_is_a_span_and_no_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_damaged(path, 100, 40, 49, unreadable=False)
    survey = survey_video(path, FRAMES, SIZE, FPS)
    ((first, last),) = survey.damaged_spans(FRAMES) or []
    assert 38 <= first <= 40
    assert 45 <= last <= 51
    assert survey.damaged.sum() == last - first + 1
    assert survey.cuts == []
    part = FRAMES[:30]
    assert survey_video(path, part, SIZE, FPS).damaged_spans(part) is None


def test_damaged_videos_are_decoded_in_one_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With several, one run in some hundred misses a damaged frame, and what is filled in for lost
    data depends on their number."""
    path = tmp_path / "a.mp4"
    write_damaged(path, 100, 40, 49, unreadable=False)
    opened: list[video.VideoStream] = []
    find = video.video_stream

    def kept(container: Any, of: Path) -> video.VideoStream:
        opened.append(find(container, of))
        return opened[-1]

    monkeypatch.setattr(video, "video_stream", kept)
    survey_video(path, FRAMES, SIZE, FPS)
    assert sum(1 for _ in video.read_gray(path, damaged=True)) == len(FRAMES)
    assert [stream.thread_count for stream in opened] == [1, 1]


def test_a_whole_video_has_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_damaged(path, 100, 1, 0, unreadable=False)
    assert survey_video(path, FRAMES, SIZE, FPS).damaged_spans(FRAMES) is None


def test_what_cannot_be_used_is_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_damaged(path, 100, 30, 80, unreadable=False)
    with pytest.raises(ValueError, match=r"a\.mp4: 5\d% of its frames are damaged \(between"):
        survey_video(path, FRAMES, SIZE, FPS)
    write_damaged(path, 100, 40, 49, unreadable=True)
    with pytest.raises(ValueError, match=r"a\.mp4: broken, decoding failed after 3\d frames"):
        survey_video(path, FRAMES, SIZE, FPS)
    write_damaged(path, 60, 1, 0, unreadable=False)
    with pytest.raises(ValueError, match=r"expected frames 0 to 99, the video ends after 60"):
        survey_video(path, FRAMES, SIZE, FPS)
