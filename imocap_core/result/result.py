"""What a run gave for an action: its videos in one world and on one time axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from imocap_core.biomechanics.events import MotionEvent
from imocap_core.camera.ground_plane import Ground
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.result.artifacts import Artifacts
from imocap_core.result.video import Synchronisation, VideoCamera, VideoMoment, VideoResult

Time = Literal["own", "common"]
Kind = TypeVar("Kind", bound="ActionResult")

CAMERA_UP = "-y"  # the world is the reference camera, whose y points down


@dataclass(frozen=True, eq=False)
class ActionResult:
    """All videos of an action, in the order of action.yaml. `len`, iteration and `result[id]` give
    the videos.

    Attributes:
        action: its name.
        videos: what the run gave for each.
        reference: the video whose camera is the world's origin and whose seconds are the phase.
        sync: which frames show the same moment.
        ground: the ground's plane in the result's world: `up` (a unit vector), `origin` (under the
            bodies), `tilt_sd_deg`, `height_sd_mm`, `height_m(points)`.
        up_axis: y or z of a levelled world, whose ground is at 0; -y: the reference camera's axes.
        time: own: every video's own frames; common: all videos at the moments of one grid.
        left_out: videos without a place on the common time axis.
        folder: of action.yaml, which paths of videos are relative to; None when unknown.
        artifacts: what the stages stored.
    """

    action: str
    videos: tuple[VideoResult, ...]
    reference: str
    sync: Synchronisation
    artifacts: Artifacts
    ground: Ground
    up_axis: str = CAMERA_UP
    time: Time = "own"
    left_out: tuple[str, ...] = ()
    folder: Path | None = None

    @property
    def ids(self) -> tuple[str, ...]:
        """The videos."""
        return tuple(video.id for video in self.videos)

    @property
    def model(self) -> str:
        """Name and digest of the body model."""
        return self.videos[0].model

    @property
    def cameras(self) -> dict[str, VideoCamera]:
        """Every video's camera, by id."""
        return {video.id: video.camera for video in self.videos}

    def __len__(self) -> int:
        """How many videos there are."""
        return len(self.videos)

    def __iter__(self) -> Iterator[VideoResult]:
        """The videos, in the order of action.yaml."""
        return iter(self.videos)

    def __contains__(self, video: object) -> bool:
        """Whether there is a video of this id."""
        return video in self.ids

    def __getitem__(self, video: str) -> VideoResult:
        """One video, by its id. WrongUse when there is none."""
        for result in self.videos:
            if result.id == video:
                return result
        raise WrongUse(f"{self.action} has no video {video!r}; there are: {', '.join(self.ids)}")

    def __repr__(self) -> str:
        videos = ", ".join(f"{video.id} ({len(video)} frames)" for video in self.videos)
        return f"<Result of {self.action}: {videos}; reference {self.reference}>"

    def levelled(self: Kind, up: str = "y") -> Kind:
        """The same in a world that stands on its ground: `up` ("y" or "z") points up, the ground
        is at 0, and the origin is under the bodies.

        With y up the reference camera looks along -z; z up is that world turned by a quarter, so
        that (x, y, z) becomes (x, -z, y).
        """
        from imocap_core.camera.gravity import upright_alignment
        from imocap_core.result.video_motion import moved

        if up not in ("y", "z"):
            raise WrongUse(f"up: expected y or z, got {up!r}")
        level = upright_alignment(self.ground, self[self.reference].camera.R, up)
        videos = tuple(moved(video, level) for video in self.videos)
        ground = self.ground.moved(level.R_upright_from_world, level.t)
        return replace(self, videos=videos, ground=ground, up_axis=up)

    def on_common_time(self: Kind) -> Kind:
        """Every video at the moments of one grid, in steps of the reference's frames.

        Before a video's first and after its last moment it stands still in its nearest pose
        (`inside` is False there). Videos without a place on the axis are left out. WorkFailed when
        none has one.
        """
        from imocap_core.result.video_motion import on_common_time

        placed = tuple(v for v in self.videos if np.isfinite(v.phase_s).any())
        if not placed:
            raise WorkFailed(
                f"{self.action} has no common time axis: its sync artifact has no phases. Leave "
                f"--time out for the videos' own timelines"
            )
        return replace(
            self,
            videos=on_common_time(placed, self[self.reference].fps),
            time="common",
            left_out=tuple(v.id for v in self.videos if v not in placed),
        )

    def only(self: Kind, videos: Sequence[str]) -> Kind:
        """The same with some of the videos, in the order given; all where none is named.

        WrongUse when there is no such video.
        """
        return replace(self, videos=tuple(self[v] for v in videos)) if videos else self

    def at_phase(self, phase_s: float) -> dict[str, VideoMoment]:
        """The same moment in every video that shows it, by id; `phase_s`: seconds of the reference.

        WrongUse when `phase_s` is no finite number.
        """
        from imocap_core.result.video_motion import at_phase

        if not np.isfinite(phase_s):
            raise WrongUse(f"phase_s: expected a finite number of seconds, got {phase_s}")
        return at_phase(self.videos, float(phase_s))

    def events(self) -> dict[str, list[MotionEvent]]:
        """Foot contacts, fastest moments of joints and turning points of joint angles, by video; in
        their order on its own timeline (`index` is a fractional position among its frames)."""
        from imocap_core.result.video_motion import video_angles, video_events

        level = self if self.up_axis in ("y", "z") else self.levelled()
        up, tilt = level.up_axis, level.ground.tilt_sd_deg
        return {v.id: video_events(v, video_angles(v, up, tilt), up) for v in level}
