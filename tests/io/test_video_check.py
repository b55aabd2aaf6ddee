"""What is no video, or has no motion, is named with what it is."""

from pathlib import Path

import av
import numpy as np
import pytest

from imocap_core.io.frame_access import check_video
from imocap_core.io.video import open_video
from tests.io.made_times import write_timed
from tests.io.made_videos import write_video


def refused(path):
    with pytest.raises(ValueError, match=r"^[^\n]*$") as caught:
        check_video(path)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value).removeprefix(f"{path}: ")


@pytest.mark.parametrize("content", ["hello", "1\n00:00:01,000 --> 00:00:02,000\nhé\n", "a,b\n1,2"])
@pytest.mark.parametrize("suffix", ["mp4", "txt", "srt"])
def test_text(tmp_path, content, suffix):
    (tmp_path / f"a.{suffix}").write_text(content, encoding="utf-8")
    assert refused(tmp_path / f"a.{suffix}") == "expected a video, got text"


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
        open_video(tmp_path / name)
    assert refused(tmp_path / name) == "expected a video, got text"


def test_a_name_that_looks_like_a_protocol(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_video(Path("a.mp4"))
    write_video(Path("b.mp4")).rename("concat:a.mp4|a.mp4")
    assert check_video(Path("concat:a.mp4|a.mp4")).frame_count == 10
