"""The report's files for programs, tables as CSV and JSON, and their columns in words."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.schemas.motion_schemas import Cell
from imocap_core.artifacts.side_files import check_names
from imocap_core.errors import CONTROL

_UNITS = {
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

_TITLES = {
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
    if name in _TITLES:
        return _TITLES[name]
    for end, unit in _UNITS.items():
        stem = name.removesuffix(end)
        if stem != name:
            return f"{_TITLES.get(stem, stem.replace('_', ' '))} ({unit})"
    return name.replace("_", " ")


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


_DECIMALS = {
    "mm": 1,
    "px": 1,
    "pct": 2,
    "deg": 2,
    "frames": 2,
    "ms": 1,
    "s2": 2,
    "s3": 1,
    "share": 2,
    "s": 1,
}
_DECIMALS |= {"seconds": 1, "frame": 1, "fps": 2}


def cell_text(column: str, value: Cell) -> str:
    """A cell's text, rounded by the unit that ends the column's name."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else ""
    if isinstance(value, float):
        return f"{value:.{_DECIMALS.get(column.rsplit('_', 1)[-1], 3)}f}"
    return str(value)


def csv_text(table: Table) -> str:
    """Comma-separated, full precision; an empty cell could not be scored."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([["" if v is None else v for v in row] for row in table.rows])
    return out.getvalue()


def json_text(tables: Sequence[Table]) -> str:
    """All tables, each as a list of records; null could not be scored."""
    content = {t.name: [dict(zip(t.columns, row, strict=True)) for row in t.rows] for t in tables}
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


CONTENTS = "contents.json"


@dataclass(frozen=True)
class Picture:
    """A figure's file, relative to the report, and its caption."""

    file: str
    caption: str


@dataclass(frozen=True)
class Contents:
    """The head of the report's page: its title and its pictures."""

    title: str
    pictures: tuple[Picture, ...]


def write_report(
    folder: Path, title: str, tables: Sequence[Table], every: Table, pictures: Sequence[Picture]
) -> list[str]:
    """Write contents.json, metrics.json and one CSV per table; returns the file names.

    Args:
        tables: shown on the page. every: the long table, for programs only. pictures: files that
            are in the folder already.
    """
    contents = asdict(Contents(title, tuple(pictures)))
    files = {
        CONTENTS: json.dumps(contents, indent=1, ensure_ascii=False) + "\n",
        "metrics.json": json_text([*tables, every]),
        **{f"{table.name}.csv": csv_text(table) for table in (*tables, every)},
    }
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8", newline="\n")
    return sorted([*files, *(picture.file for picture in pictures)])


def read_contents(folder: Path) -> Contents:
    """The contents that `write_report` wrote. OSError or ValueError when they cannot be read."""
    file = folder / CONTENTS
    try:
        fields = json.loads(file.read_text(encoding="utf-8"))
        pictures = tuple(Picture(str(p["file"]), str(p["caption"])) for p in fields["pictures"])
        check_names(picture.file for picture in pictures)
        title = str(fields["title"])
        if any(CONTROL.search(text) for text in (title, *(p.caption for p in pictures))):
            raise ValueError
        return Contents(title, pictures)
    except (ValueError, LookupError, TypeError, RecursionError):
        raise ValueError(f"{file} is not as the run wrote it; run the action again") from None
