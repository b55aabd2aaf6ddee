"""How good a video's hypotheses are, and which of them the videos chose jointly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.adapters.observations import alternatives_of, body_for, motions_of, observations_of
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Sync,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.evaluate.scoreboard import StageResult, against_truth, true_joints, video_truth
from imocap_core.io.truth import Truth
from imocap_core.metrics.scoring import CameraJoints
from imocap_core.motion.monocular.fit import fit_monocular
from imocap_core.motion.monocular.hypotheses import alternatives
from imocap_core.motion.monocular.starts import (
    Library,
    Start,
    fit_rotations_to_joints,
    make_library,
    start_at_joints,
)
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body, mirrored_pose
from imocap_core.params import Params
from imocap_core.rotations import exp

NEAR = 1.2  # of the least error


@dataclass(frozen=True)
class HypothesisRow:
    """The motions of one video; errors are MPJPE, millimetres."""

    action: str
    view: str
    starts: str  # of the views that were started wrong
    count: int
    first_mm: float  # of the likeliest motion
    best_mm: float  # of the best motion
    chosen_mm: float
    possible_mm: float  # of a fit that is started at the true joints


def hypothesis_rows(
    action: str,
    starts: str,
    keypoints: Keypoints,
    initial: InitialSmpl,
    sync: Sync,
    truth: Truth | None,
    possible: Sequence[float],
) -> list[HypothesisRow]:
    """One row a video."""
    rows = []
    for video, first, least in zip(keypoints.videos, initial.videos, possible, strict=True):
        others = {a.name: a.motion for a in initial.alternatives if a.motion.id == video.id}
        errors = {name: _error_mm(motion, video, truth) for name, motion in others.items()}
        first_mm = _error_mm(first, video, truth)
        chosen = sync.alternatives.get(video.id)
        rows.append(
            HypothesisRow(
                action=action,
                view=video.id,
                starts=starts,
                count=1 + len(errors),
                first_mm=first_mm,
                best_mm=min([first_mm, *errors.values()]),
                chosen_mm=first_mm if chosen is None else errors[chosen],
                possible_mm=least,
            )
        )
    return rows


def summary(rows: Sequence[HypothesisRow]) -> str:
    """How often the best motion is near the best possible one, and how often it is chosen."""
    reached = sum(r.best_mm <= NEAR * min(r.best_mm, r.possible_mm) for r in rows)
    taken = sum(r.chosen_mm <= NEAR * r.best_mm for r in rows)
    likeliest = sum(r.first_mm <= NEAR * r.best_mm for r in rows)
    return (
        f"motions within 20 %: the best of a video's motions of the best possible in {reached} of "
        f"{len(rows)}; the chosen one of the best in {taken}, the likeliest one in {likeliest}"
    )


def possible_mm(
    keypoints: Keypoints, cameras: CameraMotion, truth: Truth | None, params: Params
) -> list[float]:
    """Error of each video's monocular fit started at its true joints; NaN without truth."""
    body, prior, options = body_for(keypoints), load_pose_prior(), params.initial_smpl
    rng = np.random.default_rng(len(keypoints.videos))
    library = make_library(
        body, prior, rng, poses=options.library_poses, directions=options.library_directions
    )
    errors = []
    observations = observations_of(body, keypoints, cameras, params.fit)
    for video, observation in zip(keypoints.videos, observations, strict=True):
        given = true_joints(video_truth(truth, video.id), video.frames)
        if given is None:
            errors.append(float("nan"))
            continue
        R_local = fit_rotations_to_joints(body, library, _as_smpl(given))
        start = start_at_joints(body, R_local, observation)
        fit = fit_monocular(
            body, prior, [observation], [[start]], params.fit,
            stride=max(1, round(options.stride_s * observation.fps)), max_steps=options.max_steps,
        )  # fmt: skip
        motion = motions_of(body, fit.state, [observation], Keypoints(videos=[video]))[0]
        errors.append(_error_mm(motion, video, truth))
    return errors


def _as_smpl(joints: CameraJoints) -> np.ndarray:
    """(T, 24, 3) in SMPL's order, NaN where the truth has no such joint."""
    names = list(joints.names)
    out = np.full((len(joints.frames), len(SMPL_JOINTS), 3), np.nan)
    for place, name in enumerate(SMPL_JOINTS):
        if name in names:
            out[:, place] = joints.joints_m[:, names.index(name)]
    return out


def _error_mm(motion: VideoMotion, video: VideoKeypoints, truth: Truth | None) -> float:
    result = StageResult("motion", [motion])
    return against_truth(result, Keypoints(videos=[video]), truth)["mpjpe_mm"]


# A video's monocular fit from a wrong start: the local minimum that such a start leads to.
#
# Three ways in which monocular fits go wrong: the performer faces the other way, the depth of every
# joint is reversed, and both at once, which is the mirror image in depth with left and right
# swapped.

WrongStart = Literal["facing", "depth", "sides"]


@dataclass(frozen=True)
class WrongView:
    """A video, by index, and how its monocular fit is started wrong."""

    video: int
    start: WrongStart


def wrongly_started(
    keypoints: Keypoints,
    cameras: CameraMotion,
    initial: InitialSmpl,
    views: Sequence[WrongView],
    params: Params,
) -> InitialSmpl:
    """The monocular motions, those of some videos fitted anew from a wrong start alone.

    A wrong fit takes the place of the likeliest motion, and the video's alternatives are what the
    stage makes of that fit: nothing of the undisturbed fits of these videos is left.
    """
    body, prior, options = body_for(keypoints), load_pose_prior(), params.initial_smpl
    library = make_library(
        body, prior, np.random.default_rng(len(keypoints.videos)),
        poses=options.library_poses, directions=options.library_directions,
    )  # fmt: skip
    observations = observations_of(body, keypoints, cameras, params.fit)
    videos, disturbed = list(initial.videos), {keypoints.videos[w.video].id for w in views}
    alternatives_stored = [a for a in initial.alternatives if a.motion.id not in disturbed]
    for wrong in views:
        observation = observations[wrong.video]
        start = _wrong_start(body, library, videos[wrong.video], wrong.start, observation)
        stride = max(1, round(options.stride_s * observation.fps))
        fit = fit_monocular(
            body, prior, [observation], [[start]], params.fit,
            stride=stride, max_steps=options.max_steps,
        )  # fmt: skip
        others = alternatives(
            body, prior, library, [observation], fit.coarse, params.fit,
            videos=[0], count=options.hypotheses - 1,
        )  # fmt: skip
        alone = Keypoints(videos=[keypoints.videos[wrong.video]])
        videos[wrong.video] = motions_of(body, fit.state, [observation], alone)[0]
        alternatives_stored += alternatives_of(body, others, [observation], alone)
    return initial.model_copy(update={"videos": videos, "alternatives": alternatives_stored})


def _wrong_start(
    body: Body, library: Library, motion: VideoMotion, wrong: WrongStart, observation: Observation
) -> Start:
    if wrong == "depth":
        R_local = fit_rotations_to_joints(body, library, depth_reversed(motion.joints))
    else:
        R_local = facing_reversed(motion, sides_swapped=wrong == "sides")
    return start_at_joints(body, R_local, observation)


def depth_reversed(joints: Float[np.ndarray, "T 24 3"]) -> Float[np.ndarray, "T 24 3"]:
    """Joints behind the root before it, and the reverse; the picture hardly changes."""
    root = joints[:, :1]
    return np.asarray(root + (joints - root) * np.array([1.0, 1.0, -1.0]))


def facing_reversed(motion: VideoMotion, *, sides_swapped: bool) -> Float[Tensor, "T 24 3 3"]:
    """Rotations of a body turned by half a turn about the camera's vertical axis.

    ``sides_swapped``: its mirror image, so that the picture stays but for left and right.
    """
    theta = mirrored_pose(motion.theta) if sides_swapped else motion.theta
    R_local = exp(torch.as_tensor(theta).reshape(-1, 24, 3))
    half_turn = torch.diag(R_local.new_tensor([-1.0, 1.0, -1.0]))
    R_local[:, 0] = half_turn @ R_local[:, 0]
    return R_local
