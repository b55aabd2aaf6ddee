"""Captured motion as the videos of an action: joints, phases, and the frames that a video shows."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from benchmarks.synthetic import captured
from benchmarks.synthetic.captured_skeleton import (
    CapturedSkeleton,
    NeutralStance,
    captured_skeleton,
    neutral_stance,
    rotations_from_stance,
    trunk_bone_rotations,
)
from benchmarks.synthetic.simulated import DETECTORS
from imocap_core.conventions import EVAL_14
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.synthetic.cameras import CameraPlacement

DATA_VARIABLE = "IMOCAP_DATA"
SIZE = (1000, 1000)
SEED = 7
PLACEMENTS = (*captured.CAMERA_PLACEMENTS, *captured.FURTHER_PLACEMENTS)
DEFAULT_VIDEOS, MAX_VIDEOS = len(captured.CAMERA_PLACEMENTS), len(PLACEMENTS)
GOLDEN_DEG = 137.508


def placement(number: int) -> CameraPlacement:
    """Where the camera of a video stands: around the performer, beyond the first in steps of the
    golden angle."""
    if number < MAX_VIDEOS:
        return PLACEMENTS[number]
    height, focal = np.random.default_rng([SEED, number]).uniform((1.0, 0.85), (2.0, 1.15))
    return CameraPlacement(float(number * GOLDEN_DEG % 360), 4.0, float(height), float(focal))


@dataclass(frozen=True)
class RecordedView:
    """The camera (from the stage) and the 2D detections of a real video: xy_px in COCO's order,
    NaN where a keypoint is missing."""

    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, " 3"]
    xy_px: Float[np.ndarray, "T 18 2"]
    size: tuple[int, int]


@dataclass(frozen=True)
class CapturedVideo:
    """Captured motion of T frames, of which one video of an action shows some.

    joints_m lie on the stage where the motion is filmed; the truth is given in a common world,
    which `R_common_from_scene` and `t_common` (metres) lead to.

    phase: when two videos correspond. frames: indices of the motion's frames that the video shows.
    fps: of joints_m. is_outlier: the video shows another action, which the truth leaves out.
    recorded: a real camera and its detections, where these need not be simulated. truth_joints_m:
    the joints that the truth gives, in the order of `truth_names`, where they are more than the 14.
    skeleton_m: all joints of the captured skeleton, on the stage. segments: rotations of its
    pelvis, chest and head from a neutral stance to the stage, for the truth. place: whose camera
    and random numbers it has; None: its place among the videos.
    """

    joints_m: Float[np.ndarray, "T 14 3"]
    phase: Float[np.ndarray, " T"]
    frames: Int[np.ndarray, " N"]
    fps: float
    R_common_from_scene: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    t_common: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))
    is_outlier: bool = False
    recorded: RecordedView | None = None
    truth_joints_m: Float[np.ndarray, "T J 3"] | None = None
    truth_names: tuple[str, ...] = EVAL_14
    skeleton_m: Float[np.ndarray, "T S 3"] | None = None
    segments: Float[np.ndarray, "T 6 3 3"] | None = None
    place: int | None = None

    def truth(
        self,
        video: str,
        K: Float[np.ndarray, "3 3"],
        R: Float[np.ndarray, "3 3"],
        t: Float[np.ndarray, " 3"],
    ) -> dict[str, Float[np.ndarray, "..."]]:
        """The arrays of `video` in truth.npz; R, t is the camera from the stage."""
        R_cam_from_common = R @ self.R_common_from_scene.T
        joints = self.joints_m if self.truth_joints_m is None else self.truth_joints_m
        parts = {
            "joints": joints[self.frames] @ self.R_common_from_scene.T + self.t_common,
            "phase": self.phase[self.frames],
            "K": K,
            "R": R_cam_from_common,
            "t": t - R_cam_from_common @ self.t_common,
        }
        if self.segments is not None:
            parts["segments"] = self.R_common_from_scene @ self.segments[self.frames]
        return {f"{video}/{name}": value for name, value in parts.items()}


def data_base(root: Path) -> Path:
    """The folder that holds all data."""
    configured = os.environ.get(DATA_VARIABLE)
    return Path(configured) if configured else root.resolve().parent / "shared" / "data"


def data_folder(root: Path, kind: str) -> Path:
    """The folder of captured motion `kind` (protocol, trials); WorkFailed when it has no files."""
    folder = data_base(root) / kind
    if not any(folder.glob("*.npz")):
        raise WorkFailed(
            f"the benchmark {kind} needs captured motion, and {folder} holds no .npz file; put the "
            f"data there or set {DATA_VARIABLE} to the folder that holds {kind}/ (the benchmark "
            "yoga needs no data)"
        )
    return folder


def protocol_videos(file: Path, sampling: str, videos: int) -> list[CapturedVideo]:
    """One motion, resampled for each video."""
    with np.load(file) as stored:
        skeleton = stored["joints"].astype(np.float64)
        joints = skeleton[:, stored["common14_idx"]]
        fps = float(stored["fps"])
    turn, shift = captured.to_scene(joints)
    world, placed = (
        turn.apply(x.reshape(-1, 3)).reshape(x.shape) + shift for x in (joints, skeleton)
    )
    phase = np.arange(len(world), dtype=np.float64)
    segments = _segments(file, placed)
    return [
        CapturedVideo(
            world,
            phase,
            captured.sample_frames(sampling, len(world), v, video_rng(file.stem, v, 0)),
            fps,
            segments=segments,
        )
        for v in range(videos)
    ]


def trial_videos(file: Path, videos: int) -> list[CapturedVideo]:
    """Another performance for each video: the first ones of the file."""
    return videos_of_performances([file], videos)


def videos_of_performances(files: Sequence[Path], videos: int) -> list[CapturedVideo]:
    """The first performances of each file, all of one action and one skeleton, in one scene."""
    trials: list[np.ndarray] = []
    for file in files:
        with np.load(file) as stored:
            index, fps = stored["common14_idx"], float(stored["fps"])
            count = min(videos, len(stored["trial_ids"]))
            trials += [stored[f"trial_{v:02d}"].astype(np.float64) for v in range(count)]
    return [
        replace(captured_video(p, fps), skeleton_m=skeleton, segments=_segments(files[0], skeleton))
        for p, skeleton in _on_stage(trials, index)
    ]


def captured_video(trial: captured.AlignedTrial, fps: float) -> CapturedVideo:
    """A video of all of an aligned trial."""
    frames = np.arange(len(trial.phase))
    common = trial.R_common_from_scene, trial.t_common
    return CapturedVideo(trial.joints_m, trial.phase, frames, fps, *common)


def _on_stage(
    trials: Sequence[np.ndarray], index: Int[np.ndarray, "14"]
) -> list[tuple[captured.AlignedTrial, np.ndarray]]:
    """Aligned trials, each with its whole skeleton on the stage."""
    aligned = captured.align_trials([t[:, index] for t in trials])
    return [
        (p, trial @ p.R_scene_from_capture.T + p.t_scene)
        for p, trial in zip(aligned, trials, strict=True)
    ]


def _segments(file: Path, skeleton_m: Float[np.ndarray, "T S 3"]) -> Float[np.ndarray, "T 6 3 3"]:
    """Rotations of pelvis, chest, head, neck and collars from the neutral stance to the stage."""
    stance = trial_stance(file)
    parts = (rotations_from_stance, trunk_bone_rotations)
    rotations = np.concatenate([part(*stance, skeleton_m) for part in parts])
    return np.ascontiguousarray(rotations.swapaxes(0, 1))


def trial_stance(file: Path) -> tuple[CapturedSkeleton, NeutralStance]:
    """A captured skeleton, and its stance over all files of the folder that have it."""
    names, parents = _skeleton_of(file)
    alike = [f for f in sorted(file.parent.glob("*.npz")) if _skeleton_of(f) == (names, parents)]
    clips: list[np.ndarray] = []
    for other in alike:
        with np.load(other) as stored:
            ids = stored.get("trial_ids", ())
            clips += [stored[f"trial_{v:02d}"] for v in range(len(ids))] or [stored["joints"]]
    skeleton = captured_skeleton(names, parents)
    return skeleton, neutral_stance(skeleton, clips)


def _skeleton_of(file: Path) -> tuple[list[str], list[int]]:
    with np.load(file) as stored:
        return [str(name) for name in stored["names"]], stored["parents"].tolist()


def outlier_video(file: Path, kind: str, sampling: str) -> CapturedVideo:
    """A video of another action's file, left out of the truth."""
    videos = trial_videos(file, 1) if kind == "trials" else protocol_videos(file, sampling, 2)
    return replace(videos[-1], is_outlier=True)


def video_rng(name: str, video: int, purpose: int) -> np.random.Generator:
    """The random generator of one video of an action, one for each purpose."""
    digest = hashlib.sha256(name.encode()).digest()
    return np.random.default_rng([SEED, int.from_bytes(digest[:4], "big"), video, purpose])


# What a benchmark runs, checked: its name, the simulated inputs, the actions.

NAMES = ("protocol", "trials", "yoga", "real", "h36m")
AS_GIVEN = ("yoga", "real")  # nothing about them can be chosen
MADE_VIEWS = ("protocol", "trials")  # filmed by as many made cameras as are asked for
TITLES = {
    "protocol": "The paper's protocol: one motion, resampled",
    "trials": "The real task: every video another performance",
    "yoga": "The project's own demo",
    "real": "Real video of four phones",
    "h36m": "Human3.6M: the paper's data and protocol",
}
DATA = {
    "protocol": "CMU motion capture (mocap.cs.cmu.edu, NSF EIA-0196217), five clips",
    "trials": "CMU motion capture (mocap.cs.cmu.edu, NSF EIA-0196217), six actions; tennis strokes "
    "of Pulgarin-Giraldo et al., LNCS 10125 (2017), four actions",
    "yoga": "made by the project",
    "real": "Pose2Sim's demos (BSD-3-Clause); the reference is their calibrated triangulation",
    "h36m": "Human3.6M, subjects S9 and S11, 2D by CPN fine-tuned on it (VideoPose3D's files)",
}
RESAMPLED = ("protocol", "h36m")


@dataclass(frozen=True)
class Choice:
    """What to run.

    detector: level of the simulated 2D detector. sampling: how one motion is resampled (protocol
    and h36m). videos: at most, per action. only: the actions (all when empty). outlier: whether a
    video of another action is added. data: folder with the files of Human3.6M.
    """

    name: str
    detector: str = "fine_tuned"
    sampling: str = "released"
    videos: int = DEFAULT_VIDEOS
    only: tuple[str, ...] = ()
    outlier: bool = False
    data: Path | None = None

    def __post_init__(self) -> None:
        for option, value, allowed in (
            ("benchmark", self.name, NAMES),
            ("--detector", self.detector, tuple(DETECTORS)),
            ("--sampling", self.sampling, captured.SAMPLINGS),
        ):
            if value not in allowed:
                raise WrongUse(f"{option}: expected one of {', '.join(allowed)}, got {value!r}")
        most = MAX_VIDEOS if self.name in MADE_VIEWS else DEFAULT_VIDEOS
        if not 1 <= self.videos <= most:
            raise WrongUse(f"--videos: expected 1 to {most}, got {self.videos}")
        if self.name == "h36m" and self.data is None:
            raise WrongUse("--data: the benchmark h36m needs the folder with VideoPose3D's files")

    @property
    def label(self) -> str:
        """The name of this choice's folder and table."""
        parts = [self.set_label]
        if self.name in ("protocol", "trials"):
            parts.append(self.detector)
        if self.name not in AS_GIVEN:
            parts.append(f"{self.videos}v")
        return "-".join([*parts, "outlier"] if self.outlier else parts)

    @property
    def set_label(self) -> str:
        """The name of its data, without the detector and the number of videos."""
        return f"{self.name}-{self.sampling}" if self.name in RESAMPLED else self.name

    @property
    def command(self) -> str:
        """The command that measures all actions of this choice."""
        words = [f"imocap benchmark {self.name}"]
        if self.name in ("protocol", "trials"):
            words.append(f"--detector {self.detector}")
        if self.name not in AS_GIVEN:
            words.append(f"--videos {self.videos}")
        if self.name in RESAMPLED:
            words.append(f"--sampling {self.sampling}")
        if self.data is not None:
            words.append("--data FOLDER")
        return " ".join(words)

    def folder(self, root: Path) -> Path:
        """The folder of its actions, artifacts, scores and tables."""
        return root / "artifacts" / "benchmark" / self.label
