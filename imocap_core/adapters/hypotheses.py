"""Monocular motions of all videos: those of lowest cost, or as the videos chose them jointly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imocap_core.artifacts.schemas import (
    AlternativeMotion,
    InitialSmpl,
    Keypoints,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.motion.state import mirrored_joints
from imocap_core.sync.hypotheses import CandidateMotions, choose_jointly, sentences
from imocap_core.sync.screening.registration import Keypoints2D, reflected_keypoints

FIRST = "best"  # name of the motion of lowest cost
MISFIT = 0.085  # error of hidden limbs above which detections fit no body (docs/sync.md)


@dataclass(frozen=True)
class ChosenAlternatives:
    """Videos whose motion is another than that of lowest cost, by name, and what is to be said."""

    names: dict[str, str]
    notes: list[str]


def unfit_videos(initial: InitialSmpl) -> list[int]:
    """Numbers of the videos whose detections fit no body; none where fewer than two others do."""
    errors = [initial.limb_errors.get(video.id, np.nan) for video in initial.videos]
    unfit = [v for v, error in enumerate(errors) if error > MISFIT]
    return unfit if len(errors) - len(unfit) >= 2 else []


def chosen_motions(initial: InitialSmpl, chosen: Mapping[str, str]) -> list[VideoMotion]:
    """The motion of every video; ``chosen``: names of alternatives by video."""
    by_name = {(a.motion.id, a.name): a.motion for a in initial.alternatives}
    return [by_name[m.id, chosen[m.id]] if m.id in chosen else m for m in initial.videos]


def choose_alternatives(
    initial: InitialSmpl, keypoints: Keypoints, mirrored: Sequence[bool | None]
) -> ChosenAlternatives:
    """The joint choice of all videos.

    Args:
        mirrored: per video True where it is declared to be mirrored.
    """
    if not initial.alternatives:
        return ChosenAlternatives({}, [])
    unfit = unfit_videos(initial)
    taken = [v for v in range(len(mirrored)) if v not in unfit]
    rows = [(initial.videos[v], keypoints.videos[v], mirrored[v]) for v in taken]
    ids = [motion.id for motion, *_ in rows]
    others = [[a for a in initial.alternatives if a.motion.id == i] for i in ids]
    candidates = [
        _candidates(motion, of_video, video, bool(declared))
        for of_video, (motion, video, declared) in zip(others, rows, strict=True)
    ]
    choice = choose_jointly(candidates)
    labels = [[FIRST, *(a.name for a in of_video)] for of_video in others]
    names = {i: labels[v][k] for v, (i, k) in enumerate(zip(ids, choice.labels, strict=True)) if k}
    return ChosenAlternatives(names, sentences(choice, ids, labels))


def _candidates(
    motion: VideoMotion, others: Sequence[AlternativeMotion], video: VideoKeypoints, reflect: bool
) -> CandidateMotions:
    """A video's motions, the first one and others; seen in a mirror where it is mirrored itself."""
    film = keypoints_of_joints(video)
    if reflect:
        film = reflected_keypoints(film, mirror_indices(SMPL_JOINTS))
    joints = [motion.joints, *(other.motion.joints for other in others)]
    motions = [mirrored_joints(x) if reflect else x for x in joints]
    excess = np.array([0.0, *(a.excess_cost for a in others)])
    return CandidateMotions(motions, film, excess, video.fps)


LIMB_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")  # marked alike by detectors


def keypoints_of_joints(video: VideoKeypoints) -> Keypoints2D:
    """A video's keypoints as SMPL's 24 joints; limbs only, other joints have no weight."""
    names = layout_names(video.layout)
    xy_px, weight = np.zeros((len(video.frames), 24, 2)), np.zeros((len(video.frames), 24))
    for joint, name in enumerate(SMPL_JOINTS):
        if name in names and name.rpartition("_")[2] in LIMB_JOINTS:
            column = names.index(name)
            visible = np.isfinite(video.xy_px[:, column]).all(-1)
            xy_px[visible, joint] = video.xy_px[visible, column]
            weight[:, joint] = np.where(visible, video.confidence[:, column], 0.0)
    return Keypoints2D(xy_px, weight)
