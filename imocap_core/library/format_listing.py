"""What is read and what is written, a sentence for each format."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

WRITTEN = {
    "npz": "SMPL parameters, joints and camera of each video",
    "amass": "the same as AMASS's files have it (SMPL+H, SMPL-X), and SMPL's 72 numbers",
    "bvh": "a joint tree, with the names of SMPL, of characters, or of LAFAN1 (for robots)",
    "glb": "animated skinned bodies and cameras in one scene",
    "fbx": "an animated skinned character, written by Blender",
    "usd": "an animated skinned character, written by Blender",
    "trc": "joints as markers",
    "c3d": "joints, surface markers and joint angles",
    "opensim": "a model of the performer, markers and angles",
    "csv": "joints, a row a frame",
    "calib": "the cameras, for Pose2Sim and OpenCV",
    "mcap": "a file to look at in Foxglove and Rerun",
}


@dataclass(frozen=True)
class Format:
    """A format: what it is of, its name in action.yaml or for --format, what it is."""

    use: Literal["keypoints", "initial", "export"]
    name: str
    what: str


def formats() -> list[Format]:
    """Keypoints and monocular estimates that are read, and exports that are written."""
    from imocap_core.export.formats import WRITERS
    from imocap_core.io.detectors import cpn_npz, mediapipe
    from imocap_core.io.detectors.by_name import ANY_FILE, READERS
    from imocap_core.io.estimators import by_name, joints_npz, smpl_npz

    keypoints: dict[str, Any] = {**READERS, "mediapipe": mediapipe, "cpn_npz": cpn_npz}
    initial: dict[str, Any] = {"smpl_npz": smpl_npz, **by_name.ROTATIONS, **by_name.JOINTS}
    initial["joints_npz"] = joints_npz
    anything = {name: f"any of these with the points {layout}" for name, layout in ANY_FILE.items()}
    return [
        *(Format("keypoints", name, _first_sentence(of)) for name, of in keypoints.items()),
        *(Format("keypoints", name, what) for name, what in anything.items()),
        *(Format("initial", name, _first_sentence(of)) for name, of in initial.items()),
        *(Format("export", name, WRITTEN.get(name, "")) for name in WRITERS),
    ]


def _first_sentence(reader: Callable[..., object] | Any) -> str:
    """Of the page of a reader's module, which describes the format."""
    text = (inspect.getmodule(reader) or reader).__doc__ or ""
    return text.partition("\n\n")[0].replace("\n", " ").strip().rstrip(".").replace("`", "")
