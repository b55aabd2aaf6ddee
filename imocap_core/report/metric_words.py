"""What a column of the report means, in one sentence. docs/metrics.md says it in full."""

from __future__ import annotations

_DISTANCE = "Mean distance of the joints to the truth in the camera's axes, hips' middle subtracted"

WORDS = {
    "mpjpe_mm": f"{_DISTANCE}; nothing scaled.",
    "mpjpe_scaled_mm": f"{_DISTANCE}; every frame scaled to the truth's size first "
    "(the number to hold beside the paper's).",
    "pa_mpjpe_mm": "The same after a similarity Procrustes alignment of each frame "
    "(the paper's P-MPJPE).",
    "mpjpe_14_mm": "mpjpe_mm on 14 joints.",
    "mpjpe_14_scaled_mm": "mpjpe_scaled_mm on 14 joints.",
    "pa_mpjpe_14_mm": "pa_mpjpe_mm on 14 joints.",
    "mpjpe_17_mm": "mpjpe_mm on 17 joints.",
    "mpjpe_17_scaled_mm": "mpjpe_scaled_mm on 17 joints.",
    "pa_mpjpe_17_mm": "pa_mpjpe_mm on 17 joints.",
    "acceleration_error_m_s2": "Mean distance of the joints' accelerations to the true ones.",
    "root_path_error_mm": "Mean distance of the two paths of the hips' middle, centroids together.",
    "root_path_aligned_error_mm": "The same after one similarity alignment of the whole path.",
    "foot_sliding_mm_s": "Mean speed of the ankles against their true motion while they stand.",
    "planted_foot_speed_mm_s": "Median speed of the ankles while the true ankle stands.",
    "reprojection_px": "Mean distance of the body's keypoints to the detections, weighted by "
    "confidence.",
    "reprojection_pct": "The same in per cent of the person's height in the picture.",
    "camera_rotation_error_deg": "Angle between the recovered and the true turn from the reference "
    "camera to this one.",
    "sync_error_pct": "Mean distance of matched and true phase, share of the action's end.",
    "sync_error_released_pct": "The same over frames whose phase is that of a reference frame.",
    "sync_error_frames": "Mean distance of the matched from the true place in the reference.",
    "sync_error_ms": "The same in milliseconds.",
    "sync_median_error_frames": "Median of the same.",
    "offset_frames": "Median of reference frame minus own frame.",
    "offset_error_frames": "Distance of that from the true one.",
    "matched_share": "Share of the frames with a counterpart that are matched.",
    "false_match_share": "Share of the frames without a counterpart that are matched all the same.",
    "cycle_residual_frames": "How far from its start a frame ends after going round three videos; "
    "median; needs no truth.",
    "sigma_mm": "Claimed standard deviation: root of the covariance's trace.",
    "depth_mm": "Claimed standard deviation along the line of sight.",
    "across_mm": "Claimed standard deviation across the line of sight, both directions together.",
    "error_mm": "Root mean square of the true error.",
    "normalised_error": "Root mean square of error over claimed standard deviation; 1 is honest.",
    "normalised_depth_error": "The same along the line of sight.",
    "normalised_across_error": "The same across the line of sight.",
    "azimuth_deg": "Where a camera stands about the performer; 0 in front, 90 at their left.",
    "reduction_share": "By how much one more camera there would lower the summed variance.",
    "outlier_score": "Above 1.1 is another action, below 0.9 is usual.",
    "mirror_margin": "Above 0 where a video fits the others better reflected.",
    "left_out_frames": "Own map to the reference against the way through the other videos; mean.",
    "left_out_s": "The same in seconds.",
    "left_out_share": "Share of its frames that both ways match.",
    "residual_frames": "How far from its start a frame ends after going round these videos.",
    "residual_s": "The same in seconds.",
    "presence_share": "Share of the frames in which the performer was found.",
    "camera_px": "How far the camera's homographies are from a pure rotation's.",
    "focal_px": "Focal length in pixels: given, solved from the camera's turning, or assumed.",
    "solved_focal_px": "The result's focal length: an assumed one is solved with the motion.",
    "moved_frames": "Mean movement of the correspondences since the round before.",
    "cost": "What rounds are judged by.",
    "hand_mpjpe_mm": "Mean distance of a hand's points to the truth, about its wrist.",
    "hand_mpjpe_scaled_mm": "The same, every hand scaled to the truth's size first.",
    "hand_pa_mpjpe_mm": "The same after a similarity alignment of each hand.",
    "hand_mpjpe_seen_mm": "hand_mpjpe_mm where keypoints of the hand were used.",
    "hand_seen_share": "Share of hands and frames whose keypoints were used.",
    "ms_per_frame": "Milliseconds for each frame of all videos together.",
    "seconds": "Wall clock, when this result was made.",
}
