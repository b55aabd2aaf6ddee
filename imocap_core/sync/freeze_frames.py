"""Freeze frames: videos as videos of distinct pictures, and results for all their frames.

A freeze frame is a run of frames with one and the same picture. A person who stands still is
detected a little elsewhere in every frame; in a picture that is shown again nothing moves at all.
To the synchronisation such a run is one frame: a second of it is no slow motion, and no thirty
observations of one pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.sequences import runs
from imocap_core.sync.anchors import Hints
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.joint_synchronisation import SyncResult
from imocap_core.sync.maps import BandedMap, BlockMaps, Blocks
from imocap_core.sync.screening.registration import Keypoints2D
from imocap_core.sync.warp.reprojection_evidence import ReprojectionEvidence

SAME = 2e-4  # of the body's size: less than any detector's errors in two pictures
LEAST_S, LEAST_FRAMES = 0.2, 4  # shorter ones are repeated frames of a converted frame rate


@dataclass(frozen=True)
class DistinctFrames:
    """The distinct pictures of a video of T frames.

    Attributes:
        first, last: of the frames that show each picture.
        picture: which picture each frame shows.
    """

    first: Int[np.ndarray, " D"]
    last: Int[np.ndarray, " D"]
    picture: Int[np.ndarray, " T"]

    @property
    def repeated(self) -> bool:
        """Whether any picture is shown again."""
        return len(self.first) < len(self.picture)

    @property
    def runs(self) -> list[tuple[int, int]]:
        """First and last frame of every freeze frame."""
        again = self.last > self.first
        return list(zip(self.first[again].tolist(), self.last[again].tolist(), strict=True))

    @property
    def times_shown(self) -> Int[np.ndarray, " T"]:
        """How many frames show the picture that each frame shows."""
        return (self.last - self.first + 1)[self.picture]

    def in_frames(self, position: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
        """Positions among the pictures as positions among the frames; NaN stays NaN. Between two
        pictures, one after the last frame of the earlier one."""
        valid = np.isfinite(position)
        low = np.where(valid, np.floor(position), 0).astype(int)
        beyond = position - low
        frame = np.where(beyond > 0, self.last[low], self.first[low])
        return np.asarray(np.where(valid, frame + beyond, np.nan))


def distinct_frames(frozen: Sequence[tuple[int, int]], length: int) -> DistinctFrames:
    """The pictures of a video whose runs `frozen` (first and last frame) show one each."""
    new = np.ones(length, dtype=bool)
    for begin, end in frozen:
        new[begin + 1 : end + 1] = False
    first = np.flatnonzero(new)
    last = np.append(first[1:] - 1, length - 1) if length else first
    return DistinctFrames(first, last, np.cumsum(new) - 1)


def frozen_runs(
    points: Float[np.ndarray, "T J D"], visible: Bool[np.ndarray, "T J"], fps: float
) -> list[tuple[int, int]]:
    """First and last frame of every freeze frame: the same points, in the same places."""
    if len(points) < 2 or not visible.any():
        return []
    both = visible[1:] & visible[:-1]
    moved = np.where(both[..., None], np.diff(np.nan_to_num(points), axis=0), 0.0)
    square = (moved**2).sum(axis=(1, 2)) / np.maximum(both.sum(axis=1), 1)
    alike = (visible[1:] == visible[:-1]).all(axis=1) & both.any(axis=1)
    same = alike & (np.sqrt(square) < SAME * _size(points, visible))
    least = max(LEAST_FRAMES, round(LEAST_S * fps))
    return [(a, b + 1) for a, b in runs(same, least - 1)]


def _size(points: np.ndarray, visible: np.ndarray) -> float:
    """Diagonal of the box around the visible points, as large as in one frame of ten."""
    low = np.where(visible[..., None], points, np.inf).min(axis=1)
    high = np.where(visible[..., None], points, -np.inf).max(axis=1)
    present = visible.any(axis=1)
    return float(np.quantile(np.linalg.norm(high[present] - low[present], axis=-1), 0.9))


def distinct_videos(evidence: SyncEvidence) -> list[DistinctFrames]:
    """Per video its distinct pictures, by the keypoints where they are given, else by the poses."""
    if evidence.keypoints is None:
        points = [(x, np.isfinite(x).all(axis=-1)) for x in evidence.poses]
    else:
        points = [(k.xy_px, k.weight > 0) for k in evidence.keypoints]
    return [
        distinct_frames(frozen_runs(x, visible, f), len(x))
        for (x, visible), f in zip(points, evidence.fps, strict=True)
    ]


def of_pictures(
    evidence: SyncEvidence, videos: Sequence[DistinctFrames], excluded: Sequence[int] = ()
) -> SyncEvidence:
    """The evidence with one frame a picture; `excluded`: videos without reprojection."""
    if not any(d.repeated for d in videos):
        return evidence
    first = [d.first for d in videos]
    confidence, keypoints = evidence.confidence, evidence.keypoints
    heights, reprojection = evidence.heights, evidence.reprojection
    if confidence is not None:
        confidence = [c[f] for c, f in zip(confidence, first, strict=True)]
    if keypoints is not None:
        rows = zip(keypoints, first, strict=True)
        keypoints = [Keypoints2D(k.xy_px[f], k.weight[f]) for k, f in rows]
    if heights is not None:
        heights = [h[f] for h, f in zip(heights, first, strict=True)]
    if reprojection is not None:
        among = [d for v, d in enumerate(videos) if v not in excluded]
        reprojection = _reprojection_of_pictures(reprojection, among)
    return replace(
        evidence,
        poses=[x[f] for x, f in zip(evidence.poses, first, strict=True)],
        confidence=confidence,
        keypoints=keypoints,
        heights=heights,
        hints=hints_of_pictures(evidence.hints, videos),
        reprojection=reprojection,
    )


def hints_of_pictures(hints: Hints, videos: Sequence[DistinctFrames]) -> Hints:
    """The hints with frames as pictures. A span is forbidden up to its last picture."""

    def picture(video: int, frame: float) -> float:
        frames = videos[video].picture
        return float(np.interp(frame, np.arange(len(frames)), frames))

    return Hints(
        tuple(
            replace(x, frame_a=round(picture(x.a, x.frame_a)), frame_b=picture(x.b, x.frame_b))
            for x in hints.anchors
        ),
        tuple(
            (v, int(videos[v].picture[first]), int(videos[v].picture[stop - 1]) + 1)
            for v, first, stop in hints.forbidden
        ),
    )


def _reprojection_of_pictures(
    evidence: ReprojectionEvidence, videos: Sequence[DistinctFrames]
) -> ReprojectionEvidence:
    """Keypoints and motions of the distinct pictures; `videos` in the evidence's order."""
    rows = zip(evidence.videos, videos, strict=True)
    parts = [
        replace(v, xyz_m=v.xyz_m[d.first], xy_px=v.xy_px[d.first], weight=v.weight[d.first])
        for v, d in rows
    ]
    return replace(evidence, videos=parts)


def of_all_frames(result: SyncResult, videos: Sequence[DistinctFrames]) -> SyncResult:
    """A result of the distinct pictures for all frames: those of one picture share its match, its
    phase and its confidence, as one observation."""
    if not any(d.repeated for d in videos):
        return result
    reference = videos[result.reference]
    frames = [
        reference.in_frames(x)[d.picture]
        for x, d in zip(result.reference_frame, videos, strict=True)
    ]
    frames[result.reference] = np.arange(float(len(reference.picture)))
    return replace(
        result,
        reference_frame=frames,
        confidence=[
            c[d.picture] / d.times_shown for c, d in zip(result.confidence, videos, strict=True)
        ],
        phase=[p[d.picture] for p, d in zip(result.phase, videos, strict=True)],
        phase_confidence=[
            c[d.picture] / d.times_shown
            for c, d in zip(result.phase_confidence, videos, strict=True)
        ],
        affinity=result.affinity.of_frames([d.picture for d in videos]),
        relaxed=_maps_of_frames(result.relaxed, videos),
    )


def _maps_of_frames(maps: BlockMaps, videos: Sequence[DistinctFrames]) -> BlockMaps:
    """The maps between pictures as maps between frames."""
    pictures = [d.picture for d in videos]
    pairs = {
        (i, j): BandedMap.of(soft_map.dense()[np.ix_(pictures[i], pictures[j])])
        for (i, j), soft_map in maps.pairs.items()
    }
    return BlockMaps(Blocks(tuple(len(p) for p in pictures)), pairs)
