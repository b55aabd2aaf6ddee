"""The ground in the report: how sure up is, how cameras are held, soles below the ground."""

from __future__ import annotations

import numpy as np

from imocap_core.artifacts.schemas import CameraMotion, GroundPlane, InitialSmpl, RefineSync, Table
from imocap_core.artifacts.schemas.evaluate import Cell
from imocap_core.camera.ground import sole_depths_mm
from imocap_core.camera.world import BodyMotion, Extrinsics, to_world
from imocap_core.problem.ground import ground_of, held_deg

DEEP = 0.95  # quantile of the frames


def ground_tables(
    initial: InitialSmpl, camera_motion: CameraMotion, refined: RefineSync
) -> list[Table]:
    """One table, or none where the result has no ground."""
    motion = refined.motion
    if motion.ground is None:
        return []
    ground = ground_of(motion.ground)
    alone: list[GroundPlane | None] = [*initial.grounds] or [None] * len(motion.videos)
    every = zip(motion.videos, motion.cameras, camera_motion.videos, alone, strict=True)
    rows: list[list[Cell]] = []
    for video, camera, turned, plane in every:
        roll, down = held_deg(ground.up, camera, turned)
        body = to_world(
            BodyMotion(video.theta, video.trans, video.joints), Extrinsics(camera.R, camera.t)
        )
        cosine = np.nan if plane is None else float(np.clip(plane.up @ camera.R @ ground.up, -1, 1))
        rows.append(
            [
                video.id,
                down,
                roll,
                float(ground.height_m(-camera.R.T @ camera.t)),
                float(np.quantile(sole_depths_mm(body.joints, ground), DEEP)),
                None if plane is None else float(np.degrees(np.arccos(cosine))),
                None if plane is None else plane.tilt_sd_deg,
            ]
        )
    return [
        Table(
            name="ground",
            title="The ground and the cameras above it",
            columns=["video", "pitch_down_deg", "roll_deg", "camera_height_m", "sole_depth_mm",
                     "up_alone_deg", "up_alone_sd_deg"],
            rows=rows,
            note=f"Up has a standard deviation of {ground.tilt_sd_deg:.1f} degrees, the ground's "
            f"height one of {ground.height_sd_mm:.0f} mm.",
        )
    ]  # fmt: skip
