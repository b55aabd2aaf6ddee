"""A small film in which textured patches move as somebody's joints would."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np

WIDTH, HEIGHT, COUNT = 320, 240, 60
ONE = 1 << 16


def joints(time: np.ndarray) -> np.ndarray:
    """(T, 17, 2) stored pixels of somebody who moves; time in frames."""
    rng = np.random.default_rng(0)
    middle = rng.uniform((90, 50), (230, 225), (17, 2))
    turn = rng.uniform(0, 6, (17, 2)) + time[:, None, None] / 6
    return middle + 9 * np.sin(turn)


def film(path: Path, *, aspect: Fraction | None = None, flip: bool = False) -> Path:
    """Textured patches at the joints, over a textured wall."""
    rng = np.random.default_rng(1)
    wall = rng.integers(60, 130, (HEIGHT // 4, WIDTH // 4)).repeat(4, 0).repeat(4, 1)
    patches = rng.integers(0, 255, (17, 6, 6)).repeat(4, 1).repeat(4, 2)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.options = {"crf": "15", "preset": "ultrafast"}
        if aspect is not None:
            stream.sample_aspect_ratio = aspect
        if flip:
            stream.set_display_matrix([-ONE, 0, 0, 0, ONE, 0, 0, 0, 1 << 30])
        for xy in joints(np.arange(COUNT)):
            picture = wall.astype(np.uint8)
            for (x, y), patch in zip(xy.round().astype(int), patches, strict=True):
                picture[y - 12 : y + 12, x - 12 : x + 12] = patch[: 12 + HEIGHT - y]
            frame = av.VideoFrame.from_ndarray(picture, format="gray")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path
