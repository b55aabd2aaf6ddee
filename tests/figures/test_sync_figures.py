"""The picture, the film and the table of a synchronisation say what the maps say."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from imocap_core.artifacts.schemas import Keypoints, Sync, SyncMap
from imocap_core.figures.style import DIMMED, quiet, save
from imocap_core.figures.sync_figures import sync_picture, uncertainty_s
from imocap_core.figures.sync_summary import common_moments, retimed, sync_rows, title_of
from imocap_core.io.video import write_h264
from imocap_core.lock_step import (
    HEAD_PX,
    SIDE_PX,
    SyncedVideo,
    crop_windows,
    framed,
    grid_shape,
    phase_bar,
    side_by_side,
    synced_videos,
    tile,
    tile_shape,
)
from tests.made_sync import trust_in
from tests.report.made import FPS, SIZE, Made


def _without(sync: Sync, video: str) -> Sync:
    maps = [
        m
        if m.id != video
        else SyncMap(
            id=m.id,
            reference_frame=m.reference_frame * np.nan,
            confidence=np.zeros_like(m.confidence),
        )
        for m in sync.maps
    ]
    return sync.model_copy(update={"maps": maps})


def test_rows_count_rates_and_offsets_in_seconds_of_the_files(made: Made) -> None:
    """The made video v2 shows file frame 2 i at reference index 2 i: no offset, rate 1."""
    rows = {row.video: row for row in sync_rows(made.keypoints, made.refined.sync)}
    assert rows["v2"].offset_s == pytest.approx(0.0)
    assert rows["v2"].rate == pytest.approx(1.0)
    assert rows["v2"].confidence == pytest.approx(0.8)
    assert rows["v2"].matched == pytest.approx(14 / 16)
    late = {row.video: row for row in sync_rows(made.keypoints, made.sync)}
    assert late["v2"].offset_s == pytest.approx(1 / FPS)
    lost = {row.video: row for row in sync_rows(made.keypoints, _without(made.sync, "v3"))}
    assert lost["v3"].matched == 0
    assert np.isnan(lost["v3"].rate)


def test_rate_counts_different_frame_rates(made: Made) -> None:
    twice = [
        v if v.id != "v2" else v.model_copy(update={"fps": 2 * FPS}) for v in made.keypoints.videos
    ]
    rows = sync_rows(Keypoints(videos=twice), made.refined.sync)
    assert rows[1].rate == pytest.approx(2.0)


def test_retimed_takes_the_nearest_frame_and_never_goes_back() -> None:
    index, matched = retimed(np.array([np.nan, 2.0, 3.0, 9.0, 10.0]), np.arange(12), 10.0)
    assert list(index[2:4]) == [1, 2]
    assert list(index[9:11]) == [3, 4]
    assert (np.diff(index) >= 0).all()
    assert list(np.flatnonzero(matched)) == [1, 2, 3, 4, 8, 9, 10, 11]
    _, matched = retimed(np.array([0.0, 4.0, 20.0]), np.arange(24), 20.0)
    assert list(np.flatnonzero(~matched)) == [8, 9, 10, 11, 12, 13, 14, 15, 16, 22, 23]
    assert not retimed(np.array([np.nan] * 3), np.arange(2), 30.0)[1].any()
    back, _ = retimed(np.array([3.0, 2.0, 4.0]), np.arange(5), 30.0)
    assert (np.diff(back) >= 0).all()


def test_retiming_inverts_the_map() -> None:
    position = np.cumsum(np.random.default_rng(0).uniform(0.4, 1.6, 60))
    index, matched = retimed(position, np.arange(5, 50), 30.0)
    assert matched.all()
    assert np.abs(position[index] - np.arange(5, 50)).max() < 1.7


def test_the_band_holds_what_the_confidence_says() -> None:
    confidence = np.array([0.3, 0.6826894921, 0.95])
    sigma = uncertainty_s(confidence, 0.1)
    np.testing.assert_allclose(2 * norm.cdf(0.1 / sigma) - 1, confidence, rtol=1e-9)
    assert np.isfinite(uncertainty_s(np.array([0.0, 1.0, np.nan]), 0.1)).all()


@pytest.mark.parametrize("lost", ["v2", "v3", None])
def test_the_picture_is_wide_and_has_every_video(made, lost, tmp_path):
    sync = made.sync if lost is None else _without(made.sync, lost)
    with quiet():
        figure = sync_picture(made.keypoints, sync, reach_s=0.1)
        save(figure, tmp_path / "sync.png")
    axes = [ax for part in figure.subfigs for ax in part.axes]
    titles = {ax.get_title(loc) for ax in axes for loc in ("left", "center")}
    assert {
        "v2" if lost != "v2" else "v2 (unmatched)",
        "v3" if lost != "v3" else "v3 (unmatched)",
    } <= titles
    assert figure.get_figwidth() * 130 >= 1600


def test_windows_have_the_tile_s_proportions_and_hold_the_performer(made: Made) -> None:
    video = made.keypoints.videos[0]
    shape = tile_shape(made.keypoints.videos)
    windows = crop_windows(video, shape)
    np.testing.assert_allclose(windows[:, 3] / windows[:, 2], shape[0] / shape[1])
    assert np.ptp(windows[:, 2:], axis=0) == pytest.approx([0, 0])
    boxes = video.person_box_px
    inside = (boxes[:, :2] >= windows[:, :2] - 1).all() and (
        boxes[:, 2:] <= windows[:, :2] + windows[:, 2:] + 1
    ).all()
    assert inside
    unseen = video.model_copy(update={"person_box_px": boxes * np.nan})
    whole = crop_windows(unseen, shape)[0]
    assert whole[2] >= SIZE[0] - 1 or whole[3] >= SIZE[1] - 1


def test_titles_say_what_became_of_a_video(made: Made) -> None:
    sync = _without(made.sync, "v3")
    assert [title_of(sync, i) for i in sync.ids] == ["v1 (reference)", "v2", "v3 (unmatched)"]
    treated = sync.model_copy(update={"excluded": ["v3"], "mirrored": ["v2"]})
    assert [title_of(treated, i) for i in ("v2", "v3")] == ["v2 (mirrored)", "v3 (excluded)"]


def test_many_tiles_stay_on_a_screen(made: Made) -> None:
    for count in (1, 2, 4, 5, 12, 30):
        rows, columns = grid_shape(count)
        assert rows * columns >= count
        assert columns <= 4
        height, _ = tile_shape(made.keypoints.videos[:1] * count)
        assert rows * (height + 6) <= 1206


def test_tiles_show_the_frame_that_is_matched(made: Made, tmp_path: Path) -> None:
    # frame n is grey of 10 n
    files = {}
    for video in made.keypoints.videos:
        files[video.id] = tmp_path / f"{video.id}.mp4"
        pictures = (np.full((SIZE[1], SIZE[0], 3), 10 * n, dtype=np.uint8) for n in range(24))
        write_h264(files[video.id], pictures, FPS)
    tracks = synced_videos(made.keypoints, made.refined.sync, files)
    assert [t.name for t in tracks] == ["v1 (reference)", "v2", "v3"]
    shape = tile_shape(made.keypoints.videos)
    film = list(side_by_side(tracks, shape))
    assert len(film) == 16
    height, width = shape
    for moment, picture in enumerate(film):
        for number, track in enumerate(tracks):
            x = number * (width + 6)
            grey = float(picture[height // 2 : height // 2 + 20, x + 200 : x + 280].mean())
            expected = 10.0 * track.frames[moment]
            assert grey == pytest.approx(
                expected if track.matched[moment] else DIMMED * expected, abs=5
            )
            if track.matched[moment] and moment > 3:
                assert track.frames[moment] == moment
    assert not tracks[2].matched[0]  # begins four frames late
    assert tracks[2].matched[4:].all()


def test_an_unmatched_tile_is_dimmed_and_says_so() -> None:
    track = SyncedVideo(
        name="v2", rgb=(200, 100, 0), file=Path("none"), size=(320, 320), index=np.array([0, 0]),
        frames=np.array([7, 7]), matched=np.array([True, False]), confidence=np.array([0.5, 0.0]),
        windows=np.tile([0.0, 0, 320, 320], (2, 1)),
    )  # fmt: skip
    picture = np.full((320, 320, 3), 200, dtype=np.uint8)
    shown, dimmed = (tile(track, moment, picture, (480, 480)) for moment in (0, 1))
    assert shown[300, 100].mean() == pytest.approx(200, abs=2)
    assert dimmed[300, 100].mean() == pytest.approx(200 * DIMMED, abs=2)
    middle = dimmed[200:280, 150:330]
    assert middle.max() > 200  # the word
    assert (shown[-3, :230] == track.rgb).all()
    assert not (shown[-3, 250:] == track.rgb).all(axis=-1).any()


def test_a_film_lasts_as_long_as_any_video_has_a_place(made: Made) -> None:
    sync = made.refined.sync
    np.testing.assert_array_equal(common_moments(made.keypoints, sync), np.arange(16))
    # from before the reference to after it
    phases = [f / FPS for f in made.frames]
    phases[1] = phases[1] - 1 / FPS
    common = sync.model_copy(update={"trust": trust_in(dict(zip(made.ids, phases, strict=True)))})
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
