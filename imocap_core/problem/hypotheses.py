"""Monocular motions of all videos: those of lowest cost, or as the videos chose them jointly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imocap_core.artifacts.schemas import AlternativeMotion, InitialSmpl, Keypoints, VideoMotion
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.motion.mirror import mirrored_joints
from imocap_core.problem.synchronisation import keypoints_of_joints
from imocap_core.sync.hypotheses.joint_choice import CandidateMotions, choose_jointly
from imocap_core.sync.hypotheses.messages import sentences
from imocap_core.sync.screening.mirrored_keypoints import reflected_keypoints

FIRST = "best"  # name of the motion of lowest cost


@dataclass(frozen=True)
class ChosenAlternatives:
    """Videos whose motion is another than that of lowest cost, by name, and what is to be said."""

    names: dict[str, str]
    notes: list[str]


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
    ids = [motion.id for motion in initial.videos]
    others = [[a for a in initial.alternatives if a.motion.id == i] for i in ids]
    candidates = [
        _candidates(motion, of_video, keypoints, v, reflect=bool(mirrored[v]))
        for v, (motion, of_video) in enumerate(zip(initial.videos, others, strict=True))
    ]
    choice = choose_jointly(candidates)
    labels = [[FIRST, *(a.name for a in of_video)] for of_video in others]
    names = {i: labels[v][k] for v, (i, k) in enumerate(zip(ids, choice.labels, strict=True)) if k}
    return ChosenAlternatives(names, sentences(choice, ids, labels))


def _candidates(
    motion: VideoMotion,
    alternatives: Sequence[AlternativeMotion],
    keypoints: Keypoints,
    v: int,
    *,
    reflect: bool,
) -> CandidateMotions:
    """A video's motions and keypoints; seen in a mirror where it is mirrored itself."""
    video = keypoints.videos[v]
    film, motions = keypoints_of_joints(video), [motion, *(a.motion for a in alternatives)]
    joints = [m.joints for m in motions]
    if reflect:
        film = reflected_keypoints(film, mirror_indices(SMPL_JOINTS))
        joints = [mirrored_joints(x) for x in joints]
    excess = np.array([0.0, *(a.excess_cost for a in alternatives)])
    return CandidateMotions(joints, film, excess, video.fps)
