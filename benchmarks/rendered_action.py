"""Names of actions that a benchmark has both from keypoints and as rendered videos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml

from benchmarks.actions.action_folder import action_key, is_made, make_filmed
from benchmarks.actions.captured_videos import (
    DEFAULT_VIDEOS,
    SEED,
    CapturedVideo,
    data_folder,
    trial_stance,
    trial_videos,
)
from benchmarks.synthetic import films
from benchmarks.synthetic.captured import CAMERA_PLACEMENTS
from benchmarks.synthetic.retargeting import RetargetedMotion, perform
from imocap_core.body import Shaped, load_free_body
from imocap_core.body.model import pose_from_rotations
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.detect.detection import is_set_up
from imocap_core.detect.detectors import detector_of
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.io.truth import model_text
from imocap_core.io.video import write_h264
from imocap_core.params import DetectParams
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import closure
from imocap_core.synthetic.cameras import stature_px
from imocap_core.workspace import Workspace

RENDERED = "-rendered"


def is_rendered(name: str) -> bool:
    """Whether an action is its trial put on the free body, rendered and detected."""
    return name.endswith(RENDERED)


def trial_of(name: str) -> str:
    """The name of an action in trials."""
    return name.removesuffix(RENDERED)


def check_detector(root: Path) -> None:
    """WorkFailed when the default detector's environment is not here."""
    if not is_set_up(detector_of(DetectParams(), root)):
        raise WorkFailed("the detector's environment is not installed (`imocap detect --setup`)")


# Action folders of rendered videos: captured performances put on the free body.
#
# The stages get videos with `keypoints: detect`, and nothing else. A folder appears complete or not
# at all, and is made again when its code or data have changed.

LAYOUT = "mediapipe33"
BODY_LAYOUT = "body33"  # the same keypoints at their true places on the body
SIZES = {False: (640, 480), True: (320, 240)}
POINTS = "points.npz"  # true positions of the points, for measuring the detector's errors only
CRF = 20  # H.264 quality, about that of a video from the Internet
Report = Callable[[float, str], None]  # progress: share of the work, what is done


def key_of(name: str, file: Path, videos: int, small: bool) -> str:
    """Digest of all that an action is made of."""
    stance_files = sorted(file.parent.glob("*.npz"))
    return action_key([closure(Path(__file__)), name, videos, small], [file, *stance_files])


def make_rendered(
    folder: Path, name: str, file: Path, videos: int, small: bool, report: Report
) -> None:
    """Write the action `name` of a file of trials into `folder` unless it was made already."""
    key = key_of(name, file, videos, small)
    make_filmed(folder, key, lambda new: _write(new, name, file, videos, SIZES[small], report))


def _write(
    folder: Path, name: str, file: Path, count: int, size: tuple[int, int], report: Report
) -> None:
    model = load_free_body(dtype=torch.float64)
    report(0.0, "putting the performances on a body")
    videos = trial_videos(file, count)
    betas, motions = perform(model, *trial_stance(file), [_skeleton(video) for video in videos])
    shaped = model.shape(torch.as_tensor(betas))
    truth: dict[str, Any] = {
        "joint_names": np.array(SMPL_JOINTS),
        "model": np.array(model_text(model.name, model.digest)),
        "phase_end": max(float(videos[0].phase[-1]), 1.0),
    }
    points: dict[str, Any] = {}
    declared = []
    for v, (captured, motion) in enumerate(zip(videos, motions, strict=True)):
        video = f"v{v + 1}"
        report((v + 1) / (len(videos) + 1), f"rendering {video}")
        filmed = films.film_motion(motion, shaped, CAMERA_PLACEMENTS[v], size)
        file = folder / "videos" / f"{video}.mp4"
        write_h264(file, films.render_frames(filmed, shaped, v, SEED), captured.fps, crf=CRF)
        on_floor = _with_body_joints(captured, filmed)
        truth |= on_floor.truth(video, filmed.K, filmed.R, filmed.t)
        truth |= true_pose(video, filmed.motion, on_floor, shaped, betas)
        visible = true_points(filmed, shaped)
        points |= {f"{video}/{part}": value for part, value in visible.items()}
        declared.append({"id": video, "video": f"videos/{video}.mp4", "keypoints": "detect"})
    np.savez(folder / "truth.npz", **truth)
    np.savez(folder / POINTS, **points)
    action = {"name": name, "videos": declared, "truth": "truth.npz"}
    (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))


def _skeleton(video: CapturedVideo) -> np.ndarray:
    assert video.skeleton_m is not None, "trials have their skeleton"
    return video.skeleton_m


def true_pose(
    video: str, motion: RetargetedMotion, captured: CapturedVideo, shaped: Shaped, betas: np.ndarray
) -> dict[str, Any]:
    """SMPL's pose, place and shape in the truth's common world."""
    R, t = captured.R_common_from_scene, captured.t_common
    R_local = motion.R_local.copy()
    R_local[:, 0] = R @ R_local[:, 0]
    pelvis_rest = shaped.joints_rest[0].numpy()
    trans = (motion.transl + pelvis_rest) @ R.T + t - pelvis_rest
    theta = pose_from_rotations(torch.as_tensor(R_local)).numpy()
    return {f"{video}/theta": theta, f"{video}/trans": trans, f"{video}/betas": betas}


def _with_body_joints(captured: CapturedVideo, filmed: films.FilmedMotion) -> CapturedVideo:
    """The video with the rendered body's joints as truth, on the floor of the captured motion."""
    lifted = captured.R_common_from_scene @ np.array([0.0, 0.0, filmed.floor_m])
    return replace(
        captured,
        truth_joints_m=filmed.joints,
        truth_names=SMPL_JOINTS,
        segments=None,  # its own pose is the truth
        t_common=captured.t_common + lifted,
    )


def true_points(filmed: films.FilmedMotion, shaped: Shaped) -> dict[str, Any]:
    """True pixels of the layout's points, the person's height in pixels, and the side of view."""
    xy_px, depth_m = films.true_points_px(filmed, shaped, BODY_LAYOUT)
    return {
        "xy_px": xy_px,
        "height_px": stature_px(shaped, filmed.K[1, 1], depth_m),
        "names": np.array(shaped.model.points(BODY_LAYOUT).names),
        "columns": np.array(shaped.model.points(BODY_LAYOUT).columns),
        "side": np.array(films.viewed_side(filmed.joints, filmed.R, filmed.t)),
    }


# Jobs of rendered actions: which there are, and their folders made where they are stale.


@dataclass(frozen=True)
class RenderedChoice:
    """What to run: videos per action, whether pictures have a quarter of the pixels, the actions
    (all when empty)."""

    videos: int = DEFAULT_VIDEOS
    small: bool = False
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.videos <= DEFAULT_VIDEOS:
            raise WrongUse(f"--videos: expected 1 to {DEFAULT_VIDEOS}, got {self.videos}")

    @property
    def label(self) -> str:
        """The name of its folder and table."""
        return f"rendered-{self.videos}v" + "-small" * self.small

    @property
    def command(self) -> str:
        """The command that measures all actions of this choice."""
        return f"imocap benchmark rendered --videos {self.videos}" + " --small" * self.small

    def folder(self, root: Path) -> Path:
        """The folder of its actions, artifacts, scores and tables."""
        return root / "artifacts" / "benchmark" / self.label


def rendered_names(root: Path) -> list[str]:
    """Every action that can be rendered: those of trials."""
    return [file.stem for file in sorted(data_folder(root, "trials").glob("*.npz"))]


def ready_rendered(root: Path, choice: RenderedChoice, name: str, display: Display) -> Job:
    """A job of an action; it is rendered first unless the same code and data made it."""
    if not _is_made(root, choice, name):
        display.started("render", ["its performances are not rendered"])
        file, folder = _captured(root, name), _folder(root, choice, name)
        make_rendered(folder, name, file, choice.videos, choice.small, display.progress)
    return _workspace(root, choice).ready_job(str(_folder(root, choice, name)), [], display)


def existing_rendered(root: Path, choice: RenderedChoice, name: str) -> Job | None:
    """A job of an action without making anything; None when its folder is missing or stale."""
    if not _is_made(root, choice, name):
        return None
    return _workspace(root, choice).job(str(_folder(root, choice, name)), [])


def _workspace(root: Path, choice: RenderedChoice) -> Workspace:
    return Workspace(choice.folder(root))


def _folder(root: Path, choice: RenderedChoice, name: str) -> Path:
    return choice.folder(root) / "actions" / name


def _captured(root: Path, name: str) -> Path:
    return data_folder(root, "trials") / f"{name}.npz"


def _is_made(root: Path, choice: RenderedChoice, name: str) -> bool:
    key = key_of(name, _captured(root, name), choice.videos, choice.small)
    return is_made(_folder(root, choice, name), key)
