"""The time axis of the common motion beyond the reference's first and last frame.

Other videos may begin earlier or end later. What two of them show there they settle together, as
everywhere else: the axis is continued as far as two videos reach, for the solve alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.multiview.timeline import BeyondReference, make_timeline
from imocap_core.motion.state import MotionState

NEAR_END = 0.5  # frames: so far beyond an end is still that frame


@dataclass(frozen=True)
class Axis:
    """The common motion's frames: those of the reference, and so many before and after them."""

    before: int
    frames: int
    after: int

    @property
    def of_reference(self) -> slice:
        """The reference's frames among all."""
        return slice(self.before, self.before + self.frames)


def continued(scene: Scene) -> tuple[Scene, Axis]:
    """The scene on the axis continued as far as two videos reach, and that axis."""
    frames = scene.timeline.from_reference.shape[1]
    places = [
        _with_places(position, beyond)
        for position, beyond in zip(scene.timeline.to_reference, scene.beyond, strict=True)
    ]
    axis = _axis(places, frames)
    if axis.before + axis.after == 0:
        return scene, axis
    confidences, shifted = [], []
    low, high = -axis.before - NEAR_END, frames + axis.after - 1 + NEAR_END
    for v, place in enumerate(places):
        on_axis = (place >= low) & (place <= high)
        is_beyond = ~np.isfinite(scene.timeline.to_reference[v])
        trust = np.where(is_beyond, scene.beyond[v].confidence, scene.confidences[v])
        confidences.append(np.where(on_axis, trust, 0.0))
        shifted.append(np.where(on_axis, place + axis.before, np.nan))
    timeline = make_timeline(shifted, confidences, axis.before + frames + axis.after)
    return replace(scene, timeline=timeline, confidences=confidences), axis


def within_reference(motion: JointMotion, axis: Axis) -> JointMotion:
    """A motion solved on a continued axis, its common motion at the reference's frames alone."""
    if axis.before + axis.after == 0 or motion.common is None or motion.spread is None:
        return motion
    keypoints_m = motion.spread.keypoints_m[:, axis.of_reference]
    return replace(
        motion,
        common=_frames_of(motion.common, axis.of_reference),
        spread=replace(motion.spread, keypoints_m=keypoints_m),
    )


def _with_places(
    position: Float[np.ndarray, " T"], beyond: BeyondReference
) -> Float[np.ndarray, " T"]:
    """Positions on the axis, those beyond the reference's ends with them: before a video's first
    match or after its last."""
    matched: Int[np.ndarray, " _"] = np.flatnonzero(np.isfinite(position))
    if not len(matched):
        return position
    frame = np.arange(len(position))
    outside = (frame < matched[0]) | (frame > matched[-1])
    return np.where(outside & (beyond.confidence > 0), beyond.position, position)


def _axis(places: Sequence[Float[np.ndarray, " _"]], frames: int) -> Axis:
    """The axis as far as two videos reach."""
    on_axis = [place[np.isfinite(place)] for place in places]
    first = sorted(float(place.min()) for place in on_axis if len(place))
    last = sorted(float(place.max()) for place in on_axis if len(place))
    if len(first) < 2:
        return Axis(0, frames, 0)
    before, after = np.ceil(-first[1]), np.ceil(last[-2]) - (frames - 1)
    return Axis(max(0, int(before)), frames, max(0, int(after)))


def _frames_of(motion: MotionState, frames: slice) -> MotionState:
    """Some frames of a motion."""
    return replace(
        motion.uncached(),
        R_local=motion.R_local[:, frames],
        trans=motion.trans[:, frames],
        valid=motion.valid[:, frames],
    )
