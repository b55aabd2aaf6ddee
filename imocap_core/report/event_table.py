"""Cameras calibrated from one event, in the report."""

from __future__ import annotations

from imocap_core.artifacts.schemas import RefineSync, Table


def event_tables(refined: RefineSync) -> list[Table]:
    """One table, or none where the videos do not show one event."""
    if refined.event is None:
        return []
    focal_px = {camera.id: float(camera.K[0, 0]) for camera in refined.motion.cameras}
    return [
        Table(
            name="event",
            title="Cameras calibrated from the event",
            columns=["video", "solved_focal_px", "focal_sd_pct", "distortion", "rotation_sd_deg",
                     "offset_frames", "offset_sd_ms", "rate", "median_px"],
            rows=[
                [
                    camera.id,
                    focal_px[camera.id],
                    100 * camera.focal_sd,
                    camera.distortion,
                    camera.rotation_sd_deg,
                    camera.offset_frames,
                    1000 * camera.offset_sd_s,
                    camera.rate,
                    camera.median_px,
                ]
                for camera in refined.event.cameras
            ],
            note="Rotations are about the reference camera's. The offset is this video's frame, "
            "among its used ones, at the reference's first; the rate its frames a frame of the "
            "reference; the error the median reprojection error of the keypoints, without the "
            "detector's constant errors.",
        )
    ]  # fmt: skip
