"""Videos written are the videos read."""

import numpy as np
import pytest

from imocap_core.io.video import (
    ENCODER,
    ENCODERS,
    film_encoder,
    probe,
    read_gray,
    read_rgb,
    read_rgb_of,
    write_h264,
)


def clip(count=7, height=48, width=64):
    y, x = np.mgrid[:height, :width]
    for t in range(count):
        yield np.stack([2 * x + 8 * t, 3 * y, np.full_like(x, 20 * t)], axis=-1).astype(np.uint8)


@pytest.fixture
def path(tmp_path):
    write_h264(tmp_path / "clip.mp4", clip(), 29.97, crf=12)
    return tmp_path / "clip.mp4"


def test_a_written_video_has_its_rate_size_and_length(path):
    info = probe(path)
    assert info.fps == pytest.approx(29.97, abs=1e-3)
    assert (info.size, info.frame_count) == ((64, 48), 7)


def test_frames_come_back_in_order_and_nearly_unchanged(path):
    read = dict(read_rgb(path))
    assert list(read) == list(range(7))
    for t, original in enumerate(clip()):
        assert np.abs(read[t].astype(int) - original).mean() < 6


def test_a_range_of_frames_keeps_its_numbers(path):
    assert [number for number, _ in read_gray(path, 2, 5)] == [2, 3, 4]


def test_some_frames_are_those_of_all(path):
    every = dict(read_rgb(path))
    some = dict(read_rgb_of(path, {5, 2}))
    assert list(some) == [2, 5]
    assert all((some[number] == every[number]).all() for number in some)
    assert not dict(read_rgb_of(path, set()))


def test_grey_frames_can_be_smaller(path):
    for _, picture in read_gray(path, scale=0.5):
        assert picture.shape == (24, 32)
        assert picture.dtype == np.uint8


def test_the_same_frames_give_the_same_bytes(path, tmp_path):
    write_h264(tmp_path / "again.mp4", clip(), 29.97, crf=12)
    assert path.read_bytes() == (tmp_path / "again.mp4").read_bytes()


def test_odd_sizes_lose_a_row_and_a_column(tmp_path):
    write_h264(tmp_path / "odd.mp4", clip(2, 49, 65), 25.0)
    assert probe(tmp_path / "odd.mp4").size == (64, 48)


def test_what_is_no_video_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no such video file"):
        probe(tmp_path / "none.mp4")
    (tmp_path / "text.mp4").write_text("hello")
    with pytest.raises(ValueError, match="is not a readable video"):
        probe(tmp_path / "text.mp4")
    with pytest.raises(ValueError, match="at least one frame"):
        write_h264(tmp_path / "empty.mp4", [], 25.0)


@pytest.mark.parametrize("encoder", ENCODERS)
def test_films_of_every_encoder_come_back(tmp_path, monkeypatch, encoder):
    monkeypatch.setenv(ENCODER, encoder)
    assert write_h264(tmp_path / "a.mp4", clip(), fps=25) == 7
    assert probe(tmp_path / "a.mp4").frame_count == 7
    for (_, back), frame in zip(read_rgb(tmp_path / "a.mp4"), clip(), strict=True):
        assert np.abs(back.astype(float) - frame).mean() < 12


def test_an_unknown_encoder_is_refused(monkeypatch):
    monkeypatch.setenv(ENCODER, "rm -rf")
    with pytest.raises(ValueError, match="expected one of libx264, libvpx-vp9, rm -rf is not"):
        film_encoder()
