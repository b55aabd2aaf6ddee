"""From the artifacts of an action to its result in one world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.codec import ArtifactCorrupt
from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    Hands,
    Keypoints,
    RefineSync,
    VideoCameraMotion,
    VideoHands,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.artifacts.store import Kind, Store
from imocap_core.camera.world import (
    BodyMotion,
    Extrinsics,
    align_camera_to_ground,
    align_motion_to_ground,
    find_ground_alignment,
    to_world,
)
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.export.values import CAMERA_UP, HandTrack, Performance, Result

Array = NDArray[np.float64]

JOINTS = len(SMPL_JOINTS)
FEET = [SMPL_JOINTS.index(name) for name in ("left_foot", "right_foot")]


def read_result(store: Store, action: str, up: str | None) -> Result:
    """The result in its world, levelled when `up` names an axis, on the videos' own timelines."""
    keypoints = load(store, action, "keypoints", Keypoints)
    refined = load(store, action, "refine_sync", RefineSync)
    motion, sync = refined.motion, refined.sync
    hands = _hands(store, action, refined)
    turned = _turned(store, action)
    seen = {v.id: v for v in keypoints.videos}
    cameras = {c.id: c for c in motion.cameras}
    phases = {} if sync.trust is None else {v.id: v.phase_s for v in sync.trust.videos}
    found = [
        _performance(
            v, hands.get(v.id), cameras[v.id], seen[v.id], turned.get(v.id), phases.get(v.id)
        )
        for v in motion.videos
    ]
    return Result(
        action=action,
        performances=found if up is None else levelled(found, up),
        reference=motion.reference,
        model=motion.model,
        model_digest=motion.model_digest,
        up_axis=up or CAMERA_UP,
        sync=sync,
    )


def levelled(performances: list[Performance], up: str) -> list[Performance]:
    """The same in a world that stands on its ground."""
    joints = [p.body.joints for p in performances]
    level = find_ground_alignment([j[:, FEET] for j in joints], [j[:, 0] for j in joints], up)
    done = []
    for p in performances:
        points = _with_points(p.body, p.hands)
        body, hands = _parted(align_motion_to_ground(points, level), p.hands)
        done.append(replace(p, body=body, hands=hands, pose=align_camera_to_ground(p.pose, level)))
    return done


def load(store: Store, action: str, stage: str, kind: type[Kind]) -> Kind:
    """An artifact of an action; WorkFailed says how to make it when there is none."""
    again = f"run it with: imocap run {action}"
    try:
        stored = store.load(action, stage)
        if stored is None:
            raise WorkFailed(f"{action} has no {stage} artifact yet; {again}")
        return stored.decode(kind)
    except ArtifactCorrupt as error:
        said = str(error).splitlines()[0]
        raise WorkFailed(f"{stage} of {action}: {said}; {again}") from None


def _hands(store: Store, action: str, refined: RefineSync) -> dict[str, VideoHands]:
    """Hands by video; none where keypoints have none, or where the stage has not run."""
    if not store.current(action, "hands").is_file():
        return {}
    found = {v.id: v for v in load(store, action, "hands", Hands).videos}
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


def _turned(store: Store, action: str) -> dict[str, VideoCameraMotion]:
    """How cameras turned, by video; none where the stage has not run."""
    if not store.current(action, "camera_motion").is_file():
        return {}
    return {v.id: v for v in load(store, action, "camera_motion", CameraMotion).videos}


def _performance(
    video: VideoMotion,
    hands: VideoHands | None,
    camera: Camera,
    seen: VideoKeypoints,
    turned: VideoCameraMotion | None,
    phase_s: Array | None,
) -> Performance:
    count = len(video.frames)
    track = None
    if hands is not None:
        track = HandTrack(hands.wrists, hands.fingers, hands.points_m, hands.seen > 0)
    pose = Extrinsics(camera.R, camera.t)
    points = _with_points(BodyMotion(video.theta, video.trans, video.joints), track)
    body, track = _parted(to_world(points, pose), track)
    turns, zoom = np.tile(np.eye(3), (count, 1, 1)), np.ones(count)
    if turned is not None and len(turned.R_first_from_frame) == count:
        turns, zoom = turned.R_first_from_frame, turned.zoom
    return Performance(
        seen=seen,
        fps=seen.fps,
        body=body,
        betas=video.betas,
        hands=track,
        K=camera.K,
        pose=pose,
        turns=turns,
        zoom=zoom,
        frames=video.frames.astype(np.float64),
        inside=np.ones(count, dtype=bool),
        phase_s=np.full(count, np.nan) if phase_s is None else phase_s,
    )


def _with_points(body: BodyMotion, hands: HandTrack | None) -> BodyMotion:
    """The body and, after its joints, the points of its hands."""
    if hands is None:
        return body
    points = hands.points.reshape(len(body.joints), -1, 3)
    return BodyMotion(body.theta, body.trans, np.concatenate([body.joints, points], axis=1))


def _parted(both: BodyMotion, hands: HandTrack | None) -> tuple[BodyMotion, HandTrack | None]:
    """The reverse of `_with_points`."""
    body = BodyMotion(both.theta, both.trans, both.joints[:, :JOINTS])
    if hands is None:
        return body, None
    points = both.joints[:, JOINTS:].reshape(len(both.joints), 2, -1, 3)
    return body, replace(hands, points=points)
