"""A video's result in other forms: body, joint angles, events, common time, another world."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.biomechanics.events import (
    MotionEvent,
    angle_events,
    foot_contact_events,
    foot_contacts,
    speed_events,
    speed_spreads_m_s,
)
from imocap_core.biomechanics.joint_angles import angle_spreads_deg, joint_angles_deg
from imocap_core.body import Shaped
from imocap_core.camera.gravity import (
    BodyMotion,
    Extrinsics,
    FilmedBody,
    GroundAlignment,
    align_camera_to_ground,
    align_motion_to_ground,
    estimate_ground,
    y_up_axes,
)
from imocap_core.camera.ground_plane import Ground
from imocap_core.camera.tilt_evidence import LevelPrior
from imocap_core.conventions import JOINTS, SIDES, SMPL_JOINTS
from imocap_core.motion.multiview.timeline import (
    FramePositions,
    common_grid,
    frame_positions,
    pose_at,
    values_at,
)
from imocap_core.result.body import body_model, local_rotations, posed_joints
from imocap_core.result.video import HandMotion, VideoMoment, VideoResult
from imocap_core.rotations import log


def shaped_body(video: VideoResult) -> Shaped:
    """The performer's body at rest; with fingers where the video has hands."""
    model = body_model(video.model, video.action, hands=video.hands is not None)
    return model.shape(torch.as_tensor(video.betas))


BODY = len(SMPL_JOINTS)
UNKNOWN = ("_wrist_", "_pronation")  # the prior alone would speak, which is too sure of them
WITH_WRISTS = 3 * SMPL_JOINTS.index("left_hand")  # numbers of a pose up to the wrists


@dataclass(frozen=True, eq=False)
class VideoAngles:
    """Joint angles of one video over its T frames.

    angles_deg: by name, (T,); NaN where an angle is not defined. sd_deg: standard deviations; none
    of wrists and pronation, which keypoints of the body do not show (`UNKNOWN`), and none at all
    where the stage uncertainty has not run. deviation_sd_deg: the same with the motion common to
    all videos given: of the performance's deviation from it.
    """

    id: str
    angles_deg: dict[str, Float[np.ndarray, " T"]]
    sd_deg: dict[str, Float[np.ndarray, " T"]]
    deviation_sd_deg: dict[str, Float[np.ndarray, " T"]]


def video_angles(video: VideoResult, up: str = "y", tilt_sd_deg: float = np.nan) -> VideoAngles:
    """Joint angles of a video in a levelled world, whose axis `up` (y or z) points up.

    tilt_sd_deg: how well the ground tells where up is; NaN unknown.
    """
    R, rest = body_rotations(video, up), rest_joints_m(video)
    angles, uncertain = joint_angles_deg(R, rest), video.joint_uncertainty
    if uncertain is None:
        return VideoAngles(video.id, angles, {}, {})

    def spreads(covariance_deg2: np.ndarray, **world: float) -> dict[str, Float[np.ndarray, " T"]]:
        sd = angle_spreads_deg(R, rest, covariance_deg2.astype(np.float64), **world)
        return {name: x for name, x in sd.items() if not any(part in name for part in UNKNOWN)}

    return VideoAngles(
        video.id,
        angles,
        spreads(
            uncertain.rotation_covariance_deg2,
            tilt_sd_deg=tilt_sd_deg,
            camera_sd_deg=uncertain.camera_sd_deg,
        ),
        spreads(uncertain.deviation_covariance_deg2, tilt_sd_deg=0.0),
    )


def body_rotations(video: VideoResult, up: str = "y") -> Float[np.ndarray, "T 24 3 3"]:
    """Rotations of SMPL's 24 joints against their parents, the first in a world whose y points up.

    Wrists are those of the hands where the video has hands. up: the axis of the video's world.
    """
    wrists = video.poses[:, :WITH_WRISTS]
    R = local_rotations(np.concatenate([wrists, video.theta[:, WITH_WRISTS:]], axis=1))
    R[:, 0] = y_up_axes(up) @ R[:, 0]
    return R


def rest_joints_m(video: VideoResult) -> Float[np.ndarray, "24 3"]:
    """The performer's joints in the rest pose, metres."""
    model = body_model(video.model, video.action, hands=False)
    return posed_joints(model, video.betas, np.zeros((1, 3 * BODY)), np.zeros((1, 3)))[0]


FAST_JOINTS = ("pelvis", "head") + tuple(
    f"{side}_{joint}" for joint in ("wrist", "elbow", "knee", "ankle") for side in SIDES
)
FOOT = ("ankle", "foot")
AXIS = {"x": 0, "y": 1, "z": 2}


def video_events(video: VideoResult, angles: VideoAngles, up: str = "y") -> list[MotionEvent]:
    """The events of a video in a levelled world, whose axis `up` points up, in their order.

    angles: of the video.
    """
    paths = {joint: video.joint(joint) for joint in FAST_JOINTS}
    events = [
        *_contacts(video, up),
        *speed_events(paths, video.fps, _speed_spreads(video, paths)),
        *angle_events(angles.angles_deg, angles.sd_deg),
    ]
    return sorted(events, key=lambda event: event.index)


def contact_events(video: VideoResult, up: str = "y") -> list[MotionEvent]:
    """Where contacts of the feet begin and end, in their order."""
    return sorted(_contacts(video, up), key=lambda event: event.index)


def contact_frames(video: VideoResult) -> dict[str, list[tuple[int, int]]]:
    """First and last frame of every contact of each foot, by side."""
    return foot_contacts(*_feet(video, "y"), video.fps)


def _speed_spreads(video: VideoResult, paths_m: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Standard deviations of joints' speeds, m/s; none where the stage uncertainty has not run."""
    covariance = video.covariance_mm2
    if covariance is None:
        return {}
    return {
        joint: speed_spreads_m_s(path, covariance[:, SMPL_JOINTS.index(joint)], video.fps)
        for joint, path in paths_m.items()
    }


def _contacts(video: VideoResult, up: str) -> list[MotionEvent]:
    return foot_contact_events(*_feet(video, up), video.fps)


def _feet(video: VideoResult, up: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Ankle and ball of each foot (T, 2, 3), and the height of the lower one (T,); by side."""
    feet: dict[str, np.ndarray] = {
        side: video.body_joints[:, [SMPL_JOINTS.index(f"{side}_{joint}") for joint in FOOT]]
        for side in SIDES
    }
    heights = {side: np.asarray(p[..., AXIS[up]].min(axis=1)) for side, p in feet.items()}
    return feet, heights


def on_common_time(videos: Sequence[VideoResult], fps: float) -> tuple[VideoResult, ...]:
    """Every video at the moments of one grid, `fps` of them per second of the reference.

    Where a video shows nothing of a moment it stands still in its nearest pose (`inside` is False
    there). Every video must have a place on the axis.
    """
    grid_s = common_grid([v.phase_s for v in videos], fps)
    return tuple(
        replace(_resampled(v, frame_positions(v.phase_s, grid_s), grid_s), fps=fps) for v in videos
    )


def at_phase(videos: Sequence[VideoResult], phase_s: float) -> dict[str, VideoMoment]:
    """The same moment in every video that shows it, by id."""
    moments = {}
    for video in videos:
        if not np.isfinite(video.phase_s).any():
            continue
        where = frame_positions(video.phase_s, np.array([phase_s]))
        if not where.inside[0]:
            continue
        shown = _resampled(video, where, np.array([phase_s]))
        frame = float(shown.frames[0])
        moments[video.id] = VideoMoment(
            index=float(where.position[0]),
            frame=frame,
            time_s=float(video.keypoints.seconds_of(shown.frames)[0]),
            joints=shown.joints[0],
            confidence=float(shown.confidence[0]),
        )
    return moments


def _resampled(
    video: VideoResult, m: FramePositions, phase_s: Float[np.ndarray, " N"]
) -> VideoResult:
    """A video at the fractional frames of the moments `phase_s`."""
    theta, trans = pose_at(video.theta, m.position), values_at(video.trans, m.position)
    model = body_model(video.model, video.action, hands=False)
    camera = video.camera
    turning = log(torch.as_tensor(camera.R_first_from_frame)).numpy()
    turns = local_rotations(pose_at(turning, m.position))[:, 0]
    uncertain = video.joint_uncertainty
    return replace(
        video,
        theta=theta,
        trans=trans,
        body_joints=posed_joints(model, video.betas, theta, trans),
        hands=None if video.hands is None else _hands_at(video.hands, m),
        camera=replace(
            camera,
            R_first_from_frame=turns,
            zoom=values_at(camera.zoom, m.position),
            H_first_from_frame=values_at(camera.H_first_from_frame, m.position),
            path_m=None if camera.path_m is None else values_at(camera.path_m, m.position),
        ),
        joint_uncertainty=None
        if uncertain is None
        else replace(
            uncertain,
            sigma_mm=values_at(uncertain.sigma_mm, m.position),
            covariance_mm2=values_at(uncertain.covariance_mm2, m.position),
            rotation_covariance_deg2=values_at(uncertain.rotation_covariance_deg2, m.position),
            deviation_covariance_deg2=values_at(uncertain.deviation_covariance_deg2, m.position),
        ),
        frames=values_at(video.frames.astype(np.float64), m.position),
        reprojection_px=values_at(video.reprojection_px, m.position),
        confidence=np.where(m.inside, values_at(video.confidence, m.position), 0.0),
        inside=m.inside,
        phase_s=phase_s,
    )


def _hands_at(hands: HandMotion, m: FramePositions) -> HandMotion:
    flat = np.concatenate([hands.wrists[:, :, None], hands.fingers], axis=2)
    turned = pose_at(flat.reshape(len(flat), -1), m.position).reshape(
        len(m.position), *flat.shape[1:]
    )
    return HandMotion(
        wrists=turned[:, :, 0],
        fingers=turned[:, :, 1:],
        points=values_at(hands.points, m.position),
        visible=hands.visible[np.round(m.position).astype(np.int64)] & m.inside[:, None],
    )


LOOSELY_LEVEL = LevelPrior(roll_deg=5.0, pitch_deg=15.0, pitch_down_deg=0.0)


def ground_under(videos: Sequence[VideoResult], excluded: Collection[str]) -> Ground:
    """The ground under videos that are not `excluded`, where no artifact has it (of older runs)."""
    bodies = [
        FilmedBody(v.body_joints, v.fps, np.asarray(v.camera.R_per_frame.mean(axis=0)))
        for v in videos
        if v.id not in excluded
    ]
    return estimate_ground(bodies, LOOSELY_LEVEL)


def moved(video: VideoResult, alignment: GroundAlignment) -> VideoResult:
    """The same video in another world."""
    body = with_points(BodyMotion(video.theta, video.trans, video.body_joints), video.hands)
    body, hands = without_points(align_motion_to_ground(body, alignment), video.hands)
    pose = align_camera_to_ground(Extrinsics(video.camera.R, video.camera.t), alignment)
    return replace(
        video,
        theta=body.theta,
        trans=body.trans,
        body_joints=body.joints,
        hands=hands,
        camera=replace(video.camera, R=pose.R, t=pose.t),
    )


def with_points(body: BodyMotion, hands: HandMotion | None) -> BodyMotion:
    """The body and, after its joints, the points of its hands."""
    if hands is None:
        return body
    points = hands.points.reshape(len(body.joints), -1, 3)
    return BodyMotion(body.theta, body.trans, np.concatenate([body.joints, points], axis=1))


def without_points(
    both: BodyMotion, hands: HandMotion | None
) -> tuple[BodyMotion, HandMotion | None]:
    """The reverse of `with_points`."""
    body = BodyMotion(both.theta, both.trans, both.joints[:, :JOINTS])
    if hands is None:
        return body, None
    points = both.joints[:, JOINTS:].reshape(len(both.joints), 2, -1, 3)
    return body, replace(hands, points=points)
