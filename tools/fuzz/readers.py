"""Everything that reads files of people: a valid file to begin with, and the reading of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.artifacts import codec
from imocap_core.artifacts.schemas import Hands
from imocap_core.artifacts.store import Store
from imocap_core.errors import ArtifactCorrupt, WorkFailed
from imocap_core.io.frame_access import variable_times_s
from imocap_core.io.readers.keypoint_readers import format_and_layout
from imocap_core.io.video import probe, read_gray, write_h264
from imocap_core.pipeline.action import read_action
from imocap_core.pipeline.graph import read_pipeline, settings
from imocap_core.pipeline.source import PROJECT
from tests.io import detector_cases, test_estimators
from tests.io.test_estimators import WRITERS, the_file
from tools.fuzz.recoded import read_recoded, write_parts

REFUSALS = (ValueError, WorkFailed, ArtifactCorrupt)
Begin = Callable[[Path], Path]  # writes a valid file, and returns what is read
Read = Callable[[Path], Any]

ACTION = """\
name: serve
truth: truth.npz
params: {sync: {max_rate: 8}, seed: 3}
anchors: [{v1: 3, v2: 4}]
videos:
  - {id: v1, keypoints: k, format: openpose, layout: body25, fps: 30, size: [640, 360]}
  - {id: v2, video: v2.mp4, keypoints: detect, frames: [3, 90], focal_px: 500, mirrored: false}
"""


def _detector(case: str) -> tuple[Begin, Read]:
    _, kind, layout = detector_cases.CASES[case]

    def begin(folder: Path) -> Path:
        return detector_cases.written(case, folder)[0]

    def read(path: Path) -> None:
        try:
            format_and_layout(path, None, None)
        except ValueError as error:
            _must_name(path, error)
        detector_cases.read(path, kind, layout)

    return begin, read


def _estimator(kind: str) -> tuple[Begin, Read]:
    return WRITERS[kind], lambda path: test_estimators.read(kind, path)


def _action(folder: Path) -> Path:
    (folder / "action.yaml").write_text(ACTION)
    return folder


def _read_action(folder: Path) -> None:
    action = read_action(folder)
    settings(read_pipeline(PROJECT / "pipeline.yaml"), action.params, action.file, [])


def _pipeline(folder: Path) -> Path:
    file = folder / "pipeline.yaml"
    file.write_bytes((PROJECT / "pipeline.yaml").read_bytes())
    return file


def _artifact(folder: Path) -> Path:
    hands = Hands(videos=[], model="m", model_digest="d", size=1.0, status="none")
    return Store(folder).put("hands", "0", hands, {"inputs": "{}"}, {"a.md": b"text"}).file


def _read_artifact(file: Path) -> None:
    codec.unpack(codec.read(file), Hands)


def _video(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    pictures = list(rng.integers(0, 255, (6, 48, 64, 3), dtype=np.uint8))
    write_h264(folder / "a.mp4", pictures, 25)
    return folder / "a.mp4"


def _read_video(file: Path) -> None:
    variable_times_s(file, probe(file))
    sum(1 for _ in read_gray(file, scale=0.5))


READERS: dict[str, tuple[Begin, Read]] = {
    **{f"keypoints {case}": _detector(case) for case in detector_cases.CASES},
    **{f"estimate {kind}": _estimator(kind) for kind in WRITERS},
    "action.yaml": (_action, _read_action),
    "pipeline.yaml": (_pipeline, read_pipeline),
    "artifact": (_artifact, _read_artifact),
    "artifact recoded": (write_parts, read_recoded),
    "video": (_video, _read_video),
}


def file_of(path: Path) -> Path:
    """The file to damage: the path, or in a folder the first."""
    if path.is_dir():
        return sorted(p for p in path.rglob("*") if p.is_file())[0]
    return the_file(path)


def try_to_read(read: Read, path: Path) -> bool:
    """Whether a file was read; AssertionError when it was refused in any other way than by a
    sentence that names it."""
    try:
        read(path)
    except REFUSALS as error:
        _must_name(path, error)
        return False
    return True


def _must_name(path: Path, error: Exception) -> None:
    text = str(error)
    named = path.name in text or file_of(path).name in text
    assert named, f"{type(error).__name__} names no file: {text[:300]}"
    longest = max(map(len, text.splitlines()), default=0)
    assert longest < 8000, f"{longest} letters: {text[:300]}"
