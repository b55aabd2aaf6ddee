"""Which frames of an action's videos show the same moment, as values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Real

from imocap_core.artifacts.schemas import SyncSummary
from imocap_core.errors import WrongUse


@dataclass(frozen=True, eq=False)
class FrameMatches:
    """For every used frame of one video the frame of another that shows the same moment.

    index (T,): fractional position among the other video's used frames. frame (T,): the same as a
    fractional source frame number. confidence (T,): 0 to 1. NaN, NaN and 0 where none does.
    """

    index: Float[np.ndarray, " T"]
    frame: Float[np.ndarray, " T"]
    confidence: Float[np.ndarray, " T"]


@dataclass(frozen=True, eq=False)
class VideoSync:
    """One video's place on the common time axis.

    Attributes:
        id: the video.
        fps: its frames per second.
        frames: (T,) source frame numbers of its used frames; fractional where the frame rate is
            variable.
        reference_frame: (T,) fractional position among the reference's used frames, NaN unmatched.
        confidence: (T,) 0 to 1.
        phase_s: (T,) place on the time axis of all videos, seconds of the reference; NaN unknown.
    """

    id: str
    fps: float
    frames: Real[np.ndarray, " T"]
    reference_frame: Float[np.ndarray, " T"]
    confidence: Float[np.ndarray, " T"]
    phase_s: Float[np.ndarray, " T"]


@dataclass(frozen=True, eq=False)
class Synchronisation:
    """The correspondences of all videos.

    Attributes:
        videos: by id, in the order of the action; also `sync[id]`.
        reference: id of the video whose time axis is used.
        excluded: videos of another action, unmatched throughout.
        mirrored: videos treated as their mirror image.
        status: one sentence on the result; notes: what was noticed about single videos.
        method: by which the maps were made consistent.
        summary: the stored artifact.
    """

    videos: Mapping[str, VideoSync]
    summary: SyncSummary

    @property
    def ids(self) -> tuple[str, ...]:
        """The videos."""
        return tuple(self.videos)

    @property
    def reference(self) -> str:
        """The video whose time axis is used."""
        return self.summary.reference

    @property
    def excluded(self) -> tuple[str, ...]:
        """Videos of another action, unmatched throughout."""
        return tuple(self.summary.excluded)

    @property
    def mirrored(self) -> tuple[str, ...]:
        """Videos treated as their mirror image."""
        return tuple(self.summary.mirrored)

    @property
    def status(self) -> str:
        """One sentence on the result."""
        return self.summary.status

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about single videos."""
        return tuple(self.summary.notes)

    def __getitem__(self, video: str) -> VideoSync:
        """One video; WrongUse when there is none of this id."""
        if video not in self.videos:
            raise WrongUse(f"no video {video!r}; there are: {', '.join(self.videos)}")
        return self.videos[video]

    def matches(self, video: str, other: str) -> FrameMatches:
        """For every used frame of `video` the frame of `other` that shows the same moment.

        Against the reference these are the correspondences of the artifact; between two other
        videos the frames at equal phases, with the lower of both confidences.
        """
        one, two = self[video], self[other]
        if other == self.reference:
            index, confidence = one.reference_frame, one.confidence
        else:
            index = _index_at(two.phase_s, one.phase_s)
            theirs = np.interp(index, np.arange(len(two.frames)), two.confidence)
            confidence = np.minimum(one.confidence, theirs)
        matched = np.isfinite(index)
        frame = np.interp(index, np.arange(len(two.frames)), two.frames)
        return FrameMatches(
            index=index,
            frame=np.where(matched, frame, np.nan),
            confidence=np.where(matched, confidence, 0.0),
        )


def _index_at(
    phase_s: Float[np.ndarray, " S"], at_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, " T"]:
    """(T,) fractional frames of a video of phases (S,) that never fall; NaN outside of them."""
    placed = np.flatnonzero(np.isfinite(phase_s))
    if not len(placed):
        return np.full(len(at_s), np.nan)
    index = np.interp(at_s, phase_s[placed], placed, left=np.nan, right=np.nan)
    return np.where(np.isfinite(at_s), index, np.nan)


def synchronisation_of(
    summary: SyncSummary, frames: Mapping[str, Real[np.ndarray, " _"]], fps: Mapping[str, float]
) -> Synchronisation:
    """From the artifact; frames: per video, the source frame numbers of its used frames."""
    phases = {} if summary.trust is None else {v.id: v.phase_s for v in summary.trust.videos}
    videos = {
        m.id: VideoSync(
            id=m.id,
            fps=fps[m.id],
            frames=frames[m.id],
            reference_frame=m.reference_frame,
            confidence=np.where(np.isfinite(m.reference_frame), np.nan_to_num(m.confidence), 0.0),
            phase_s=phases.get(m.id, np.full(len(m.reference_frame), np.nan)),
        )
        for m in summary.maps
    }
    return Synchronisation(videos, summary)
