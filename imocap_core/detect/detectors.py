"""The available detectors: their settings, and the files that their answers become."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imocap_core.detect.results import Arrays, landmark_arrays, people_arrays
from imocap_core.params import DetectParams
from imocap_core.pipeline.format_names import DetectionFormat, InitialFormat, Layout
from imocap_core.pipeline.source import SourceFile

HERE = Path(__file__).parent
FORMAT = 1  # raise when the files written mean something else


@dataclass(frozen=True)
class Detector:
    """A detector with its settings.

    name: of its environment's list of packages. worker: its script. settings: the script's
    argument. models: files that the user provides. arrays: its answers -> the arrays of its file.
    """

    name: str
    worker: Path
    settings: dict[str, Any]
    models: tuple[Path, ...]
    arrays: Callable[[Sequence[dict[str, Any]]], Arrays]
    format: DetectionFormat
    layout: Layout
    initial_format: InitialFormat | None

    @property
    def packages(self) -> Path:
        """The file that lists the packages of its environment, with their versions."""
        return HERE / "environments" / f"{self.name}.txt"

    @property
    def version(self) -> str:
        """Name and version, as `mediapipe 0.10.21`."""
        lines = self.packages.read_text(encoding="utf-8").split()
        return next(line for line in lines if line.startswith(f"{self.name}==")).replace("==", " ")

    def key(self, content: str, models: Sequence[str]) -> str:
        """Digest of all that a video's detections depend on; `content` (the video's) and `models`
        are digests of files."""
        settings = {k: v for k, v in self.settings.items() if not k.endswith("_model")}
        parts = [
            FORMAT,
            self.version,
            SourceFile("", self.worker).digest,
            settings,
            content,
            *models,
        ]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def detector_of(params: DetectParams, folder: Path) -> Detector:
    """The detector that the parameters choose; paths of models are relative to `folder`."""
    if params.detector == "mediapipe":
        return Detector(
            name="mediapipe",
            worker=HERE / "workers" / "mediapipe_pose.py",
            settings={
                "hands": params.hands,
                "follow": params.follow,
                "min_detection_confidence": params.min_detection_confidence,
                "min_tracking_confidence": params.min_tracking_confidence,
            },
            models=(),
            arrays=landmark_arrays,
            format="mediapipe",
            layout="mediapipe33",
            initial_format="mediapipe_world" if params.world_landmarks else None,
        )
    models = {"person_model": params.rtmlib_person_model, "pose_model": params.rtmlib_pose_model}
    paths = {k: None if v is None else (folder / v).resolve() for k, v in models.items()}
    return Detector(
        name="rtmlib",
        worker=HERE / "workers" / "rtmlib_pose.py",
        settings={
            "hands": params.hands,
            "mode": params.rtmlib_mode,
            **{name: None if path is None else str(path) for name, path in paths.items()},
        },
        models=tuple(path for path in paths.values() if path is not None),
        arrays=people_arrays,
        format="npz",
        layout="wholebody133" if params.hands else "halpe26",
        initial_format=None,
    )
