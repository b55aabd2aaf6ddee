"""Columns of the report's tables in words; their names are those of the CSV files."""

from __future__ import annotations

UNITS = {
    "_10m_s3": "10 m/s³",
    "_m_s2": "m/s²",
    "_mm_s": "mm/s",
    "_frames": "frames",
    "_mm": "mm",
    "_deg": "°",
    "_pct": "%",
    "_px": "px",
    "_ms": "ms",
    "_s": "s",
    "_m": "m",
}
"""By the ends of names, longer ones before those that they contain."""

TITLES = {
    "mpjpe": "joint error",
    "mpjpe_scaled": "joint error, scaled",
    "pa_mpjpe": "joint error, aligned",
    **{
        name.format(count): f"joint error, {count} joints{how}"
        for count in (14, 17, 24)
        for name, how in (
            ("mpjpe_{}", ""),
            ("mpjpe_{}_scaled", ", scaled"),
            ("pa_mpjpe_{}", ", aligned"),
        )
    },
    "spine": "spine error",
    "collars_neck": "error of collars and neck",
    "mpjae": "joint angle error",
    "pve": "surface error",
    "pve_without_hands": "surface error without hands",
    "pa_pve": "surface error, aligned",
    "w_mpjpe": "world joint error, beginning aligned",
    "wa_mpjpe": "world joint error, aligned",
    "rte": "root path error",
    "root_path_aligned_error": "root path error, aligned",
    "smoothed_truth_acceleration_error": "acceleration error of the smoothed truth",
    "stretched_edges": "stretched edges",
    "stretched_edges_worst": "stretched edges, worst frame",
    "torso_volume_change_worst": "torso volume change, worst frame",
    "median": "median reprojection error",
    "reprojection": "distance in the picture",
    "sync_error_released": "sync error where released",
    "matched_share": "share matched",
    "false_match_share": "share matched falsely",
    "cycle_residual": "round trip",
    "sigma": "claimed deviation",
    "depth": "claimed in depth",
    "across": "claimed across",
    "normalised_error": "error over claim",
    "normalised_depth_error": "error over claim, depth",
    "normalised_across_error": "error over claim, across",
    **{f"covered_{level}_share": f"within {level} % region" for level in (50, 80, 90)},
    "camera_rotation": "claimed camera deviation",
    "normalised_camera_error": "camera error over claim",
    "coverage_error": "error of the regions",
    "reduction_share": "share of variance saved",
    "left_out": "match through others",
    "left_out_share": "share matched both ways",
    "repetition": "next repetition",
    "error_pct_height": "error, % of the height",
    "share_10": "share within 10 %",
    "monocular_error_pct_height": "monocular error, % of the height",
    "residual": "round trip over these",
    "presence_share": "share with the performer",
    "camera_px": "misfit of a pure rotation (px)",
    "focal": "focal length",
    "solved_focal": "focal length solved",
    "up_alone": "up by this video alone",
    "up_alone_sd": "deviation of up alone",
    "moved": "change of matches",
    "pictures_again": "pictures looked at again",
    "contradicted": "joints contradicted",
    "moved_joints": "joints moved",
    "hand_mpjpe": "hand error",
    "hand_mpjpe_scaled": "hand error, scaled",
    "hand_pa_mpjpe": "hand error, aligned",
    "hand_mpjpe_seen": "hand error where seen",
    "hand_seen_share": "share of hands seen",
    "ms_per_frame": "time per frame (ms)",
    "seconds": "time (s)",
    "fps": "frames per second",
}
"""By names, most without their units, where the words of a name do not say it."""


def column_title(name: str) -> str:
    """A column's name in words, its unit in brackets: "joint error, aligned (mm)"."""
    if name in TITLES:
        return TITLES[name]
    for end, unit in UNITS.items():
        stem = name.removesuffix(end)
        if stem != name:
            return f"{TITLES.get(stem, stem.replace('_', ' '))} ({unit})"
    return name.replace("_", " ")
