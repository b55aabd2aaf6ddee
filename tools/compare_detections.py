"""A detector against another's keypoints on the same videos: the table of docs/detection.md.

    imocap run REFERENCE --until keypoints
    imocap run ACTION --until keypoints --set keypoints.sides=leave
    python tools/compare_detections.py ACTION REFERENCE [--root FOLDER]

Compares the stored keypoints of two actions with the same videos, on the 12 limb joints. Errors
are shares of the performer's standing height in the picture; PCK is the share of joints within
.2 or .1 of the torso (middle of the shoulders to middle of the hips). A body is swapped where its
joints lie nearer to the reference with left and right swapped.
"""

import argparse
from pathlib import Path

import numpy as np

from imocap_core.artifacts.schemas import Keypoints, VideoKeypoints
from imocap_core.artifacts.store import Store
from imocap_core.body.layouts import layout_names

SIDES, PARTS = ("left", "right"), ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
LIMBS = [f"{side}_{part}" for side in SIDES for part in PARTS]
OTHER_SIDE = np.roll(np.arange(12), 6)
LEAST_CONFIDENCE = 0.3  # of the reference's joints
SWAPPED = 0.05  # of the height: so much nearer lie the joints with sides swapped


def joints(video: VideoKeypoints, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Limb joints (T, 12, 2) of the frames and their confidence (T, 12)."""
    columns = [layout_names(video.layout).index(name) for name in LIMBS]
    rows = np.searchsorted(video.frames, frames)
    return video.xy_px[rows][:, columns], video.confidence[rows][:, columns]


def compare(video: VideoKeypoints, reference: VideoKeypoints) -> dict[str, np.ndarray]:
    """Per joint and frame: error / height and error / torso (NaN where the reference has none);
    per frame: whether the whole body is swapped."""
    frames = np.intersect1d(video.frames, reference.frames)
    (xy, _), (true, confidence) = joints(video, frames), joints(reference, frames)
    true = np.where((confidence >= LEAST_CONFIDENCE)[..., None], true, np.nan)
    tall = np.nanmax(true[..., 1], axis=1) - np.nanmin(true[..., 1], axis=1)
    height = np.nanpercentile(tall, 90) / 0.82  # shoulders to ankles are 82 % of a standing person
    middle = [np.nanmean(true[:, [k, k + 6]], axis=1) for k in (0, 3)]
    torso = np.nanmedian(np.linalg.norm(middle[0] - middle[1], axis=-1))
    error = np.linalg.norm(xy - true, axis=-1)
    other_side = np.linalg.norm(xy[:, OTHER_SIDE] - true, axis=-1)
    gain = np.nanmean(error - other_side, axis=1) / height
    far = np.where(np.isnan(error) & np.isfinite(true[..., 0]), np.inf, error)  # missed is wrong
    return {"height": error / height, "torso": far / torso, "swapped": gain > SWAPPED}


def report(rows: dict[str, dict[str, np.ndarray]]) -> None:
    """A line a video, and one for all."""
    merged = {k: np.concatenate([row[k] for row in rows.values()]) for k in ("height", "torso")}
    merged["swapped"] = np.concatenate([row["swapped"] for row in rows.values()])
    print("| video | frames | error, % of height | median | PCK .2 | PCK .1 | swapped bodies |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for name, row in (rows | {"all": merged}).items():
        error, torso = row["height"], row["torso"][~np.isnan(row["torso"])]
        shares = [100 * (torso < limit).mean() for limit in (0.2, 0.1)]
        print(f"| {name} | {len(error)} | {100 * np.nanmean(error):.2f} "
              f"| {100 * np.nanmedian(error):.2f} | {shares[0]:.1f} | {shares[1]:.1f} "
              f"| {row['swapped'].sum()} |")  # fmt: skip


def main() -> None:
    """Read both actions, print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action")
    parser.add_argument("reference")
    parser.add_argument("--root", type=Path, default=Path())
    arguments = parser.parse_args()
    store = Store(arguments.root / "artifacts")
    videos = []
    for action in (arguments.action, arguments.reference):
        stored = store.load(action, "keypoints")
        if stored is None:
            parser.error(f"{action} has no keypoints: imocap run {action} --until keypoints")
        videos.append({video.id: video for video in stored.decode(Keypoints).videos})
    report({v: compare(videos[0][v], videos[1][v]) for v in videos[0] if v in videos[1]})


if __name__ == "__main__":
    main()
