"""Motions to correspondences: the artifact of a synchronisation from poses and hints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import nan

import numpy as np
from jaxtyping import Float

from imocap_core.adapters import hypotheses
from imocap_core.adapters.sync_maps import stored_affinities, stored_maps
from imocap_core.artifacts.schemas import (
    CameraMotion,
    CycleTriple,
    InitialSmpl,
    Keypoints,
    Sync,
    SyncMap,
    SyncSummary,
    SyncTrust,
    VideoKeypoints,
    VideoTrust,
)
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.params import SyncParams
from imocap_core.sync import Hints, SyncEvidence, SyncResult, synchronise
from imocap_core.sync.comparable_poses import picture_heights
from imocap_core.sync.freeze_frames import DistinctFrames, distinct_frames, frozen_runs
from imocap_core.sync.screening.screening import Screening, sentences

TRUNK = ("left_hip", "right_hip", "left_shoulder", "right_shoulder")


def evidence_of(
    joints: Sequence[Float[np.ndarray, "_ 24 3"]],
    keypoints: Keypoints,
    hints: Hints | None = None,
    cameras: CameraMotion | None = None,
    unfit: Sequence[int] = (),
) -> SyncEvidence:
    """Motions as a synchronisation takes them; frames without any detection are bridged.

    Args:
        joints: of every video of `keypoints`, metres, in its own camera's axes.
        cameras: their own motion, where known; unfit: videos whose detections fit no body.
    """
    return SyncEvidence(
        joints,
        fps=[video.fps for video in keypoints.videos],
        confidence=_detected(joints, keypoints),
        twins=mirror_indices(SMPL_JOINTS),
        keypoints=[hypotheses.keypoints_of_joints(video) for video in keypoints.videos],
        heights=_heights(joints, keypoints, cameras),
        hints=hints or Hints(),
        unfit=unfit,
    )


def synchronise_motions(
    evidence: SyncEvidence,
    keypoints: Keypoints,
    params: SyncParams,
    rng: np.random.Generator,
    *,
    reference: str | None = None,
    decided: SyncSummary | None = None,
) -> Sync:
    """Synchronise motions by their joints (`evidence_of`).

    Args:
        reference: id of the reference video, chosen by centrality when None.
        decided: an earlier synchronisation whose mirrored and excluded videos stay as they are.
    """
    ids = [video.id for video in keypoints.videos]
    evidence = replace(evidence, reference=None if reference is None else ids.index(reference))
    screening = None if decided is None else _screening_of(decided)
    result = synchronise(evidence, params, rng, screening)
    sync = _sync_artifact(result, ids, evidence.fps)
    if decided is None:
        return sync.model_copy(update={"notes": [*sync.notes, *_freeze_notes(keypoints)]})
    unchanged = {"notes": decided.notes, "alternatives": decided.alternatives}
    return sync.model_copy(update=unchanged)


def _freeze_notes(keypoints: Keypoints) -> list[str]:
    """A sentence for every freeze frame of every video."""
    return [
        f"{video.id} shows one picture for {(b - a + 1) / video.fps:.1f} s (frames "
        f"{video.frames[a]} to {video.frames[b]}): all of them are matched to one moment"
        for video in keypoints.videos
        for a, b in distinct_pictures(video).runs
    ]


def distinct_pictures(video: VideoKeypoints) -> DistinctFrames:
    """The distinct pictures of a video, by its keypoints."""
    points = hypotheses.keypoints_of_joints(video)
    frozen = frozen_runs(points.xy_px, points.weight > 0, video.fps)
    return distinct_frames(frozen, len(video.frames))


def _detected(
    joints: Sequence[Float[np.ndarray, "_ 24 3"]], keypoints: Keypoints
) -> list[Float[np.ndarray, "_ 24"]]:
    """Confidences of the joints: 1 in frames with any detection."""
    detected = [(video.confidence > 0).max(axis=1).astype(float) for video in keypoints.videos]
    return [
        np.repeat(of_frames[:, None], of_video.shape[1], axis=1)
        for of_frames, of_video in zip(detected, joints, strict=True)
    ]


def _heights(
    joints: Sequence[Float[np.ndarray, "_ 24 3"]],
    keypoints: Keypoints,
    cameras: CameraMotion | None,
) -> list[Float[np.ndarray, "_"]]:
    """Heights of the trunk in the picture, in metres, without the camera's own motion."""
    trunk, heights = [SMPL_JOINTS.index(name) for name in TRUNK], []
    for v, (of_video, video) in enumerate(zip(joints, keypoints.videos, strict=True)):
        if cameras is not None:
            video = video.model_copy(update={"xy_px": cameras.videos[v].xy_first_px})
        points = hypotheses.keypoints_of_joints(video)
        h = picture_heights(points.xy_px, points.weight, of_video, trunk, video.fps)
        heights.append(h)
    return heights


def synchronise_joints(
    joints: Sequence[Float[np.ndarray, "_ 24 3"]],
    ids: Sequence[str],
    fps: Sequence[float],
    params: SyncParams,
    rng: np.random.Generator,
    *,
    reference: str | None = None,
) -> Sync:
    """Synchronise clips by SMPL's joints (T, 24, 3) alone; any axes and unit, NaN = missing.

    ValueError for shapes that don't fit.
    """
    evidence = SyncEvidence(
        joints,
        fps,
        twins=mirror_indices(SMPL_JOINTS),
        reference=None if reference is None else list(ids).index(reference),
    )
    return _sync_artifact(synchronise(evidence, params, rng), ids, fps)


def _sync_artifact(result: SyncResult, ids: Sequence[str], fps: Sequence[float]) -> Sync:
    """The artifact of a synchronisation; ids, fps: of the videos, in its order."""
    return Sync(
        reference=ids[result.reference],
        ids=list(ids),
        lengths=[len(frames) for frames in result.reference_frame],
        maps=[
            SyncMap(id=name, reference_frame=frame, confidence=confidence)
            for name, frame, confidence in zip(
                ids, result.reference_frame, result.confidence, strict=True
            )
        ],
        method=result.cycle.method,
        centrality=result.centrality,
        status=result.status,
        excluded=[ids[v] for v in result.screening.excluded],
        mirrored=[ids[v] for v in result.screening.flipped],
        notes=sentences(result.screening, ids),
        trust=_trust(result, ids, fps),
        affinity=stored_affinities(result.affinity, list(ids)),
        relaxed=stored_maps(result.relaxed),
    )


def summary_of(sync: Sync) -> SyncSummary:
    """A synchronisation without its matrices."""
    return SyncSummary.model_validate({n: getattr(sync, n) for n in SyncSummary.model_fields})


def _screening_of(decided: SyncSummary) -> Screening:
    """The screening of an earlier synchronisation, from its artifact."""
    excluded, flipped = (
        tuple(v for v, name in enumerate(decided.ids) if name in names)
        for names in (decided.excluded, decided.mirrored)
    )
    videos = [] if decided.trust is None else decided.trust.videos
    scores, margins = (
        np.array([getattr(v, name) for v in videos])
        if videos
        else np.full(len(decided.ids), np.nan)
        for name in ("outlier_score", "mirror_margin")
    )
    return Screening(excluded, flipped, excluded, flipped, scores, margins)


def _trust(result: SyncResult, ids: Sequence[str], fps: Sequence[float]) -> SyncTrust:
    """The numbers that tell how far to trust each video's map."""
    screening = result.screening
    return SyncTrust(
        videos=[
            VideoTrust(
                id=name,
                phase_s=result.phase[v],
                phase_confidence=result.phase_confidence[v],
                outlier_score=float(screening.outlier_score[v]),
                mirror_margin=float(screening.mirror_margin[v]),
                left_out_frames=float(result.left_out_frames[v]),
                left_out_s=float(result.left_out_frames[v]) / fps[result.reference],
                left_out_share=float(result.left_out_share[v]),
                repetition_s=nan if other is None else other.shift_frames / fps[result.reference],
                repetition_ratio=nan if other is None else other.ratio,
            )
            for v, (name, other) in enumerate(zip(ids, result.repetitions, strict=True))
        ],
        triples=[
            CycleTriple(
                videos=[ids[v] for v in triple.videos],
                frames=triple.frames,
                seconds=triple.seconds,
                share=triple.share,
            )
            for triple in result.cycle_residuals
        ],
    )


def synchronise_monocular(
    initial: InitialSmpl,
    keypoints: Keypoints,
    params: SyncParams,
    rng: np.random.Generator,
    *,
    mirrored: Sequence[bool | None],
    reference: str | None = None,
    hints: Hints | None = None,
    cameras: CameraMotion | None = None,
) -> Sync:
    """Choose every video's motion, then screen and synchronise; as of `synchronise_motions`.

    Args:
        mirrored: per video True or False where action.yaml states it.
    """
    chosen = hypotheses.choose_alternatives(initial, keypoints, mirrored)
    joints = [motion.joints for motion in hypotheses.chosen_motions(initial, chosen.names)]
    unfit = hypotheses.unfit_videos(initial)
    evidence = evidence_of(joints, keypoints, hints, cameras, unfit)
    evidence = replace(evidence, mirrored=mirrored)
    sync = synchronise_motions(evidence, keypoints, params, rng, reference=reference)
    notes = [*chosen.notes, *sync.notes]
    return sync.model_copy(update={"notes": notes, "alternatives": chosen.names})
