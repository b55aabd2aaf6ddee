"""Motion cleaned for characters: a clip that loops, feet that stand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.camera.world import y_up_axes
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.metrics.world import MM_PER_M
from imocap_core.motion.foot_lock import lock_feet
from imocap_core.motion.loop import RootedMotion, looped
from imocap_core.result.body import body_model, local_rotations, posed_joints
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult
from imocap_core.rotations import log

Kind = TypeVar("Kind", bound=ActionResult)
POINTS = [SMPL_JOINTS.index(f"{s}_{p}") for s in ("left", "right") for p in ("ankle", "foot")]
COPIES = 3  # of a loop: the one in the middle has neighbours on both sides


@dataclass(frozen=True)
class FootLock:
    """What locking the feet of one video changed.

    contact_pct: share of frames, of ankles and balls. slid_mm, slides_mm: mean movement of points
    in contact from frame to frame, before and after. moved_mm, most_mm: of all joints, mean and
    largest. short: frames in which a leg is too short for where its foot stands.
    """

    contact_pct: float
    slid_mm: float
    slides_mm: float
    moved_mm: float
    most_mm: float
    short: int


def loop(result: Kind, in_place: bool) -> Kind:
    """Every video as a clip that can be repeated (`motion.loop`); the result is levelled."""
    return replace(result, videos=tuple(_loop(v, result.up_axis, in_place) for v in result))


def with_locked_feet(result: Kind, loops: bool) -> tuple[Kind, dict[str, FootLock]]:
    """Every video with feet that stand where they are in contact with the ground.

    loops: the videos are loops, and stay so.
    """
    locked = {video.id: _lock(result, video, loops) for video in result}
    videos = tuple(video for video, _ in locked.values())
    return replace(result, videos=videos), {name: lock for name, (_, lock) in locked.items()}


def _loop(video: VideoResult, up: str, in_place: bool) -> VideoResult:
    to_y = y_up_axes(up)
    R, pelvis = local_rotations(video.theta), video.body_joints[:, 0]
    R[:, 0] = to_y @ R[:, 0]
    closed = looped(RootedMotion(R, pelvis @ to_y.T), video.fps, in_place)
    R_local = closed.R_local.copy()
    R_local[:, 0] = to_y.T @ R_local[:, 0]
    return _with_motion(video, R_local, video.trans + closed.pelvis @ to_y - pelvis)


def _lock(result: ActionResult, video: VideoResult, loops: bool) -> tuple[VideoResult, FootLock]:
    model = body_model(video.model, video.action, hands=False)
    R, joints = local_rotations(video.theta), video.body_joints
    repeated = (R, joints)
    if loops:
        repeated = _repeated(R, joints)
    height = result.ground.height_m(repeated[1])
    locked = lock_feet(*repeated, model.parents, np.asarray(height), video.fps)
    once = slice(len(R) - 1, 2 * len(R) - 1) if loops else slice(0, len(R))
    R_local = locked.R_local[once]
    R_local[:, 0] = R[:, 0]
    done = _with_motion(video, R_local, video.trans)
    contact = locked.contact[once.start : once.stop - 1]
    slid, slides = (
        MM_PER_M * np.linalg.norm(np.diff(x[:, POINTS], axis=0), axis=-1)[contact]
        for x in (joints, done.body_joints)
    )
    moved = MM_PER_M * np.linalg.norm(done.body_joints - joints, axis=-1)
    return done, FootLock(
        contact_pct=float(100 * contact.mean()),
        slid_mm=float(slid.mean()) if len(slid) else 0.0,
        slides_mm=float(slides.mean()) if len(slides) else 0.0,
        moved_mm=float(moved.mean()),
        most_mm=float(moved.max()),
        short=int((~locked.reached[once]).sum()),
    )


def _repeated(
    R: Float[np.ndarray, "T J 3 3"], joints: Float[np.ndarray, "T J 3"]
) -> tuple[Float[np.ndarray, "N J 3 3"], Float[np.ndarray, "N J 3"]]:
    """A loop several times, each going on from where the one before ended."""
    turn = R[-1, 0] @ R[0, 0].T
    path = joints[-1, 0] - turn @ joints[0, 0]
    rotations, places = [R[:-1]], [joints[:-1]]
    for _ in range(COPIES - 1):
        again = rotations[-1].copy()
        again[:, 0] = turn @ again[:, 0]
        rotations.append(again)
        places.append(places[-1] @ turn.T + path)
    return np.concatenate(rotations), np.concatenate(places)


def _with_motion(
    video: VideoResult, R_local: Float[np.ndarray, "T 24 3 3"], trans: Float[np.ndarray, "T 3"]
) -> VideoResult:
    """The same with another motion of the body."""
    theta = log(torch.as_tensor(R_local)).numpy().reshape(len(R_local), -1)
    model = body_model(video.model, video.action, hands=False)
    joints = posed_joints(model, video.betas, theta, trans)
    return replace(video, theta=theta, trans=trans, body_joints=joints)
