"""Derived of a result: clean clips, mean performance, mean angles, other worlds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.biomechanics.joint_angles import MeanCurve, angle_names, mean_curve
from imocap_core.camera.gravity import GroundAlignment, heading, on_floor, y_up_axes
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.metrics.trajectory import MM_PER_M
from imocap_core.motion.motion_cleaning import lock_feet
from imocap_core.result.body import body_model, local_rotations, posed_joints
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult
from imocap_core.result.video_motion import moved, video_angles
from imocap_core.rotations import exp, log, mean
from imocap_core.variation import Variation

Kind = TypeVar("Kind", bound=ActionResult)
POINTS = [SMPL_JOINTS.index(f"{s}_{p}") for s in ("left", "right") for p in ("ankle", "foot")]


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


def with_locked_feet(result: Kind) -> tuple[Kind, dict[str, FootLock]]:
    """Every video with feet that stand where they are in contact with the ground."""
    locked = {video.id: _lock(result, video) for video in result}
    videos = tuple(video for video, _ in locked.values())
    return replace(result, videos=videos), {name: lock for name, (_, lock) in locked.items()}


def _lock(result: ActionResult, video: VideoResult) -> tuple[VideoResult, FootLock]:
    model = body_model(video.model, video.action, hands=False)
    R, joints = local_rotations(video.theta), video.body_joints
    height = result.ground.height_m(joints)
    locked = lock_feet(R, joints, model.parents, np.asarray(height), video.fps)
    done = _with_motion(video, locked.R_local, video.trans)
    slid, slides = (
        MM_PER_M * np.linalg.norm(np.diff(x[:, POINTS], axis=0), axis=-1)[locked.contact]
        for x in (joints, done.body_joints)
    )
    moved = MM_PER_M * np.linalg.norm(done.body_joints - joints, axis=-1)
    return done, FootLock(
        contact_pct=float(100 * locked.contact.mean()),
        slid_mm=float(slid.mean()) if len(slid) else 0.0,
        slides_mm=float(slides.mean()) if len(slides) else 0.0,
        moved_mm=float(moved.mean()),
        most_mm=float(moved.max()),
        short=int((~locked.reached).sum()),
    )


def _with_motion(
    video: VideoResult, R_local: Float[np.ndarray, "T 24 3 3"], trans: Float[np.ndarray, "T 3"]
) -> VideoResult:
    """The same with another motion of the body."""
    theta = log(torch.as_tensor(R_local)).numpy().reshape(len(R_local), -1)
    model = body_model(video.model, video.action, hands=False)
    joints = posed_joints(model, video.betas, theta, trans)
    return replace(video, theta=theta, trans=trans, body_joints=joints)


NAME = "mean"
FADE_S = 0.25  # in which a performance that begins or ends gains or loses its weight


def mean_performance(result: Kind) -> Kind:
    """A result of one video, `mean`: the mean of the videos' poses and root paths.

    The result is on the common time axis. Rotations are averaged on the manifold (chordal mean),
    the bodies' shapes too. A moment that no video shows is that of the nearest poses. The camera
    and everything else are the reference's.
    """
    videos = result.videos
    weights = np.stack([fade(video.inside, video.fps) for video in videos])
    nobody = weights.sum(axis=0) == 0
    weights[:, nobody] = 1.0
    R = torch.as_tensor(np.stack([local_rotations(video.theta) for video in videos]))
    turned = mean(R, torch.as_tensor(weights)[..., None])
    theta = log(turned).numpy().reshape(len(videos[0]), -1)
    share = weights / weights.sum(axis=0)
    trans = np.einsum("mt,mti->ti", share, np.stack([video.trans for video in videos]))
    betas = np.mean([video.betas for video in videos], axis=0)
    first = result[result.reference] if result.reference in result else videos[0]
    model = body_model(first.model, result.action, hands=False)
    clip = replace(
        first,
        id=NAME,
        theta=theta,
        betas=betas,
        trans=trans,
        body_joints=posed_joints(model, betas, theta, trans),
        hands=None,
        inside=~nobody,
        joint_uncertainty=None,
    )
    return replace(result, videos=(clip,), reference=NAME)


_END_SD = 2.0  # standard deviations from the mean to an end of a mode


def mode_clips(mean: Kind, variation: Variation) -> Kind:
    """A result of clips: the mean performance, and both ends of each mode of variation.

    mean: of `mean_performance`. Moments that the variation is not known at turn as its nearest.
    """
    (clip,) = mean.videos
    R = local_rotations(clip.theta)
    joints = len(variation.joint_names)
    nearest = np.interp(clip.phase_s, variation.phase_s, np.arange(len(variation.phase_s)))
    videos = [clip]
    for k, turns in enumerate(variation.modes.turns[:, np.rint(nearest).astype(np.int64)]):
        for sign, end in ((1, "plus"), (-1, "minus")):
            turned = R.copy()
            turned[:, :joints] = (
                R[:, :joints] @ exp(torch.as_tensor(sign * _END_SD * turns)).numpy()
            )
            name = f"mode{k + 1}_{end}"
            videos.append(replace(_with_motion(clip, turned, clip.trans), id=name))
    return replace(mean, videos=tuple(videos))


def fade(inside: Bool[np.ndarray, " T"], fps: float) -> Float[np.ndarray, " T"]:
    """Weights that rise from 0 outside to 1 within `FADE_S` of the first and last moment shown."""
    shown = np.flatnonzero(inside)
    if len(shown) == 0:
        return np.zeros(len(inside))
    t = np.arange(len(inside))
    depth = np.minimum(t - shown[0], shown[-1] - t) + 1.0
    return np.where(inside, np.clip(depth / (FADE_S * fps + 1), 0.0, 1.0), 0.0)


@dataclass(frozen=True, eq=False)
class MeanAngles:
    """Joint angles over the N moments of the common time axis.

    phase_s (N,): seconds of the reference. curves: mean and standard deviation over the
    performances, by name.
    """

    phase_s: Float[np.ndarray, " N"]
    curves: dict[str, MeanCurve]


def mean_angles(result: ActionResult) -> MeanAngles:
    """Mean joint angles of a result on the common time axis, in a world whose y points up."""
    each = [video_angles(video) for video in result]
    inside = [video.inside for video in result]
    curves = {
        n: mean_curve(
            [a.angles_deg[n] for a in each],
            inside,
            [a.deviation_sd_deg[n] for a in each if n in a.deviation_sd_deg],
        )
        for n in angle_names()
    }
    return MeanAngles(result.videos[0].phase_s, curves)


def from_start(result: Kind, video: VideoResult) -> Kind:
    """The same in a world with the origin on the floor under the first pose of one of its videos
    (or of their mean), which faces forward (+z with y up, -y with z up).

    ValueError unless the result is levelled.
    """
    up = result.up_axis
    if up not in ("y", "z"):
        raise ValueError(f"up: expected a levelled world, got {up} up")
    t = int(np.argmax(video.inside))
    to_y = y_up_axes(up)
    turn = to_y.T @ heading(to_y @ video.rotations[t : t + 1, 0])[0].T @ to_y
    place = GroundAlignment(turn, -turn @ on_floor(video.body_joints[t, 0], up))
    return replace(
        result,
        videos=tuple(moved(v, place) for v in result.videos),
        ground=result.ground.moved(turn, place.t),
    )


def turned_y_up(result: Kind) -> Kind:
    """The same with y up: (x, y, z) becomes (x, z, -y). One that has y up stays as it is.

    ValueError unless the result is levelled.
    """
    if result.up_axis == "y":
        return result
    if result.up_axis != "z":
        raise ValueError(f"up: expected a levelled world, got {result.up_axis} up")
    turn = GroundAlignment(y_up_axes("z"), np.zeros(3))
    return replace(
        result,
        videos=tuple(moved(video, turn) for video in result.videos),
        ground=result.ground.moved(turn.R_upright_from_world, turn.t),
        up_axis="y",
    )
