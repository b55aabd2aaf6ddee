"""Meaning of each column of the report's tables, in one sentence; docs/metrics.md in full."""

from __future__ import annotations

_DISTANCE = "Mean distance of the joints to the truth, camera axes, relative to the hips' middle"

GLOSSARY = {
    "mpjpe_mm": f"{_DISTANCE}; not scaled.",
    "mpjpe_scaled_mm": f"{_DISTANCE}; every frame scaled to the truth's size first "
    "(comparable with the paper's MPJPE).",
    "pa_mpjpe_mm": "The same after a similarity Procrustes alignment of each frame "
    "(the paper's P-MPJPE).",
    "mpjpe_14_mm": "mpjpe_mm on 14 joints.",
    "mpjpe_14_scaled_mm": "mpjpe_scaled_mm on 14 joints.",
    "pa_mpjpe_14_mm": "pa_mpjpe_mm on 14 joints.",
    "mpjpe_17_mm": "mpjpe_mm on 17 joints.",
    "mpjpe_17_scaled_mm": "mpjpe_scaled_mm on 17 joints.",
    "pa_mpjpe_17_mm": "pa_mpjpe_mm on 17 joints.",
    "mpjpe_24_mm": "mpjpe_mm on all 24 joints of SMPL.",
    "mpjpe_24_scaled_mm": "mpjpe_scaled_mm on all 24 joints.",
    "pa_mpjpe_24_mm": "pa_mpjpe_mm on all 24 joints.",
    "spine_mm": "Mean error of spine1 to spine3 after alignment on the twelve joints.",
    "collars_neck_mm": "Mean error of collars and neck after alignment on the twelve joints.",
    "mpjae_deg": "Mean angle between estimated and true joint rotations, relative to the parent.",
    "spine_rotation_error_deg": "The same of spine1 to spine3.",
    "pelvis_rotation_error_deg": "Mean angle of the pelvis to the truth, in camera axes.",
    "chest_rotation_error_deg": "The same of the chest.",
    "head_rotation_error_deg": "The same of the head.",
    "neck_direction_error_deg": "Mean angle between where the neck points and the truth, in camera "
    "axes.",
    "collars_direction_error_deg": "The same of both collar bones.",
    "pve_mm": "Mean distance of the surface's vertices to the truth, relative to the hips' middle.",
    "pve_without_hands_mm": "The same without hands, of which a body's keypoints say nothing.",
    "pa_pve_mm": "pve_mm after a similarity Procrustes alignment of each frame.",
    "foot_sliding_mm": "Mean displacement of heels and toes in 1/30 s during true foot contact.",
    "w_mpjpe_mm": "MPJPE in the world: segments of 100 frames, aligned on their first two frames.",
    "wa_mpjpe_mm": "The same, each segment aligned as a whole.",
    "rte_pct": "Mean error of the root, path rigidly aligned, in percent of the true path.",
    "jitter_10m_s3": "Mean jerk of the joints, in units of 10 m/s³; needs no truth.",
    "stretched_edges_pct": "Share of the mesh's edges that are longer or shorter than at rest by "
    "more than 40 %; needs no truth.",
    "stretched_edges_worst_pct": "The same in the worst frame.",
    "torso_volume_change_pct": "Mean change of the torso's volume (above the pelvis) against rest; "
    "needs no truth.",
    "torso_volume_change_worst_pct": "The same in the worst frame.",
    "acceleration_error_m_s2": "Mean difference of the joints' accelerations to the true ones.",
    "smoothed_truth_acceleration_error_m_s2": "The same of the true motion, smoothed over a frame.",
    "root_path_error_mm": "Mean distance of the hips' middle to its true path, centroids aligned.",
    "root_path_aligned_error_mm": "The same after one similarity alignment of the whole path.",
    "foot_sliding_mm_s": "Mean speed of the ankles relative to their true motion, during true "
    "foot contact.",
    "planted_foot_speed_mm_s": "Median speed of the ankles during true foot contact.",
    "true_planted_foot_speed_mm_s": "The same of the true ankles.",
    "reprojection_px": "Mean distance of the body's keypoints to the detections, weighted by "
    "confidence.",
    "reprojection_pct": "The same in percent of the person's height in the picture.",
    "camera_rotation_error_deg": "Angle between the recovered and the true rotation from the "
    "reference camera to this one.",
    "camera_place_error_mm": "Distance of the camera's place from the true one, after one "
    "similarity of all cameras.",
    "focal_error_pct": "Logarithm of the focal length over the true one, absolute, times 100.",
    "sync_error_pct": "Mean distance of matched and true phase, as a share of the last phase.",
    "sync_error_released_pct": "The same over frames whose phase equals that of a reference frame.",
    "sync_error_frames": "Mean distance of the matched to the true position in the reference.",
    "sync_error_ms": "The same in milliseconds.",
    "sync_median_error_frames": "Median of the same.",
    "offset_frames": "Median of reference frame minus the video's frame.",
    "offset_error_frames": "Distance of that to the true offset.",
    "matched_share": "Share of the frames with a counterpart that are matched.",
    "false_match_share": "Share of the frames without a counterpart that are matched nevertheless.",
    "cycle_residual_frames": "Distance of a frame's end from its start after a round trip over "
    "three videos; median; needs no truth.",
    "sigma_mm": "Claimed standard deviation: root of the covariance's trace.",
    "depth_mm": "Claimed standard deviation along the line of sight.",
    "across_mm": "Claimed standard deviation across the line of sight, both directions together.",
    "error_mm": "Root mean square of the true error.",
    "normalised_error": "Root mean square of error over claimed standard deviation; calibrated: 1.",
    "normalised_depth_error": "The same along the line of sight.",
    "normalised_across_error": "The same across the line of sight.",
    **{
        f"covered_{level}_share": f"Share of the true joints within the claimed {level} % region."
        for level in (50, 80, 90)
    },
    "camera_rotation_deg": "Claimed standard deviation of the camera's rotation, all axes.",
    "normalised_camera_error": "Error of the camera's rotation over that; calibrated: about 1.",
    "coverage_error": "Mean distance of such shares from what their regions claim; calibrated: 0.",
    "azimuth_deg": "Direction of a camera around the performer; 0: in front, 90: at their left.",
    "reduction_share": "Share by which one more camera there would lower the summed variance.",
    "outlier_score": "Above 1.1: another action; below 0.9: usual.",
    "mirror_margin": "Above 0: the video fits the others better when reflected.",
    "left_out_frames": "Mean distance of the direct match in the reference to that through "
    "the other videos.",
    "left_out_s": "The same in seconds.",
    "left_out_share": "Share of the frames that both ways match.",
    "repetition_s": "How much later in the reference the video fits nearly as well, where the "
    "action repeats.",
    "repetition_ratio": "Squared distances of the poses there, over those of the match.",
    "error_pct_height": "Median distance of a video's keypoints from where the other videos' "
    "motion puts them, in % of the person's height in the picture; the video's camera is resected "
    "from other stretches of time.",
    "share_10": "Share of the keypoints that are predicted within 10 % of the height.",
    "monocular_error_pct_height": "The same median for limbs, one at a time hidden from the "
    "video's own monocular fit.",
    "residual_frames": "Distance of a frame's end from its start after a round trip over these "
    "videos.",
    "residual_s": "The same in seconds.",
    "presence_share": "Share of the frames in which the performer is detected.",
    "camera_px": "Distance of the camera's homographies to those of a pure rotation.",
    "focal_px": "Focal length in pixels: given, estimated from the camera's rotation, or assumed.",
    "lens_k1": "Radial distortion of the lens that was taken out of the keypoints, declared or "
    "estimated from the camera's turning: OpenCV's k1, relative to focal_px.",
    "solved_focal_px": "Focal length of the result; an assumed one is estimated with the motion.",
    "focal_sd_pct": "Claimed standard deviation of the focal length, as a share of it.",
    "distortion": "Radial distortion k: a ray at r focal lengths from the axis is seen at "
    "r (1 + k r^2).",
    "median_px": "Median reprojection error of the keypoints, the detector's constant errors taken "
    "off.",
    "rotation_sd_deg": "Claimed standard deviation of the camera's rotation, three axes together.",
    "offset_sd_ms": "Claimed standard deviation of when the video began.",
    "pitch_down_deg": "How far the camera looks down from the horizontal, in the mean.",
    "roll_deg": "How far the camera is rolled; above 0: up leans to the picture's right.",
    "camera_height_m": "Height of the camera above the ground.",
    "sole_depth_mm": "How far the lower sole is below the ground, in 95 % of the frames at most.",
    "up_alone_deg": "Angle between up by this video alone and by all videos.",
    "up_alone_sd_deg": "Standard deviation of up by this video alone.",
    "moved_frames": "Mean change of the correspondences since the previous round.",
    "pictures_again": "Pictures of a video that the detector looked at once more.",
    "contradicted": "Doubtful limb joints in them that the other videos have elsewhere.",
    "moved_joints": "Those of them that took a place near the one that the others expect, and all "
    "points of people who had not been detected.",
    "cost": "Cost by which the rounds are compared.",
    "hand_mpjpe_mm": "Mean distance of a hand's points to the truth, relative to its wrist.",
    "hand_mpjpe_scaled_mm": "The same, every hand scaled to the truth's size first.",
    "hand_pa_mpjpe_mm": "The same after a similarity alignment of each hand.",
    "hand_mpjpe_seen_mm": "hand_mpjpe_mm where keypoints of the hand were used.",
    "hand_seen_share": "Share of hands and frames whose keypoints were used.",
    "ms_per_frame": "Milliseconds per frame of all videos together.",
    "seconds": "Wall-clock time of the run that computed the result.",
}
