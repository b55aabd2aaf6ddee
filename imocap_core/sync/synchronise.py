"""Synchronisation of videos by the 3D poses seen in them (section 3.1), from poses to warps.

Mirrored videos are reflected and videos of another action taken out first (`screening`), the rest
is synchronised jointly (`jointly`), and the answer speaks of all videos again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.params import SyncParams
from imocap_core.sync.anchors import Hints, check_hints
from imocap_core.sync.blocks import Blocks
from imocap_core.sync.cycle.report import CycleReport
from imocap_core.sync.joint_synchronisation import Joint, synchronise_jointly
from imocap_core.sync.map_consistency import Triple
from imocap_core.sync.pairwise.poses import body_scales, check_poses, joint_weights_of
from imocap_core.sync.screening.mirror import mirrored_poses
from imocap_core.sync.screening.screening import Screening, screen
from imocap_core.sync.warp.reprojection import ReprojectionEvidence

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SyncResult:
    """Where every frame of every video lies in the reference video, and how far to trust it.

    A video that was excluded is unmatched throughout: NaN, confidence 0, no phase, zeros in the
    matrices.
    """

    reference: int
    reference_frame: list[
        Array
    ]  # per video (T_v,) fractional index into the reference; NaN unmatched
    confidence: list[Array]  # per video (T_v,) in [0, 1]
    phase: list[Array]  # per video (T_v,) seconds of the reference on the common time axis
    affinity: NDArray[np.float32]  # (N_a, N_a)
    relaxed: NDArray[np.float32]  # (N_a, N_a), row-stochastic per block
    centrality: Array  # (M,), the reference has the largest unless it was given
    matched_square: float  # squared distance typical of matching frames
    cycle: CycleReport
    triples: list[Triple]  # going round three videos, pairwise maps
    left_out_frames: Array  # (M,) own map to the reference against the way through the others
    left_out_share: Array  # (M,) of the frames that both ways match
    screening: Screening
    status: str


def synchronise(
    poses: Sequence[Array],
    *,
    fps: Sequence[float],
    settings: SyncParams,
    rng: np.random.Generator,
    confidence: Sequence[Array] | None = None,
    joint_weights: Array | None = None,
    reference: int | None = None,
    twins: Sequence[int] | None = None,
    mirrored: Sequence[bool | None] | None = None,
    hints: Hints | None = None,
    decided: Screening | None = None,
    pictures: ReprojectionEvidence | None = None,
) -> SyncResult:
    """Find for every frame of every video its counterpart in the reference video.

    `poses`: per video (T_v, J, 3), one unit for all, any axes and origin (each pose is aligned
    rigidly), NaN = missing; `fps` per video; `confidence` per video (T_v, J) in [0, 1];
    `joint_weights` (J,); `reference`: the index of the reference video, chosen by centrality when
    None; `twins` (J,): each joint's mirror twin, needed to find mirrored videos; `mirrored`: per
    video True or False where that is known; `hints`: anchors and forbidden spans; `decided`: which
    videos are mirrored or another action, when that was found before; `pictures`: of the videos
    that are not excluded, as reflected. Raises ValueError for shapes that don't fit and for hints
    that can't be.
    """
    check_poses(poses, confidence, fps)
    M = len(poses)
    if reference is not None and not 0 <= reference < M:
        raise ValueError(f"reference: expected 0 to {M - 1}, got {reference}")
    lengths = [len(x) for x in poses]
    hints = hints or Hints()
    check_hints(hints, lengths)
    seen = _without_forbidden(poses, confidence, hints)
    found = decided or screen(
        [x / s for x, s in zip(poses, body_scales(poses), strict=True)],
        joint_weights_of(poses, seen, joint_weights),
        fps,
        outliers=settings.outliers,
        mirrored=settings.mirrored,
        twins=twins,
        declared=mirrored or [None] * M,
        max_rate=settings.max_rate,
        kept=[v == reference for v in range(M)],
    )
    used = [v for v in range(M) if v not in found.excluded]
    own = [_as_seen(v, poses, seen, found, twins) for v in used]
    joint = synchronise_jointly(
        [x for x, _ in own],
        fps=[fps[v] for v in used],
        settings=settings,
        rng=rng,
        confidence=None if seen is None else [c for _, c in own if c is not None],
        joint_weights=joint_weights,
        reference=None if reference is None else used.index(reference),
        eligible=[v not in found.flipped for v in used],
        hints=hints.among(used),
        pictures=pictures,
    )
    return _of_all(joint, used, lengths, found)


def _without_forbidden(
    poses: Sequence[Array], confidence: Sequence[Array] | None, hints: Hints
) -> list[Array] | None:
    """Confidences in which forbidden frames have no say."""
    if not hints.forbidden:
        return None if confidence is None else list(confidence)
    given = confidence or [np.ones(x.shape[:2]) for x in poses]
    no = hints.forbids([len(x) for x in poses])
    return [np.where(f[:, None], 0.0, c) for f, c in zip(no, given, strict=True)]


def _as_seen(
    v: int,
    poses: Sequence[Array],
    confidence: Sequence[Array] | None,
    found: Screening,
    twins: Sequence[int] | None,
) -> tuple[Array, Array | None]:
    """Poses and confidences of a video, reflected when it is to be flipped."""
    own = None if confidence is None else confidence[v]
    if v not in found.flipped or twins is None:
        return poses[v], own
    return mirrored_poses(poses[v], twins), None if own is None else own[:, list(twins)]


def _of_all(joint: Joint, used: list[int], lengths: list[int], found: Screening) -> SyncResult:
    """The joint answer with the excluded videos in their places."""
    nan = [np.full(n, np.nan) for n in lengths]
    frames, phase, trust = list(nan), list(nan), [np.zeros(n) for n in lengths]
    centrality, left_out, share = np.zeros(len(lengths)), *np.full((2, len(lengths)), np.nan)
    for k, v in enumerate(used):
        frames[v], phase[v], trust[v] = (
            joint.reference_frame[k],
            joint.phase[k],
            joint.confidence[k],
        )
    centrality[used], left_out[used], share[used] = (
        joint.centrality,
        joint.left_out_frames,
        joint.left_out_share,
    )
    return SyncResult(
        reference=used[joint.reference],
        reference_frame=frames,
        confidence=trust,
        phase=phase,
        affinity=_spread_out(joint.affinity, used, lengths),
        relaxed=_spread_out(joint.relaxed, used, lengths),
        centrality=centrality,
        matched_square=joint.matched_square,
        cycle=joint.cycle,
        triples=[
            Triple((used[t.videos[0]], used[t.videos[1]], used[t.videos[2]]), *t.numbers)
            for t in joint.triples
        ],
        left_out_frames=left_out,
        left_out_share=share,
        screening=found,
        status=_status(joint),
    )


def _spread_out(
    matrix: NDArray[np.float32], used: list[int], lengths: list[int]
) -> NDArray[np.float32]:
    """A matrix of the used videos' frames as one of all frames; the others know themselves only."""
    if len(used) == len(lengths):
        return matrix
    blocks = Blocks(tuple(lengths))
    rows = np.concatenate([np.arange(blocks.total)[blocks.rows(v)] for v in used])
    out = np.eye(blocks.total, dtype=np.float32)
    out[np.ix_(rows, rows)] = matrix
    return out


def _status(joint: Joint) -> str:
    """One sentence on what was found."""
    others = [v for v in range(len(joint.reference_frame)) if v != joint.reference]
    if not others:
        return "one video: nothing to synchronise"
    share = np.mean(np.concatenate([np.isfinite(joint.reference_frame[v]) for v in others]))
    certain = np.mean(np.concatenate([joint.confidence[v] for v in others]))
    return (
        f"{100 * share:.0f} % of the frames matched, mean confidence {certain:.2f}; "
        f"{joint.cycle.status}"
    )
