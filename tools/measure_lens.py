"""What a bent lens costs, and what correcting it gives back: the table of docs/moving_cameras.md.

``python -m tools.measure_lens ROOT --seed 7``: yoga's four videos (two cameras stand, two turn)
filmed by a pinhole and by lenses whose pictures' corners are displaced by a quarter, as those of
action cameras are. The second is captured with the distortion ignored, estimated from the turning
cameras, and declared together with the focal length; so is the first, with the focal length and
without.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from benchmarks.parallel import ActionDisplay, LineDisplay
from benchmarks.scoring import truth_of
from imocap_core.adapters.relative_motion import paths_of
from imocap_core.artifacts.schemas import CameraMotion, Keypoints, RefineSync
from imocap_core.body import load_free_body
from imocap_core.camera.projection import Lens, intrinsics
from imocap_core.evaluate.action_scores import score_results
from imocap_core.evaluate.scoreboard import AFTER_LOOP, StageResult
from imocap_core.io.video import write_h264
from imocap_core.metrics.scoring import over_videos
from imocap_core.pipeline import runner
from imocap_core.pipeline.make_demo import (
    clip_truth,
    demo_body,
    truth_of_action,
    video_id,
    write_keypoints,
)
from imocap_core.synthetic.yoga_clip import (
    LAYOUT,
    SIZE,
    YOGA_SPANS,
    DemoClip,
    make_yoga_clip,
    pictures,
)
from imocap_core.workspace import Workspace

K1, FOCAL_PER_WIDTH = -0.25, 0.78  # of an action camera; others displace their corners alike
WIDER = 1.3  # of the pinhole's picture that a lens bends
CRF = 18
LAST = "refine_sync"
METRICS = ("mpjpe_mm", "pa_mpjpe_mm", "camera_rotation_error_deg", "focal_error_pct")
CASES: dict[str, tuple[bool, tuple[str, ...], list[str]]] = {
    "pinhole": (False, (), []),
    "pinhole, focal length given": (False, ("focal_px",), []),
    "bent, ignored": (True, (), ["camera_motion.lens=false"]),
    "bent, focal length given, ignored": (True, ("focal_px",), ["camera_motion.lens=false"]),
    "bent, estimated from turning": (True, (), []),
    "bent, declared": (True, ("focal_px", "distortion"), []),
}


def lens_of_film(clip: DemoClip, bent: bool) -> Lens:
    """The lens that a clip is filmed with."""
    K = clip.camera.K
    k1 = K1 * (K[0, 0] / (FOCAL_PER_WIDTH * SIZE[0])) ** 2 if bent else 0.0
    return Lens.of([k1], K)


def bent_pictures(clip: DemoClip, seed: int, index: int, lens: Lens) -> Iterator[np.ndarray]:
    """The RGB frames of a clip, as the lens shows them."""
    wider = (round(WIDER * SIZE[0]), round(WIDER * SIZE[1]))
    camera = replace(clip.camera, K=intrinsics(float(clip.camera.K[0, 0]), wider))
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)
    straight = lens.undistorted(grid.astype(float))
    source = (straight + camera.K[:2, 2] - clip.camera.K[:2, 2]).astype(np.float32)
    filmed = replace(clip, camera=camera, size=wider)
    for picture in pictures(filmed, seed, index, demo_body(seed)):
        yield cv2.remap(picture, source[..., 0], source[..., 1], cv2.INTER_LINEAR)


def bent_clip(clip: DemoClip, lens: Lens) -> DemoClip:
    """A clip whose detections are as the lens shows them."""

    def detected(one: Any) -> Any:
        return None if one is None else replace(one, xy_px=lens.distorted(one.xy_px))

    people = [detected(person) for person in clip.false_people]
    return replace(clip, detections=detected(clip.detections), false_people=people)


def make_films(folder: Path, seed: int, bent: bool) -> list[dict[str, Any]]:
    """Films, keypoints and truth of a seed; the entries of action.yaml with all that is true."""
    shaped, truth, declared = demo_body(seed), truth_of_action("yoga"), []
    for index in range(len(YOGA_SPANS)):
        video = video_id(index)
        clip = make_yoga_clip(seed, index, shaped)
        lens = lens_of_film(clip, bent)
        declared.append(
            {
                "id": video,
                "video": f"videos/{video}.mp4",
                "keypoints": f"keypoints/{video}",
                "format": "openpose",
                "layout": LAYOUT,
                "focal_px": float(clip.camera.K[0, 0]),
                "distortion": [float(lens.coefficients[0])],
            }
        )
        truth |= {f"{video}/{part}": value for part, value in clip_truth(clip, shaped).items()}
        if (folder / "keypoints" / video).exists():
            continue
        (folder / "videos").mkdir(parents=True, exist_ok=True)
        film = bent_pictures(clip, seed, index, lens)
        write_h264(folder / "videos" / f"{video}.mp4", film, clip.fps, crf=CRF)
        write_keypoints(folder / "keypoints" / video, video, bent_clip(clip, lens))
    np.savez(folder / "truth.npz", **truth)
    return declared


def main() -> None:
    """Make the films, capture every case, and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--only", nargs="*", default=list(CASES), choices=list(CASES))
    given = parser.parse_args()
    for number, (case, (bent, fields, sets)) in enumerate(CASES.items()):
        if case not in given.only:
            continue
        films = given.root / "films" / f"seed{given.seed}_{'bent' if bent else 'pinhole'}"
        videos = make_films(films, given.seed, bent)
        name = f"lens{given.seed}_{number}"
        folder = given.root / "actions" / name
        folder.mkdir(parents=True, exist_ok=True)
        for part in ("videos", "keypoints", "truth.npz"):
            if not (folder / part).exists():
                (folder / part).symlink_to((films / part).resolve())
        hidden = {"focal_px", "distortion"}.difference(fields)
        entries = [{k: v for k, v in entry.items() if k not in hidden} for entry in videos]
        action = {"name": name, "videos": entries, "truth": "truth.npz"}
        (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))
        print("|", given.seed, "|", case, "|", row(given.root, name, sets), "|", flush=True)


def row(root: Path, name: str, sets: list[str]) -> str:
    """Errors of a result over its videos, and the k1 that were corrected."""
    shown = ActionDisplay(LineDisplay(), name)
    job = Workspace(root).ready_job(name, sets, shown)
    done = {o.stage: o.stored for o in runner.run(job, shown, job.pipeline.upstream(LAST))}
    keypoints, refined = done["keypoints"].decode(Keypoints), done[LAST].decode(RefineSync)
    cameras, solved = done["camera_motion"].decode(CameraMotion), refined.motion
    result = StageResult(
        AFTER_LOOP, solved.videos, solved.cameras, refined.sync, paths_of(solved.cameras)
    )
    rows = score_results([result], keypoints, cameras, truth_of(job, keypoints), load_free_body())
    means = {row.metric: row.value for row in over_videos(rows)}
    numbers = [f"{means[metric]:.1f}" for metric in METRICS if means.get(metric) is not None]
    k1 = ["-" if v.lens is None else f"{v.lens.coefficients[0]:.3f}" for v in cameras.videos]
    return " | ".join([*numbers, " ".join(k1)])


if __name__ == "__main__":
    main()
