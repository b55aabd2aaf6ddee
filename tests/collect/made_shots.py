"""Pictures of places, cut into films."""

import cv2
import numpy as np


def place(seed: int, frames: int, *, speed: float = 0.5) -> list[np.ndarray]:
    """A camera that pans over a textured place, grey, 160 x 90."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.random((n, 4 * n)), (900, 90)) for n in (3, 8, 20)]
    wide = (255 * np.clip(sum(layers) / 3, 0, 1)).astype(np.float64)
    wide = 20 + 0.85 * np.clip((wide - 127) * 2 + 127, 0, 255)
    starts = [round(speed * t) for t in range(frames)]
    noisy = [wide[:, s : s + 160] + rng.normal(0, 2, (90, 160)) for s in starts]
    return [np.clip(picture, 0, 255).astype(np.uint8) for picture in noisy]


def mixed(a: list[np.ndarray], b: list[np.ndarray], frames: int, kind: str) -> list[np.ndarray]:
    """Two shots, the end of the first and the beginning of the second one over each other."""
    middle = []
    for i in range(frames):
        share, x, y = (i + 1) / (frames + 1), a[len(a) - frames + i], b[i]
        if kind == "dissolve":
            middle.append(np.rint((1 - share) * x.astype(float) + share * y).astype(np.uint8))
        else:
            edge = round(share * x.shape[1])
            middle.append(np.concatenate([y[:, :edge], x[:, edge:]], axis=1))
    return [*a[: len(a) - frames], *middle, *b[frames:]]


def faded(a: list[np.ndarray], b: list[np.ndarray], frames: int) -> list[np.ndarray]:
    """Two shots, out to black and in again."""
    ramp = [1 - (i + 1) / (frames + 1) for i in range(frames)]
    out = [np.rint(x * s).astype(np.uint8) for x, s in zip(a[-frames:], ramp, strict=True)]
    into = [np.rint(x * s).astype(np.uint8) for x, s in zip(b[:frames], ramp[::-1], strict=True)]
    return [*a[:-frames], *out, *into, *b[frames:]]
