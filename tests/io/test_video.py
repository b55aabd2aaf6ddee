"""Videos written are the videos read."""

import os
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from imocap_core.io import video
from imocap_core.io.frame_access import all_frames, check_video
from tests.io.made_videos import FPS, level, write_timed, write_video


def clip(count=7, height=48, width=64):
    y, x = np.mgrid[:height, :width]
    for t in range(count):
        yield np.stack([2 * x + 8 * t, 3 * y, np.full_like(x, 20 * t)], axis=-1).astype(np.uint8)


@pytest.fixture
def path(tmp_path):
    video.write_h264(tmp_path / "clip.mp4", clip(), 29.97, crf=12)
    return tmp_path / "clip.mp4"


def test_a_written_video_has_its_rate_size_and_length(path):
    info = video.probe(path)
    assert info.fps == pytest.approx(29.97, abs=1e-3)
    assert (info.size, info.frame_count) == ((64, 48), 7)


def test_frames_come_back_in_order_and_nearly_unchanged(path):
    read = dict(video.read_rgb(path))
    assert list(read) == list(range(7))
    for t, original in enumerate(clip()):
        assert np.abs(read[t].astype(int) - original).mean() < 6


def test_a_range_of_frames_keeps_its_numbers(path):
    assert [number for number, _ in video.read_gray(path, 2, 5)] == [2, 3, 4]


def test_some_frames_are_those_of_all(path):
    every = dict(video.read_rgb(path))
    some = dict(video.read_rgb_of(path, {5, 2}))
    assert list(some) == [2, 5]
    assert all((some[number] == every[number]).all() for number in some)
    assert not dict(video.read_rgb_of(path, set()))


def test_grey_frames_can_be_smaller(path):
    for _, picture in video.read_gray(path, scale=0.5):
        assert picture.shape == (24, 32)
        assert picture.dtype == np.uint8


def test_the_same_frames_give_the_same_bytes(path, tmp_path):
    video.write_h264(tmp_path / "again.mp4", clip(), 29.97, crf=12)
    assert path.read_bytes() == (tmp_path / "again.mp4").read_bytes()


def test_odd_sizes_lose_a_row_and_a_column(tmp_path):
    video.write_h264(tmp_path / "odd.mp4", clip(2, 49, 65), 25.0)
    assert video.probe(tmp_path / "odd.mp4").size == (64, 48)


def test_what_is_no_video_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no such video file"):
        video.probe(tmp_path / "none.mp4")
    (tmp_path / "text.mp4").write_text("hello")
    with pytest.raises(ValueError, match="is not a readable video"):
        video.probe(tmp_path / "text.mp4")
    with pytest.raises(ValueError, match="at least one frame"):
        video.write_h264(tmp_path / "empty.mp4", [], 25.0)


@pytest.mark.parametrize("encoder", video.ENCODERS)
def test_films_of_every_encoder_come_back(tmp_path, monkeypatch, encoder):
    monkeypatch.setenv(video.ENCODER, encoder)
    assert video.write_h264(tmp_path / "a.mp4", clip(), fps=25) == 7
    assert video.probe(tmp_path / "a.mp4").frame_count == 7
    for (_, back), frame in zip(video.read_rgb(tmp_path / "a.mp4"), clip(), strict=True):
        assert np.abs(back.astype(float) - frame).mean() < 12


def test_an_unknown_encoder_is_refused(monkeypatch):
    monkeypatch.setenv(video.ENCODER, "rm -rf")
    with pytest.raises(ValueError, match="expected one of libx264, libvpx-vp9, rm -rf is not"):
        video.film_encoder()


def refused(path):
    with pytest.raises(ValueError, match=r"^[^\n]*$") as caught:
        check_video(path)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value).removeprefix(f"{path}: ")


def test_text_whose_last_letter_is_cut(tmp_path):
    (tmp_path / "a.mp4").write_bytes(("x" * 1023 + "é").encode())
    assert refused(tmp_path / "a.mp4") == "expected a video, got text"


def test_nothing_and_noise(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"")
    assert "an empty file" in refused(tmp_path / "a.mp4")
    (tmp_path / "b.mp4").write_bytes(np.random.default_rng(0).bytes(4000))
    assert "is not a readable video" in refused(tmp_path / "b.mp4")
    assert "no such video file" in refused(tmp_path / "c.mp4")


@pytest.mark.parametrize(("name", "codec"), [("a.png", "png"), ("a.jpg", "mjpeg")])
def test_a_picture(tmp_path, name, codec):
    with av.open(str(tmp_path / name), "w", format="image2") as container:
        stream = container.add_stream(codec, rate=1)
        stream.width, stream.height = 64, 48
        stream.pix_fmt = "rgb24" if codec == "png" else "yuvj420p"
        frame = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")
        container.mux([*stream.encode(frame), *stream.encode()])
    assert refused(tmp_path / name) == "expected a video, got a picture"


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_frames_have_no_motion(tmp_path, count):
    message = refused(write_video(tmp_path / "a.mp4", count=count))
    assert f"expected at least 3 frames, as fewer have no motion, got {count}" in message


def test_sound_alone(tmp_path):
    with av.open(str(tmp_path / "a.m4a"), "w") as container:
        stream = container.add_stream("aac", rate=48_000)
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 9000), np.float32), "fltp", "mono")
        silence.rate = 48_000
        container.mux([*stream.encode(silence), *stream.encode()])
    assert "no video stream" in refused(tmp_path / "a.m4a")


@pytest.mark.parametrize("flags", [{}, {"movflags": "+faststart"}])
def test_a_file_that_was_cut_short(tmp_path, flags):
    path = write_video(tmp_path / "a.mp4", count=30, options=flags)
    assert check_video(path).frame_count == 30
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    assert "cut short" in refused(path)


def test_stamps_that_are_all_the_same(tmp_path):
    path = tmp_path / "a.mp4"
    write_timed(path, np.zeros(40), ticks=15360)
    assert "frames a second; convert it" in refused(path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.m3u8", "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:1,\nfile://{0}\n#EXT-X-ENDLIST\n"),
        ("a.mp4", "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:1,\nfile://{0}\n#EXT-X-ENDLIST\n"),
        ("a.ffconcat", "ffconcat version 1.0\nfile secret.mp4\n"),
        ("a.mpd", '<?xml version="1.0"?><MPD><Period><AdaptationSet><Representation>'
                  "<BaseURL>{0}</BaseURL></Representation></AdaptationSet></Period></MPD>"),
    ],
)  # fmt: skip
def test_a_file_that_names_others_is_not_opened(tmp_path, name, content):
    secret = write_video(tmp_path / "secret.mp4")
    (tmp_path / name).write_text(content.format(secret))
    with pytest.raises(ValueError, match=r"a playlist or another file without a video|readable"):
        video.open_video(tmp_path / name)
    assert refused(tmp_path / name) == "expected a video, got text"


def test_a_name_that_looks_like_a_protocol(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_video(Path("a.mp4"))
    write_video(Path("b.mp4")).rename("concat:a.mp4|a.mp4")
    assert check_video(Path("concat:a.mp4|a.mp4")).frame_count == 10


@pytest.fixture(autouse=True)
def ordinary_priority():
    """SVT-AV1's encoder, run by root, leaves the process with real-time priority: it and its
    children would keep the tests beside it from the processor."""
    yield
    if hasattr(os, "sched_setscheduler") and os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def left_levels(path):
    return [float(p[:, : p.shape[1] // 4].mean()) for _, p in video.read_gray(path)]


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
        ("a.avi", "mjpeg"),
        ("a.MTS", "libx264"),
        ("a.264", "libx264"),
        ("a.wmv", "wmv2"),
        ("a.gif", "gif"),
    ],
)
def test_every_compression_is_read_back(tmp_path, name, codec):
    path = write_video(tmp_path / name, codec, audio="libopus" if codec == "libvpx-vp9" else None)
    info = check_video(path)
    assert (info.size, info.frame_count) == ((96, 64), 10)
    assert info.fps == pytest.approx(FPS, abs=0.01)
    assert np.allclose(left_levels(path), [level(n) for n in range(10)], atol=6)


def test_frames_before_an_edit_list_do_not_count(tmp_path):
    """As phones trim a video: its header counts frames that are not shown."""
    path = write_video(tmp_path / "a.mp4", first_pts=-4, options={"use_editlist": "1"})
    shown = len(left_levels(path))
    assert 3 <= shown < 10
    assert check_video(path).frame_count == shown


ONE = 1 << 16
ORIENTATIONS = {  # display matrix a, b, c, d; what it does to an array
    (1, 0, 0, 1): lambda p: p,
    (0, 1, -1, 0): lambda p: np.rot90(p, -1),
    (-1, 0, 0, -1): lambda p: np.rot90(p, 2),
    (0, -1, 1, 0): lambda p: np.rot90(p, 1),
    (-1, 0, 0, 1): np.fliplr,
    (1, 0, 0, -1): np.flipud,
    (0, 1, 1, 0): lambda p: p.T,
    (0, -1, -1, 0): lambda p: np.rot90(p.T, 2),
}


def matrix(a: int, b: int, c: int, d: int) -> list[int]:
    return [a * ONE, b * ONE, 0, c * ONE, d * ONE, 0, 0, 0, 1 << 30]


@pytest.mark.parametrize("linear", ORIENTATIONS)
def test_all_eight_orientations(tmp_path: Path, linear: tuple[int, int, int, int]) -> None:
    path = write_video(tmp_path / "a.mp4", count=3, matrix=matrix(*linear))
    stored = np.zeros((64, 96))
    stored[:, :48] = 40
    stored[:16, :48] = 0  # the corner tells which way is up
    expected = ORIENTATIONS[linear](stored)
    info = video.probe(path)
    assert info.size == expected.shape[::-1]
    for picture in (
        next(video.read_gray(path))[1],
        next(all_frames(path)).gray(200),
        next(video.read_rgb(path))[1][..., 1],
    ):
        assert picture.shape == expected.shape
        where = expected == expected.max()
        assert picture[where].mean() > 30 + picture[~where].mean()
    assert info.display.mirrored == (linear[0] * linear[3] - linear[1] * linear[2] < 0)


def test_points_go_where_their_pixels_go() -> None:
    for linear in ORIENTATIONS:
        display = video.PictureDisplay(
            (96, 64), 1.0, video.axes_of(np.reshape(matrix(*linear), (3, 3)))
        )
        picture = np.zeros((64, 96), np.uint8)
        picture[5, 70] = 255
        y, x = np.argwhere(display.shown(picture))[0]
        assert display.shown_points(np.array([70.0, 5.0])) == pytest.approx([x, y])
    wide = video.PictureDisplay((96, 64), 2.0)
    assert wide.size == (192, 64)
    assert wide.shown_points(np.array([[47.5, 31.5], [0.0, 0.0]])) == pytest.approx(
        np.array([[95.5, 31.5], [0.5, 0.0]])
    )


@pytest.mark.parametrize(
    ("name", "codec"),
    [("a.mp4", "libx264"), ("a.mkv", "libx264"), ("a.mpg", "mpeg2video"), ("a.ts", "mpeg2video"),
     ("a.avi", "mpeg4"), ("a.mov", "mpeg4")],
)  # fmt: skip
@pytest.mark.parametrize("turned", [False, True])
def test_pixels_that_are_not_square(tmp_path: Path, name: str, codec: str, turned: bool) -> None:
    if turned and Path(name).suffix not in (".mp4", ".mov"):
        pytest.skip("the container has no display matrix")
    along = matrix(0, 1, -1, 0) if turned else None
    path = write_video(tmp_path / name, codec, size=(96, 72), aspect=Fraction(4, 3), matrix=along)
    size = (72, 128) if turned else (128, 72)
    assert video.probe(path).size == size
    assert next(video.read_rgb(path))[1].shape == (*size[::-1], 3)
    assert next(video.read_gray(path, scale=0.5))[1].shape == (size[1] // 2, size[0] // 2)
    assert next(all_frames(path)).gray(64).shape == (size[1] // 2, size[0] // 2)


@pytest.mark.parametrize("aspect", [Fraction(640, 639), Fraction(1, 1000), Fraction(1000, 1)])
def test_a_rounded_aspect_ratio_and_nonsense_are_square(tmp_path: Path, aspect: Fraction) -> None:
    assert video.probe(write_video(tmp_path / "a.mp4", aspect=aspect)).size == (96, 64)


def test_a_damaged_matrix_and_pictures_of_another_size() -> None:
    assert video.axes_of(np.zeros((3, 3), int)) == ((1, 0), (0, 1))
    frame = av.VideoFrame.from_ndarray(np.zeros((64, 96, 3), np.uint8), format="rgb24")
    display = video.display_of(frame, None)
    assert display == video.PictureDisplay((96, 64))
    from imocap_core.io.video import ShownFrame

    half = av.VideoFrame.from_ndarray(np.zeros((32, 48, 3), np.uint8), format="rgb24")
    assert ShownFrame(half, display).rgb().shape == (64, 96, 3)  # the stream changed its size
