"""The formats that readers of 2D keypoints are tested on, and how."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from imocap_core.io.readers.keypoint_readers import read_detections
from tests.io import made_keypoints as made

Write = Callable[[Path, made.People], Path]
CASES: dict[str, tuple[Write, str, str]] = {  # name: writer, format, layout
    "openpose": (made.write_openpose, "openpose", "body25"),
    "openpose body25b": (made.write_openpose, "openpose", "body25b"),
    "openpose coco18": (made.write_openpose, "openpose", "coco18"),
    "openpose halpe26": (made.write_openpose, "openpose", "halpe26"),
    "alphapose": (made.write_alphapose, "alphapose", "coco17"),
    "alphapose 26": (made.write_alphapose, "alphapose", "halpe26"),
    "alphapose 136": (made.write_alphapose, "alphapose", "halpe136"),
    "coco": (made.write_coco, "coco", "coco17"),
    "coco wholebody": (made.write_coco_wholebody, "coco", "wholebody133"),
    "coco 133": (made.write_coco, "coco", "wholebody133"),
    "mmpose": (made.write_mmpose, "mmpose", "coco17"),
    "mmpose inferencer": (made.write_mmpose_inferencer, "mmpose", "halpe26"),
    "npz": (made.write_npz, "npz", "halpe26"),
    "npz 133": (made.write_npz, "npz", "wholebody133"),
    "mediapipe": (made.write_mediapipe, "mediapipe", "mediapipe33"),
    "cpn_npz": (made.write_cpn_npz, "cpn_npz", "h36m17"),
    "alphapose cmu": (made.write_alphapose_cmu, "alphapose", "coco18"),
    "alphapose open": (made.write_alphapose_open, "alphapose", "coco18"),
    "alphapose folder": (made.write_alphapose_folder, "alphapose", "coco18"),
    "mmpose raw": (made.write_mmpose_raw, "mmpose", "coco17"),
    "mmpose nested": (made.write_mmpose_nested, "mmpose", "coco17"),
    "mmpose results": (made.write_mmpose_results, "mmpose", "halpe26"),
    "mmpose folder": (made.write_mmpose_folder, "mmpose", "halpe26"),
    "easymocap folder": (made.write_easymocap, "easymocap", "halpe26"),
    "ultralytics": (made.write_ultralytics, "ultralytics", "coco17"),
    "ultralytics texts": (made.write_ultralytics_texts, "ultralytics", "coco17"),
    "ultralytics folder": (made.write_ultralytics_labels, "ultralytics", "coco17"),
    "dwpose": (made.write_dwpose, "openpose", "coco18"),
    "mediapipe one person": (made.write_landmark_lists, "mediapipe", "mediapipe33"),
    "csv numbered": (made.write_numbered_csv, "npz", "coco17"),
    "csv numbered 133": (made.write_numbered_csv, "npz", "wholebody133"),
    "csv named": (made.write_named_csv, "npz", "coco17"),
    "npy": (made.write_npy, "npz", "halpe26"),
    "mediapipe csv": (made.write_mediapipe_csv, "mediapipe", "mediapipe33"),
    "mediapipe csv named": (made.write_mediapipe_named_csv, "mediapipe", "mediapipe33"),
    "mediapipe csv semicolons": (made.write_mediapipe_semicolons, "mediapipe", "mediapipe33"),
}
FILES = [name for name in CASES if "openpose" not in name and "folder" not in name]  # one file each


def read(path: Path, kind: str, layout: str, *names: str) -> Any:
    return read_detections(path, kind, layout, size=made.SIZE, names=names or ("v1",))


def written(case: str, folder: Path, **changes: Any) -> tuple[Path, made.People, str, str]:
    write, kind, layout = CASES[case]
    one = {"persons": 1} if kind == "cpn_npz" or "csv" in case or "one" in case else {}
    people = made.people(layout, **(one | changes))
    return write(folder, people), people, kind, layout


def refused(path: Path, kind: str, layout: str) -> str:
    with pytest.raises(ValueError, match=r".") as error:
        read(path, kind, layout)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
    return str(error.value)
