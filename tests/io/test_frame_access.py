"""A frame by its number is the same picture however it is come to."""

import threading
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from imocap_core.io.frame_access import (
    FrameReader,
    FrameStamps,
    all_frames,
    prefetch,
    variable_times_s,
)
from imocap_core.io.video import probe, read_gray, read_rgb, write_h264
from tests.io.made_videos import write_timed, write_video

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


def test_the_same_items_in_the_same_order() -> None:
    assert list(prefetch(range(50))) == list(range(50))
    assert list(prefetch([])) == []


def test_an_error_comes_after_the_items_before_it() -> None:
    def broken() -> Iterator[int]:
        yield 1
        yield 2
        raise OSError("the disk is gone")

    items = []
    with pytest.raises(OSError, match="the disk is gone"):
        items.extend(prefetch(broken()))
    made = prefetch(broken())
    assert [next(made), next(made)] == [1, 2]
    with pytest.raises(OSError, match="the disk is gone"):
        next(made)


def test_the_making_is_in_another_thread_and_never_far_ahead() -> None:
    made: list[int] = []
    threads = set()

    def counted() -> Iterator[int]:
        for n in range(100):
            made.append(n)
            threads.add(threading.get_ident())
            yield n

    for n in prefetch(counted()):
        assert len(made) <= n + 7  # this one, four that wait, one in hand, one being made
    assert threads != {threading.get_ident()}
    assert len(made) == 100


def test_making_ends_when_no_more_are_wanted() -> None:
    closed = threading.Event()

    def endless() -> Iterator[int]:
        try:
            while True:
                yield 1
        finally:
            closed.set()

    source = endless()
    made = prefetch(source)
    assert next(made) == 1
    before = threading.active_count()
    made.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before - 1
    source.close()
    assert closed.is_set()


def times_of(path):
    return variable_times_s(path, probe(path))


def switching_s():
    """Two seconds at 30 frames a second, one at 15, and one at 30 again."""
    return np.concatenate([np.arange(60) / 30, 2 + np.arange(15) / 15, 3 + np.arange(30) / 30])


@pytest.mark.parametrize("fps", [24.0, 29.97, 60.0, 240.0])
def test_a_constant_rate_has_no_times(tmp_path, fps):
    pictures = [np.full((48, 64, 3), 5 * t, np.uint8) for t in range(40)]
    write_h264(tmp_path / "a.mp4", pictures, fps)
    assert times_of(tmp_path / "a.mp4") is None


def test_stamps_in_whole_milliseconds_are_a_constant_rate(tmp_path):
    assert times_of(write_timed(tmp_path / "a.mkv", np.arange(90) / 29.97)) is None


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.mov"])
def test_a_variable_rate_gives_the_times_that_were_written(tmp_path, name):
    read = times_of(write_timed(tmp_path / name, switching_s()))
    np.testing.assert_allclose(read, switching_s(), atol=6e-4)  # mkv has whole milliseconds


def test_a_dropped_frame_is_no_constant_rate(tmp_path):
    times = np.delete(np.arange(60) / 30, 30)
    np.testing.assert_allclose(times_of(write_timed(tmp_path / "a.mp4", times)), times, atol=1e-4)


def test_times_begin_with_the_first_frame(tmp_path):
    read = times_of(write_timed(tmp_path / "a.mkv", 1.5 + switching_s()))
    assert read[0] == 0.0


def test_stamps_that_no_video_has_are_refused(tmp_path):
    times = np.r_[np.arange(30) / 30, 40_000 + np.arange(30) / 30]
    with pytest.raises(ValueError, match="time stamps spread 60 frames over 40,001 s"):
        times_of(write_timed(tmp_path / "a.mkv", times))


def test_a_video_with_a_broken_end_keeps_its_times(tmp_path):
    """Its first frames may be used; what cannot be decoded has stamps in the index."""
    file = write_timed(tmp_path / "a.mp4", switching_s())
    raw = bytearray(file.read_bytes())
    media = raw.index(b"mdat")
    raw[media + 2000 : media + 2060] = 60 * b"\xff"
    file.write_bytes(raw)
    with pytest.raises(ValueError, match="decoding failed after 68 frames"):
        list(read_gray(file))
    np.testing.assert_allclose(times_of(file), switching_s(), atol=1e-4)


SLOW = {"com.android.capture.fps": "240.000000"}
KEYS = {"movflags": "use_metadata_tags"}


@pytest.mark.parametrize(
    ("name", "stamped"), [("a.mp4", 30), ("a.mp4", Fraction(15, 2)), ("a.mkv", 30)]
)
def test_a_slow_motion_film_of_a_phone_has_the_rate_of_its_camera(tmp_path, name, stamped):
    options = KEYS if name == "a.mp4" else None  # Matroska writes all tags, in capitals
    path = write_video(tmp_path / name, rate=stamped, metadata=SLOW, options=options)
    info = probe(path)
    assert info.fps == pytest.approx(240)
    assert info.slowed == pytest.approx(float(240 / Fraction(stamped)))
    assert variable_times_s(path, info) is None


def test_a_rate_that_only_varies_and_a_film_with_sound_are_as_stamped(tmp_path: Path) -> None:
    near = {"com.android.capture.fps": "30.0"}
    assert probe(write_video(tmp_path / "a.mp4", metadata=near, options=KEYS)).fps == 25
    loud = write_video(tmp_path / "b.mp4", metadata=SLOW, options=KEYS, audio="aac")
    assert probe(loud).fps == 25
    for text in ("nan", "fast", "0", "1e9"):
        odd = {"com.android.capture.fps": text}
        assert probe(write_video(tmp_path / "c.mp4", metadata=odd, options=KEYS)).fps == 25


def test_uneven_stamps_of_slow_motion_are_times_of_the_action(tmp_path: Path) -> None:
    times = np.r_[np.arange(20), np.arange(22, 40)] / 30
    write_timed(tmp_path / "a.mp4", times, (64, 48))
    info = probe(tmp_path / "a.mp4")
    taken = variable_times_s(tmp_path / "a.mp4", info.taken_at(8 * info.fps))
    assert np.allclose(taken, times / 8, atol=1e-4)
