"""The picture of a file is the one that players show: square pixels, turned and reflected."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from imocap_core.io.frame_access import all_frames
from imocap_core.io.video import PictureDisplay, axes_of, display_of, probe, read_gray, read_rgb
from tests.io.made_videos import write_video

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
    info = probe(path)
    assert info.size == expected.shape[::-1]
    for picture in (
        next(read_gray(path))[1],
        next(all_frames(path)).gray(200),
        next(read_rgb(path))[1][..., 1],
    ):
        assert picture.shape == expected.shape
        where = expected == expected.max()
        assert picture[where].mean() > 30 + picture[~where].mean()
    assert info.display is not None
    assert info.display.mirrored == (linear[0] * linear[3] - linear[1] * linear[2] < 0)


def test_points_go_where_their_pixels_go() -> None:
    for linear in ORIENTATIONS:
        display = PictureDisplay((96, 64), 1.0, axes_of(np.reshape(matrix(*linear), (3, 3))))
        picture = np.zeros((64, 96), np.uint8)
        picture[5, 70] = 255
        y, x = np.argwhere(display.shown(picture))[0]
        assert display.shown_points(np.array([70.0, 5.0])) == pytest.approx([x, y])
    wide = PictureDisplay((96, 64), 2.0)
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
    assert probe(path).size == size
    assert next(read_rgb(path))[1].shape == (*size[::-1], 3)
    assert next(read_gray(path, scale=0.5))[1].shape == (size[1] // 2, size[0] // 2)
    assert next(all_frames(path)).gray(64).shape == (size[1] // 2, size[0] // 2)


@pytest.mark.parametrize("aspect", [Fraction(640, 639), Fraction(1, 1000), Fraction(1000, 1)])
def test_a_rounded_aspect_ratio_and_nonsense_are_square(tmp_path: Path, aspect: Fraction) -> None:
    assert probe(write_video(tmp_path / "a.mp4", aspect=aspect)).size == (96, 64)


def test_a_damaged_matrix_and_pictures_of_another_size() -> None:
    assert axes_of(np.zeros((3, 3), int)) == ((1, 0), (0, 1))
    frame = av.VideoFrame.from_ndarray(np.zeros((64, 96, 3), np.uint8), format="rgb24")
    display = display_of(frame, None)
    assert display == PictureDisplay((96, 64))
    from imocap_core.io.video import ShownFrame

    half = av.VideoFrame.from_ndarray(np.zeros((32, 48, 3), np.uint8), format="rgb24")
    assert ShownFrame(half, display).rgb().shape == (64, 96, 3)  # the stream changed its size
