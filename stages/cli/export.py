"""export: from the artifacts of an action to files that other programs read."""

from __future__ import annotations

from pathlib import Path

from imocap_core.artifacts.codec import ArtifactCorrupt
from imocap_core.artifacts.schemas import Camera, Keypoints, RefineSync, VideoKeypoints, VideoMotion
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
    ExportedVideo,
    write_cameras,
    write_sync,
    write_video,
)
from stages.harness.errors import WorkFailed

CAMERA_UP = "-y"  # the world is the reference camera, whose y points down
FEET = [SMPL_JOINTS.index(name) for name in ("left_foot", "right_foot")]


def export_npz(store: Store, action: str, out: Path, up: str | None) -> list[Path]:
    """Write <id>.npz, sync.csv and cameras.json below `out`; the paths, in that order."""
    keypoints = _load(store, action, "keypoints", Keypoints)
    refined = _load(store, action, "refine_sync", RefineSync)
    motion, sync = refined.motion, refined.sync
    seen = {v.id: v for v in keypoints.videos}
    cameras = {c.id: c for c in motion.cameras}
    bodies = {v.id: _world_motion(v, cameras[v.id]) for v in motion.videos}
    level = None
    if up is not None:
        feet = [body.joints[:, FEET] for body in bodies.values()]
        level = find_level(feet, [body.joints[:, 0] for body in bodies.values()], up)
    model = f"{motion.model} {motion.model_digest}"
    videos = [
        _exported(v, bodies[v.id], cameras[v.id], seen[v.id], model, level, up or CAMERA_UP)
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


def _world_motion(video: VideoMotion, camera: Camera) -> Motion:
    own = Motion(video.theta, video.trans, video.joints)
    return to_world(own, Extrinsics(camera.R, camera.t))


def _exported(
    video: VideoMotion,
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
        joints=body.joints,
        joint_names=tuple(SMPL_JOINTS),
        fps=seen.fps,
        size=seen.size,
        frames=video.frames,
        K=camera.K,
        R=pose.R,
        t=pose.t,
        model=model,
        up_axis=up_axis,
    )
