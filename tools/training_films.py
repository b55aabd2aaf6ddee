"""Training clips to be performed by a body, and films that a detector has looked at."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from benchmarks.sync_scenes import CAPTURED_FPS
from benchmarks.synthetic.captured_skeleton import (
    CapturedSkeleton,
    NeutralStance,
    captured_skeleton,
    neutral_stance,
)
from benchmarks.synthetic.films import FilmedMotion, render_frames
from imocap_core.body import Shaped
from imocap_core.detect.detection import detect_video, set_up
from imocap_core.detect.detectors import Detector
from imocap_core.io.video import write_h264

SIZE, CRF = (640, 480), 20


@dataclass(frozen=True)
class TrainingClips:
    """Clips of one skeleton by their names: joints (T, J, 3), metres, z up, 30 frames/s."""

    skeleton: CapturedSkeleton
    stance: NeutralStance
    joints: dict[str, Float[np.ndarray, "_ J 3"]]

    @classmethod
    def read(cls, train: Path) -> TrainingClips:
        """All clips of an npz with names, parents and clip_<id>."""
        with np.load(train) as stored:
            names, parents = [str(n) for n in stored["names"]], stored["parents"].tolist()
            joints = {
                name.removeprefix("clip_"): stored[name].astype(float)
                for name in stored.files
                if name.startswith("clip_") and name != "clip_ids"
            }
        skeleton = captured_skeleton(names, parents)
        return cls(skeleton, neutral_stance(skeleton, list(joints.values())), joints)


def detected_landmarks(
    filmed: FilmedMotion, shaped: Shaped, room: int, seed: int, detector: Detector
) -> Float[np.ndarray, "T 33 4"]:
    """What a detector says of the film of a motion: x, y as shares of the picture, z, visibility of
    the person that it trusts most; NaN where nobody was detected.

    Args:
        room, seed: as of `render_frames`.
    """
    python = set_up(detector, print)
    with tempfile.TemporaryDirectory() as folder:
        video, detections = Path(folder) / "film.mp4", Path(folder) / "detections.npz"
        write_h264(video, render_frames(filmed, shaped, room, seed), CAPTURED_FPS, crf=CRF)
        detect_video(video, detections, detector, python, lambda share, what: None)
        with np.load(detections) as stored:
            landmarks = np.asarray(stored["pose_landmarks"])
    return landmarks[:, 0] if landmarks.ndim == 4 else landmarks
