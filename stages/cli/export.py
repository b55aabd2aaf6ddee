"""export: from the artifacts of an action to files that other programs read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from imocap_core.artifacts.codec import ArtifactCorrupt
from imocap_core.artifacts.schemas import (
    Camera,
    Hands,
    Keypoints,
    RefineSync,
    VideoHands,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.artifacts.store import Kind, Store
from imocap_core.camera.world import (
    Extrinsics,
    Level,
    Motion,
    find_level,
    level_camera,
    level_motion,
    to_world,
)
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.formats.export_npz import (
    ExportedHands,
    ExportedVideo,
    write_cameras,
    write_sync,
    write_video,
)
from stages.harness.errors import WorkFailed

CAMERA_UP = "-y"  # the world is the reference camera, whose y points down
JOINTS = len(SMPL_JOINTS)
WRISTS = SMPL_JOINTS.index("left_wrist")  # the right one follows; then joints that hands replace
FEET = [SMPL_JOINTS.index(name) for name in ("left_foot", "right_foot")]


def export_npz(store: Store, action: str, out: Path, up: str | None) -> list[Path]:
    """Write <id>.npz, sync.csv and cameras.json below `out`; the paths, in that order."""
    keypoints = _load(store, action, "keypoints", Keypoints)
    refined = _load(store, action, "refine_sync", RefineSync)
    motion, sync = refined.motion, refined.sync
    hands = _hands(store, action, refined)
    seen = {v.id: v for v in keypoints.videos}
    cameras = {c.id: c for c in motion.cameras}
    bodies = {v.id: _world_motion(v, hands.get(v.id), cameras[v.id]) for v in motion.videos}
    level = None
    if up is not None:
        feet = [body.joints[:, FEET] for body in bodies.values()]
        level = find_level(feet, [body.joints[:, 0] for body in bodies.values()], up)
    model = f"{motion.model} {motion.model_digest}"
    videos = [
        _exported(
            v,
            hands.get(v.id),
            bodies[v.id],
            cameras[v.id],
            seen[v.id],
            model,
            level,
            up or CAMERA_UP,
        )
        for v in motion.videos
    ]
    try:
        out.mkdir(parents=True, exist_ok=True)
        return [
            *(write_video(out, video) for video in videos),
            write_sync(
                out,
                {video.id: video.frames for video in videos},
                {m.id: (m.reference_frame, m.confidence) for m in sync.maps},
                sync.reference,
                None if sync.trust is None else {v.id: v.phase_s for v in sync.trust.videos},
            ),
            write_cameras(out, videos, motion.reference),
        ]
    except OSError as error:
        raise WorkFailed(f"cannot write to {out}: {error.strerror}") from None


def _load(store: Store, action: str, stage: str, kind: type[Kind]) -> Kind:
    again = f"run it with: imocap run {action}"
    try:
        stored = store.load(action, stage)
        if stored is None:
            raise WorkFailed(f"{action} has no {stage} artifact yet; {again}")
        return stored.decode(kind)
    except ArtifactCorrupt as error:
        raise WorkFailed(f"{error}; {again}") from None


def _hands(store: Store, action: str, refined: RefineSync) -> dict[str, VideoHands]:
    """Hands by video; none where keypoints have none, or where the stage has not run."""
    if store.load(action, "hands") is None:
        return {}
    found = {v.id: v for v in _load(store, action, "hands", Hands).videos}
    stale = [
        v.id
        for v in refined.motion.videos
        if v.id in found and not np.array_equal(found[v.id].frames, v.frames)
    ]
    if stale:
        raise WorkFailed(
            f"{action}: the hands of {', '.join(stale)} are of other frames than the motion; "
            f"run it with: imocap run {action}"
        )
    return found


def _world_motion(video: VideoMotion, hands: VideoHands | None, camera: Camera) -> Motion:
    """The body and, after its joints, the points of its hands."""
    joints = video.joints
    if hands is not None:
        joints = np.concatenate([joints, hands.points_m.reshape(len(joints), -1, 3)], axis=1)
    own = Motion(video.theta, video.trans, joints)
    return to_world(own, Extrinsics(camera.R, camera.t))


def _exported_hands(hands: VideoHands, body: Motion) -> ExportedHands:
    """SMPL+H's poses: the body's up to the elbows, wrists and fingers of the hands."""
    frames = len(body.theta)
    parts = [body.theta[:, : 3 * WRISTS], hands.wrists, hands.fingers]
    return ExportedHands(
        poses_smplh=np.concatenate([part.reshape(frames, -1) for part in parts], axis=1),
        points=body.joints[:, JOINTS:].reshape(frames, 2, -1, 3),
        seen=hands.seen > 0,
    )


def _exported(
    video: VideoMotion,
    hands: VideoHands | None,
    body: Motion,
    camera: Camera,
    seen: VideoKeypoints,
    model: str,
    level: Level | None,
    up_axis: str,
) -> ExportedVideo:
    pose = Extrinsics(camera.R, camera.t)
    if level is not None:
        body, pose = level_motion(body, level), level_camera(pose, level)
    return ExportedVideo(
        id=video.id,
        poses=body.theta,
        betas=video.betas,
        trans=body.trans,
        joints=body.joints[:, :JOINTS],
        joint_names=tuple(SMPL_JOINTS),
        fps=seen.fps,
        size=seen.size,
        frames=video.frames,
        K=camera.K,
        R=pose.R,
        t=pose.t,
        model=model,
        up_axis=up_axis,
        hands=None if hands is None else _exported_hands(hands, body),
    )
