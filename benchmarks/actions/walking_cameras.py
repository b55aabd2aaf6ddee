"""Action folders of yoga filmed by cameras that turn, or that walk as well."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.actions.action_folder import action_key, make_filmed
from benchmarks.synthetic.moving_yoga import CameraWalk, make_moving_clip, moving_pictures
from imocap_core.io.video import write_h264
from imocap_core.pipeline import make_demo
from imocap_core.pipeline.source import closure
from imocap_core.synthetic.yoga_clip import LAYOUT

SIZE = (480, 270)
CRF = 20
TRIPOD = CameraWalk(0.0, shake_deg=1.5, bob=False)
# half a metre to two metres, along the circle about the performer and towards them
WALKS = (CameraWalk(1.0), CameraWalk(-0.6, 0.3), CameraWalk(2.0), CameraWalk(-1.2, bend=1.0))
CENTRES = "centres.npz"  # places of the cameras, for measuring the paths' errors only


def make_moving_yoga(folder: Path, seed: int, walks: Mapping[int, CameraWalk]) -> None:
    """Write the action of a seed into `folder` unless it was made already.

    Args:
        walks: of the videos (by index) whose cameras walk; the others turn on a tripod.
    """
    key = action_key(
        [closure(Path(__file__)), seed, sorted((k, repr(w)) for k, w in walks.items())], []
    )
    make_filmed(folder, key, lambda new: _write(new, folder.name, seed, walks))


def _write(folder: Path, name: str, seed: int, walks: Mapping[int, CameraWalk]) -> None:
    shaped, truth = make_demo.demo_body(seed), make_demo.truth_of_action("yoga")
    centres: dict[str, Any] = {}
    declared = []
    for index in range(len(WALKS)):
        video = make_demo.video_id(index)
        clip = make_moving_clip(seed, index, shaped, walks.get(index, TRIPOD), SIZE)
        make_demo.write_keypoints(folder / "keypoints" / video, video, clip)
        pictures = moving_pictures(clip, seed, index, shaped)
        write_h264(folder / "videos" / f"{video}.mp4", pictures, clip.fps, crf=CRF)
        truth |= {
            f"{video}/{part}": value for part, value in make_demo.clip_truth(clip, shaped).items()
        }
        centres[video] = clip.camera.centres
        declared.append(
            {
                "id": video,
                "video": f"videos/{video}.mp4",
                "keypoints": f"keypoints/{video}",
                "format": "openpose",
                "layout": LAYOUT,
            }
        )
    np.savez(folder / "truth.npz", **truth)
    np.savez(folder / CENTRES, **centres)
    action = {"name": name, "videos": declared, "truth": "truth.npz"}
    (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))
