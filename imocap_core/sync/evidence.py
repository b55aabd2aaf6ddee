"""What a synchronisation goes by: the poses of all videos, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from imocap_core.sync.anchors import Hints, check_hints
from imocap_core.sync.comparable_poses import body_scales, check_poses, joint_weights_of
from imocap_core.sync.screening.explanation import mirrored_poses
from imocap_core.sync.screening.registration import Keypoints2D
from imocap_core.sync.warp.reprojection_evidence import ReprojectionEvidence


@dataclass(frozen=True)
class SyncEvidence:
    """The videos of a synchronisation; M of them.

    Attributes:
        poses: per video, one unit for all, any axes and origin (each pose is aligned rigidly),
            NaN = missing.
        fps: per video.
        confidence: per video, in [0, 1].
        twins: each joint's mirror twin, needed to detect mirrored videos.
        keypoints: of the poses' joints in the same frames; where given, they decide which videos
            are mirrored or show another action, not the poses.
        heights: per video, height of the trunk in the unit of the poses, from any origin
            (`picture_heights`); NaN unknown.
        hints: anchors and forbidden spans.
        mirrored: per video True or False where that is given by the user.
        reference: index of the reference video; chosen by centrality when None.
        rates: seconds of the action per second of each video (`estimated_rates`), when they were
            estimated before.
        unfit: videos whose detections fit no body.
        reprojection: keypoints and cameras of the videos that are not excluded, as reflected.
    """

    poses: Sequence[Float[np.ndarray, "_T _J 3"]]
    fps: Sequence[float]
    confidence: Sequence[Float[np.ndarray, "_T J"]] | None = None
    twins: Sequence[int] | None = None
    keypoints: Sequence[Keypoints2D] | None = None
    heights: Sequence[Float[np.ndarray, "_T"]] | None = None
    hints: Hints = field(default_factory=Hints)
    mirrored: Sequence[bool | None] | None = None
    reference: int | None = None
    rates: Float[np.ndarray, " M"] | None = None
    unfit: Sequence[int] = ()
    reprojection: ReprojectionEvidence | None = None

    @property
    def lengths(self) -> list[int]:
        """Frames of each video."""
        return [len(x) for x in self.poses]

    def check(self) -> None:
        """ValueError for shapes that don't fit, or impossible hints; names every fault."""
        check_poses(self.poses, self.confidence, self.fps)
        if self.reference is not None and not 0 <= self.reference < len(self.poses):
            raise ValueError(
                f"reference: expected 0 to {len(self.poses) - 1}, got {self.reference}"
            )
        check_hints(self.hints, self.lengths)

    @cached_property
    def scaled(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Poses (T_v, J, 3) in body sizes, and the weights of their joints."""
        scales = body_scales(self.poses)
        scaled = [x / s for x, s in zip(self.poses, scales, strict=True)]
        return scaled, joint_weights_of(self.poses, self.confidence)

    def without_forbidden(self) -> SyncEvidence:
        """The same, with confidence 0 in forbidden frames."""
        if not self.hints.forbidden:
            return self
        given = self.confidence or [np.ones(x.shape[:2]) for x in self.poses]
        forbidden = self.hints.forbidden_frames(self.lengths)
        confidence = [np.where(f[:, None], 0.0, c) for f, c in zip(forbidden, given, strict=True)]
        return replace(self, confidence=confidence)

    def reflected(self, flipped: Sequence[int]) -> SyncEvidence:
        """The same, some videos' poses as their mirror image (nothing without twins)."""
        if self.twins is None:
            return self
        order = list(self.twins)
        poses, confidence = list(self.poses), self.confidence
        for v in flipped:
            poses[v] = mirrored_poses(poses[v], order)
        if confidence is not None:
            confidence = [c[:, order] if v in flipped else c for v, c in enumerate(confidence)]
        return replace(self, poses=poses, confidence=confidence)

    def among(self, videos: Sequence[int]) -> SyncEvidence:
        """What concerns some videos, renumbered in their order; the reference is one of them."""
        confidence, heights, rates = self.confidence, self.heights, self.rates
        return replace(
            self,
            poses=[self.poses[v] for v in videos],
            fps=[self.fps[v] for v in videos],
            confidence=None if confidence is None else [confidence[v] for v in videos],
            keypoints=None if self.keypoints is None else [self.keypoints[v] for v in videos],
            heights=None if heights is None else [heights[v] for v in videos],
            hints=self.hints.among(videos),
            mirrored=None if self.mirrored is None else [self.mirrored[v] for v in videos],
            reference=None if self.reference is None else list(videos).index(self.reference),
            rates=None if rates is None else rates[list(videos)],
            unfit=[n for n, v in enumerate(videos) if v in self.unfit],
        )
