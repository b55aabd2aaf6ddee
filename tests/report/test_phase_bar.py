"""The common axis: which moments a film shows, and the bar below it."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.artifacts.schemas import SyncTrust
from imocap_core.artifacts.schemas.sync_schemas import VideoTrust
from imocap_core.figures.sync_summary import common_moments
from imocap_core.film import HEAD_PX, SIDE_PX, framed, lock_step, phase_bar, synced_videos
from tests.report.made import FPS, Made


def _trusted(made: Made) -> SyncTrust:
    """The phases that the made videos have, from before the reference to after it."""
    videos = [
        VideoTrust(
            id=i,
            phase_s=(frames - 1 if k == 1 else frames) / FPS,
            outlier_score=0.0,
            mirror_margin=0.0,
            left_out_frames=0.0,
            left_out_s=0.0,
            left_out_share=1.0,
        )
        for k, (i, frames) in enumerate(zip(made.ids, made.frames, strict=True))
    ]
    return SyncTrust(videos=videos, triples=[])


def test_a_film_lasts_as_long_as_any_video_has_a_place(made: Made) -> None:
    sync = made.refined.sync
    np.testing.assert_array_equal(common_moments(made.keypoints, sync), np.arange(16))
    common = sync.model_copy(update={"trust": _trusted(made)})
    moments = common_moments(made.keypoints, common)
    np.testing.assert_array_equal(moments, np.arange(20))  # v3 begins 4 frames late
    reference, second, third = synced_videos(made.keypoints, common, dict.fromkeys(made.ids))
    np.testing.assert_array_equal(np.flatnonzero(reference.matched), np.arange(17))  # 1 beyond
    np.testing.assert_array_equal(second.frames[1:17], np.arange(1, 17) + 1)
    assert third.matched[4:].all()
    assert not third.matched[0]
    np.testing.assert_array_equal(third.frames[4:], np.arange(4, 20))


def test_rows_are_bright_where_the_video_matches(made: Made) -> None:
    tracks = synced_videos(made.keypoints, made.refined.sync, dict.fromkeys(made.ids))
    bar = phase_bar(tracks, np.arange(16) / FPS, 400)
    late = bar[:, SIDE_PX : SIDE_PX + 20].astype(int)
    matched = bar[:, 300:320].astype(int)
    color = np.array(tracks[2].rgb)
    assert np.abs(matched - 0.85 * color).sum(axis=2).min() < 8
    assert np.abs(late - 0.85 * color).sum(axis=2).min() > 60


def test_the_line_moves_along_and_the_film_keeps_its_pictures(made: Made) -> None:
    tracks = synced_videos(made.keypoints, made.refined.sync, dict.fromkeys(made.ids))
    film = [np.full((100, 400, 3), 90, np.uint8)] * 16
    shown = list(framed(film, tracks, np.arange(16) / FPS, "waving"))
    assert len(shown) == 16
    columns = []
    for picture in shown:
        assert (picture[HEAD_PX : HEAD_PX + 100] == 90).all()
        assert picture.shape[0] % 2 == 0
        columns.append(picture[HEAD_PX + 104].sum(axis=1).argmax())
    assert (np.diff(columns) > 10).all()
    with pytest.raises(ValueError, match="expected one a frame of the film, got 15"):
        list(framed(film, tracks, np.arange(15) / FPS, "waving"))


def test_a_thinned_film_shows_every_third_moment(made: Made) -> None:
    files = dict.fromkeys(made.ids)
    whole = list(lock_step(made.keypoints, made.refined.sync, files, "waving"))
    third = list(lock_step(made.keypoints, made.refined.sync, files, "waving", every=3))
    assert len(whole) == 16
    assert len(third) == 6
    for picture, other in zip(third, whole[::3], strict=True):
        tiles = slice(HEAD_PX, -80)
        np.testing.assert_array_equal(picture[tiles], other[tiles])
