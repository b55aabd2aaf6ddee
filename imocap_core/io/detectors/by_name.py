"""The readers of 2D keypoints, by the name that action.yaml gives their format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from imocap_core.io.detectors.alphapose import read_alphapose
from imocap_core.io.detectors.coco import read_coco
from imocap_core.io.detectors.cpn_npz import read_cpn_npz
from imocap_core.io.detectors.deeplabcut import read_deeplabcut
from imocap_core.io.detectors.easymocap import read_easymocap
from imocap_core.io.detectors.guess import guess_detections
from imocap_core.io.detectors.keypoints_npz import read_keypoints_npz
from imocap_core.io.detectors.mediapipe import read_mediapipe
from imocap_core.io.detectors.mmpose import read_mmpose
from imocap_core.io.detectors.openpose import read_openpose
from imocap_core.io.detectors.people import DetectedPeople
from imocap_core.io.detectors.sam3d_body import LAYOUT as SAM3D_LAYOUT
from imocap_core.io.detectors.sam3d_body import read_sam3d_keypoints
from imocap_core.io.detectors.sleap import read_sleap
from imocap_core.io.detectors.ultralytics import read_ultralytics

READERS: dict[str, Callable[[Path, str], DetectedPeople]] = {
    "openpose": read_openpose,
    "alphapose": read_alphapose,
    "mmpose": read_mmpose,
    "coco": read_coco,
    "easymocap": read_easymocap,
    "ultralytics": read_ultralytics,
    "npz": read_keypoints_npz,
    "deeplabcut": read_deeplabcut,
    "sleap": read_sleap,
    "sam3d_body": read_sam3d_keypoints,
}
# Layouts whose files may have any form: RTMLib and others write OpenPose's JSON, COCO's results
# or npz.
ANY_FILE = {"halpe26": "halpe26", "wholebody": "wholebody133"}
FORMATS = (*READERS, "mediapipe", "cpn_npz", *ANY_FILE)


def format_and_layout(path: Path, kind: str | None, layout: str | None) -> tuple[str, str]:
    """(format, layout); what is not given is recognised from the files. ValueError when it cannot
    be."""
    if kind in ANY_FILE:
        layout, kind = layout or ANY_FILE[kind], None
    if kind == "sam3d_body":  # of any file's kind, pickles too
        layout = layout or SAM3D_LAYOUT
    if kind is not None and layout is not None:
        return kind, layout
    guessed_kind, guessed_layout = guess_detections(path, layout=layout)
    return kind or guessed_kind, guessed_layout


def read_detections(
    path: Path, kind: str, layout: str, *, size: tuple[int, int], names: Sequence[str]
) -> DetectedPeople:
    """All people of all frames.

    Args:
        kind, layout: as `format_and_layout` returns them.
        size: width and height of the picture, for keypoints in shares of them.
        names: the video's id and file name, for files with several clips.

    Raises:
        ValueError: file, field, expected, got, what to do.
    """
    if kind == "mediapipe":
        return read_mediapipe(path, layout, size)
    if kind == "cpn_npz":
        return read_cpn_npz(path, layout, names)
    if kind not in READERS:
        raise ValueError(f"{path}: format: expected one of {', '.join(FORMATS)}, got {kind!r}")
    return READERS[kind](path, layout)
