"""The available detectors: their settings, networks, and the files that their answers become.

Answers become arrays in the formats that imocap_core/io/readers reads.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from imocap_core.detect.environment import NetworkFile
from imocap_core.errors import WorkFailed
from imocap_core.params import DetectParams
from imocap_core.pipeline.format_names import DetectionFormat, Layout
from imocap_core.pipeline.source import SourceFile

HERE = Path(__file__).parent
_NETWORKS = tomllib.loads((HERE / "networks.toml").read_text(encoding="utf-8"))
BLAZEPOSE, MOVENET = (
    {setting: NetworkFile(**file) for setting, file in _NETWORKS[network].items()}
    for network in ("blazepose", "movenet")
)

Arrays = dict[str, Float[np.ndarray, "..."] | Int[np.ndarray, "..."]]
WIDTH = {"pose_landmarks": (33, 4), "pose_world_landmarks": (33, 4)}
HAND = (21, 3)


def _landmark_arrays(answers: Sequence[Mapping[str, Any]]) -> Arrays:
    """MediaPipe's answers, one a frame, by name: (T, 33, 4) and, for hands, (T, 21, 3); NaN where a
    frame has no person or hand. `frames` (T,) counts them."""
    names = answers[0] if answers else WIDTH
    arrays: Arrays = {"frames": np.arange(len(answers))}
    for name in names:
        rows = np.full((len(answers), *WIDTH.get(name, HAND)), np.nan)
        for t, answer in enumerate(answers):
            if answer[name] is not None:
                rows[t] = answer[name]
        arrays[name] = rows
    return arrays


def _everybody_arrays(answers: Sequence[Mapping[str, Any]]) -> Arrays:
    """BlazePose's answers as MediaPipe's for several people: (T, P, 33, 4) by name; P is the
    largest number of people in a frame; NaN where a frame has fewer. `frames` (T,) counts them.

    An answer has `people`, and people who were overlooked `ago` frames earlier.
    """
    people: list[list[Mapping[str, Any]]] = [list(answer["people"]) for answer in answers]
    for t, answer in enumerate(answers):
        for person in answer["earlier"]:
            people[t - person["ago"]].append(person)
    most = max((len(in_frame) for in_frame in people), default=0)
    arrays: Arrays = {"frames": np.arange(len(answers))}
    for name, shape in WIDTH.items():
        arrays[name] = np.full((len(people), max(most, 1), *shape), np.nan)
        for t, in_frame in enumerate(people):
            for p, person in enumerate(in_frame):
                arrays[name][t, p] = person[name]
    return arrays


def people_arrays(answers: Sequence[Mapping[str, Any]]) -> Arrays:
    """RTMPose's answers: `keypoints` (T, P, K, 2) pixels and `scores` (T, P, K); P is the largest
    number of people in a frame; NaN and 0 where a frame has fewer. `frames` (T,) counts them."""
    most = max((len(answer["scores"]) for answer in answers), default=0)
    points = max((len(p) for answer in answers for p in answer["scores"]), default=1)
    keypoints = np.full((len(answers), max(most, 1), points, 2), np.nan)
    scores = np.zeros(keypoints.shape[:3])
    for t, answer in enumerate(answers):
        for p, (xy, score) in enumerate(zip(answer["keypoints"], answer["scores"], strict=True)):
            keypoints[t, p], scores[t, p] = xy, score
    return {"frames": np.arange(len(answers)), "keypoints": keypoints, "scores": scores}


def frames_with_people(arrays: Arrays) -> int:
    """The number of frames with at least one person."""
    points = arrays["pose_landmarks"] if "pose_landmarks" in arrays else arrays["keypoints"]
    return int(np.isfinite(points).reshape(len(points), -1).any(axis=1).sum())


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
        return _mediapipe(params)
    if params.detector in ("auto", "blazepose"):
        return _blazepose(params)
    return _rtmlib(params, folder)


def _mediapipe(params: DetectParams) -> Detector:
    return Detector(
        name="mediapipe",
        worker=HERE / "workers" / "mediapipe_pose.py",
        settings={
            "hands": params.hands,
            "min_detection_confidence": params.min_detection_confidence,
        },
        models=(),
        arrays=_landmark_arrays,
        format="mediapipe",
        layout="mediapipe33",
    )


def _blazepose(params: DetectParams) -> Detector:
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
            name: getattr(params, name)
            for name in (
                "min_person_confidence",
                "min_tracking_confidence",
                "most_people",
                "every_picture",
                "second_network",
            )
        },
        models=(),
        networks=BLAZEPOSE | MOVENET if params.second_network else BLAZEPOSE,
        arrays=_everybody_arrays,
        format="mediapipe",
        layout="blazepose33",
    )


def _rtmlib(params: DetectParams, folder: Path) -> Detector:
    models = {"person_model": params.rtmlib_person_model, "pose_model": params.rtmlib_pose_model}
    paths = {k: None if v is None else (folder / v).resolve() for k, v in models.items()}
    return Detector(
        name="rtmlib",
        worker=HERE / "workers" / "rtmlib_pose.py",
        settings={
            "hands": params.hands,
            **{name: None if path is None else str(path) for name, path in paths.items()},
        },
        models=tuple(path for path in paths.values() if path is not None),
        arrays=people_arrays,
        format="npz",
        layout="wholebody133" if params.hands else "halpe26",
    )
