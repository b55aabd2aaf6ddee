"""A video of which some frames' compressed data are random."""

import random
from pathlib import Path

import av
import numpy as np

from imocap_core.io.video import write_h264

SIZE, FPS = (128, 96), 25
HEAD_BYTES = 20  # of a packet: its length and kind, without which nothing can be decoded


def write_damaged(path: Path, count: int, first: int, last: int, *, unreadable: bool) -> None:
    """`count` frames of which `first` to `last` are damaged; unreadable: so that decoding stops."""
    rng = np.random.default_rng(0)
    scene = rng.integers(0, 255, (SIZE[1], SIZE[0] + count, 3), dtype=np.uint8)
    write_h264(path, (scene[:, t : t + SIZE[0]] for t in range(count)), FPS)
    content = bytearray(path.read_bytes())
    with av.open(str(path)) as container:
        packets = [(p.pos or 0, p.size) for p in container.demux(video=0) if p.size]
    for start, size in packets[first : last + 1]:
        head = 0 if unreadable else HEAD_BYTES
        noise = bytes(size) if unreadable else random.Random(start).randbytes(size - head)
        content[start + head : start + size] = noise
    path.write_bytes(content)
