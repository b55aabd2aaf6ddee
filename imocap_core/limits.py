"""How much a file from elsewhere may ask for, checked before anything is allocated.

The one place of these numbers (docs/robustness.md lists them). They are far above what a capture
needs: who meets one has a damaged file, a hostile one, or a clip to be cut first.
"""

from __future__ import annotations

from pathlib import Path

LAST_FRAME = 10_000_000  # a frame's number in its source
LEAST_FRAMES = 3  # used frames of one video: accelerations are of three
MAX_FRAMES = 200_000  # used frames of one video: more than an hour at 50 frames a second
MAX_SIDE_PX, MAX_PIXELS = 2**16, 2**27  # of one picture: 16k x 8k
MIN_FPS, MAX_FPS = 0.1, 10_000.0
MIN_FOCAL, MAX_FOCAL = 0.2, 50.0  # focal length over the larger side of the picture
MAX_DISTORTION = 1e3  # a coefficient of a lens, by its size
MAX_YAML_BYTES, MAX_YAML_NODES = 2**22, 200_000  # nodes: after aliases are followed
MAX_FILE_BYTES = 2**31  # of keypoints or an estimate, as it lies on the disk
MAX_FOLDER_FILES, MAX_FOLDER_BYTES = 500_000, 2**37  # below a folder that an action names
MAX_UNPACKED_BYTES = 2**29  # of a compressed file's content
MAX_INFLATION = 200  # times an artifact's bytes, where these are more; results have 5
MAX_ELEMENTS = 2**27  # numbers in one array, or parts of one pickle, shared ones counted each time


def must_be_small_enough(path: Path, limit: int = MAX_FILE_BYTES) -> None:
    """ValueError for a file of more than `limit` bytes."""
    size = path.stat().st_size
    if size > limit:
        raise ValueError(
            f"{path}: expected at most {limit / 2**20:,.0f} MiB, got {size / 2**20:,.0f} MiB"
        )


def must_unpack_to_little(size: int) -> None:
    """ValueError for a compressed file whose content takes more than MAX_UNPACKED_BYTES."""
    if size > MAX_UNPACKED_BYTES:
        raise ValueError(
            f"its content unpacks to more than {MAX_UNPACKED_BYTES / 2**20:,.0f} MiB; store "
            f"numbers only, and fewer frames"
        )
