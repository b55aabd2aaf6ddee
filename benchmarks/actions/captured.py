"""Captured motion as the videos of an action: who moves how, and which frames a video keeps."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imocap_core.conventions import EVAL_14
from imocap_core.errors import WorkFailed
from imocap_core.synthetic.captured import VIEWPOINTS, to_stage
from imocap_core.synthetic.samplings import sample_frames
from imocap_core.synthetic.trials import on_one_stage

Floats = NDArray[np.float64]

DATA_VARIABLE = "IMOCAP_DATA"
SIZE = (1000, 1000)
SEED = 7
MAX_VIDEOS = len(VIEWPOINTS)
# Resampled clips jump where no real performance does: up to a whole segment in one frame.
RESAMPLED_MAX_RATE = 30.0


@dataclass(frozen=True)
class Filmed:
    """A real video's camera (from the stage) and 2D detections: xy_px (T, 18, 2) in COCO's order
    (NaN where nothing is marked)."""

    K: Floats
    R: Floats
    t: Floats
    xy_px: Floats
    size: tuple[int, int]


@dataclass(frozen=True)
class Shot:
    """One video to be: joints (T, 14, 3) on the stage where it is filmed, phase (T,), and the
    frames that the video keeps. The truth speaks of a common world that may lie elsewhere.

    A stranger shows another action: the truth does not speak of it. `filmed`: what a real camera
    and detector gave, where nothing of it has to be simulated. `scored_m`: what the truth holds, in
    the order of `names`, where that is more than the 14 joints."""

    joints_m: Floats
    phase: Floats
    kept: NDArray[np.int64]
    fps: float  # of joints_m
    R_common_from_stage: Floats = field(default_factory=lambda: np.eye(3))
    t_common: Floats = field(default_factory=lambda: np.zeros(3))
    stranger: bool = False
    filmed: Filmed | None = None
    scored_m: Floats | None = None  # (T, J, 3)
    names: tuple[str, ...] = EVAL_14

    def truth(self, video: str, K: Floats, R: Floats, t: Floats) -> dict[str, Floats]:
        """What truth.npz holds of it; R, t is the camera from the stage."""
        R_cam_from_common = R @ self.R_common_from_stage.T
        scored = self.joints_m if self.scored_m is None else self.scored_m
        joints = scored[self.kept] @ self.R_common_from_stage.T + self.t_common
        parts = {
            "joints": joints,
            "phase": self.phase[self.kept],
            "K": K,
            "R": R_cam_from_common,
            "t": t - R_cam_from_common @ self.t_common,
        }
        return {f"{video}/{name}": value for name, value in parts.items()}


def data_folder(root: Path, kind: str) -> Path:
    """The folder of captured motion `kind` (protocol, trials); WorkFailed says where it was looked
    for."""
    named = os.environ.get(DATA_VARIABLE)
    base = Path(named) if named else root.resolve().parent / "shared" / "data"
    folder = base / kind
    if not any(folder.glob("*.npz")):
        raise WorkFailed(
            f"the benchmark {kind} needs captured motion, and {folder} holds no .npz file; put the "
            f"data there or set {DATA_VARIABLE} to the folder that holds {kind}/ (the benchmark "
            "yoga needs no data)"
        )
    return folder


def protocol_shots(file: Path, sampling: str, videos: int) -> list[Shot]:
    """One motion, resampled for each video."""
    with np.load(file) as stored:
        joints = stored["joints"][:, stored["common14_idx"]].astype(np.float64)
        fps = float(stored["fps"])
    turn, shift = to_stage(joints)
    world = turn.apply(joints.reshape(-1, 3)).reshape(joints.shape) + shift
    phase = np.arange(len(world), dtype=np.float64)
    return [
        Shot(world, phase, sample_frames(sampling, len(world), v, drawn(file.stem, v, 0)), fps)
        for v in range(videos)
    ]


def trial_shots(file: Path, videos: int) -> list[Shot]:
    """Another performance for each video, the file's first ones."""
    with np.load(file) as stored:
        index, fps = stored["common14_idx"], float(stored["fps"])
        count = min(videos, len(stored["trial_ids"]))
        trials = [stored[f"trial_{v:02d}"][:, index].astype(np.float64) for v in range(count)]
    return [
        Shot(p.joints_m, p.phase, np.arange(len(p.phase)), fps, p.R_common_from_stage, p.t_common)
        for p in on_one_stage(trials)
    ]


def outlier_shot(file: Path, kind: str, sampling: str) -> Shot:
    """A video of another action's file, about which nothing is known."""
    shot = trial_shots(file, 1)[0] if kind == "trials" else protocol_shots(file, sampling, 2)[1]
    return replace(shot, stranger=True)


def drawn(name: str, video: int, purpose: int) -> np.random.Generator:
    """The generator of one action's video, one for each purpose."""
    digest = hashlib.sha256(name.encode()).digest()
    return np.random.default_rng([SEED, int.from_bytes(digest[:4], "big"), video, purpose])
