"""SMPL-BA: the motion of every video and all cameras, jointly (Eq. 8).

``motion.objective=shared`` (default) fits ONE motion to all views' 2D at once and gives each video
back as much freedom as its own image evidence asks for. ``single`` stops before that last step: one
motion for all videos. The paper's own way is `low_rank.alternated`.

Other videos may begin earlier or end later than the reference. The axis of the common motion is
continued as far as two videos reach, for the solve alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int

from imocap_core.motion.monocular.fit import Progress
from imocap_core.motion.multiview.common_motion import CommonFit, fit_in_stages
from imocap_core.motion.multiview.low_rank import alternated
from imocap_core.motion.multiview.per_video import fit_deviations, follow_common
from imocap_core.motion.multiview.scene import (
    Cameras,
    JointMotion,
    Scene,
    cameras_from_motion,
    shared_shapes,
)
from imocap_core.motion.multiview.timeline import BeyondReference, make_timeline
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams

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
    if not scene.beyond:
        return scene, Axis(0, frames, 0)
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
    return replace(
        motion,
        common=motion.common.uncached().of_frames(axis.of_reference),
        spread=motion.spread.of_frames(axis.of_reference),
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


def solve_jointly(
    scene: Scene,
    start: MotionState,
    options: MotionParams,
    progress: Progress = lambda _: None,
    *,
    cameras: Cameras | None = None,
    restart: bool = False,
) -> JointMotion:
    """SMPL-BA by ``motion.objective``, from motions in their own camera axes (batch of M).

    Args:
        cameras: of an earlier result that ``start`` is part of (``paper`` begins anew all the
            same).
        restart: fit through all robust scales all the same, and every deviation from the common
            motion, instead of going on where the earlier result stopped.
    """
    if len(scene.observations) == 1:
        return _single_video(scene, start)
    if options.objective == "paper":
        return alternated(scene, start, options, progress)
    if options.objective == "shared":
        return recover_motion(scene, start, options, progress, cameras=cameras, restart=restart)
    begun = scene, *_begun(scene, start, cameras), options, progress
    return common_then_deviations(*begun, restart=restart or cameras is None)


def recover_motion(
    scene: Scene,
    start: MotionState,
    options: MotionParams,
    progress: Progress = lambda _: None,
    *,
    cameras: Cameras | None = None,
    restart: bool = False,
) -> JointMotion:
    """One motion for all views, then each video's deviation from it, on an axis that may reach
    beyond the reference. Arguments as of `solve_jointly`, of two videos or more."""
    begins = cameras is None
    scene, axis = continued(scene)
    begun = scene, *_begun(scene, start, cameras), options, progress
    motion = common_then_deviations(*begun, restart=restart or begins, with_modes=not begins)
    return within_reference(motion, axis)


def _begun(
    scene: Scene, start: MotionState, cameras: Cameras | None
) -> tuple[MotionState, Cameras]:
    """The motions with one shape a performer, and the cameras."""
    state = shared_shapes(start, scene.performers)
    return state, cameras or cameras_from_motion(scene, state, scene.K.to(state.trans))


def common_then_deviations(
    scene: Scene,
    state: MotionState,
    cameras: Cameras,
    options: MotionParams,
    progress: Progress = lambda _: None,
    *,
    cameras_known: bool = False,
    restart: bool = True,
    with_modes: bool = False,
) -> JointMotion:
    """One motion for all views, then, but for ``single``, each video's deviation from it.

    Args:
        state: every video's motion in its own camera's axes, one body a performer.
        cameras: where they start, or where they are and stay (``cameras_known``).
        restart: begin at the widest robust scale; else state and cameras are an earlier result of
            this function, and it goes on where that stopped.
        with_modes: the state is an earlier result, which tells how performances differ.
    """
    begun = scene, state, cameras, options, progress
    common = fit_in_stages(
        *begun, cameras_known=cameras_known, restart=restart, with_modes=with_modes
    )
    solved = scene.with_intrinsics(common.cameras)
    if options.objective == "single":
        state = follow_common(solved, state, common.motion, common.cameras, options)
        return _joint_motion(common, state, f"one motion for all: {common.status}")
    progress("each video's own deviation")
    given = solved, state, common.motion, common.cameras, common.spread, options
    state, cost = fit_deviations(*given, restart=restart)
    return _joint_motion(common, state, f"shared motion {common.status}", cost)


def _joint_motion(common: CommonFit, state: MotionState, status: str, *costs: float) -> JointMotion:
    """A common motion and every video's; costs: of what was fitted after the common one."""
    return JointMotion(
        state, common.cameras, common.motion.uncached(), common.spread, [*common.costs, *costs],
        status, common.misfit,
    )  # fmt: skip


def _single_video(scene: Scene, start: MotionState) -> JointMotion:
    eye, zero = torch.eye(3).to(start.trans)[None], torch.zeros(1, 3).to(start.trans)
    cameras = Cameras(eye, zero, scene.K.to(eye))
    status = "one video: the monocular motion stands"
    return JointMotion(start, cameras, None, None, [], status, 0.0)
