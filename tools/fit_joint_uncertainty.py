"""Fit the model error of `imocap_core/motion/posterior_noise.py` on training clips:
python -m tools.fit_joint_uncertainty FOLDER

Performances of clips, and one motion resampled, are filmed by four virtual cameras with simulated
detections and solved as any action is (in FOLDER, cached). Printed are the coverage errors of each
clip's joints under some factors of the posterior's covariance and some deviations of the joints'
places, and those of all cameras.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.stats import chi2

from benchmarks.actions.action_folder import make_action
from benchmarks.actions.captured_videos import CapturedVideo
from benchmarks.parallel import LineDisplay
from benchmarks.sync_scenes import (
    CAPTURED_FPS,
    PROTOCOL_FPS,
    PROTOCOL_FRAMES,
    performances,
    training_clip,
)
from benchmarks.synthetic.captured import sample_frames
from imocap_core.adapters.joint import SolvedGroup, solved_groups
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, RefineSync
from imocap_core.conventions import EVAL_INDICES
from imocap_core.evaluate.action_scores import joint_errors_mm
from imocap_core.evaluate.scoreboard import video_truth
from imocap_core.io.truth import Truth, read_truth
from imocap_core.metrics.calibration import coverage_error, probability_content
from imocap_core.metrics.trajectory import camera_rotation_error_deg
from imocap_core.motion.motion_posterior import MotionPosterior, motion_posterior
from imocap_core.motion.posterior_noise import Noise
from imocap_core.params import Params
from imocap_core.pipeline import runner
from imocap_core.workspace import Workspace

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("IMOCAP_DATA", ROOT.parent / "shared" / "data"))
FILE = DATA / "train" / "cmu_train.npz"
PERFORMED = ("02_01", "03_02", "06_09", "07_12", "05_06", "13_09")
RESAMPLED = ("13_30", "01_01", "13_10")  # one motion, sampled as `released` in the paper's protocol
SEED = 5
STAGES = ["keypoints", "camera_motion", "initial_smpl", "sync", "smpl_ba", "redetect"]
STAGES += ["refine_sync"]
FACTORS = (0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5)
PLACES_MM = (0.0, 4.0, 6.0, 8.0)  # of joints in the body, standard deviation along each axis
CAMERA_FACTORS = np.arange(1.0, 16.0)

Pair = tuple[np.ndarray, np.ndarray]  # errors (T, 12, 3), mm; posterior covariances, mm^2


def performed_videos(clip: str) -> list[CapturedVideo]:
    """Four performances of a clip."""
    return [
        CapturedVideo(joints, phase, np.arange(len(phase)), CAPTURED_FPS)
        for joints, phase in zip(*performances(FILE, clip, SEED), strict=True)
    ]


def resampled_videos(clip: str) -> list[CapturedVideo]:
    """One motion at the protocol's frame rate, resampled for each of four videos."""
    joints = training_clip(FILE, clip)
    times = np.arange(0, len(joints) - 1, CAPTURED_FPS / PROTOCOL_FPS)[:PROTOCOL_FRAMES]
    fine = CubicSpline(np.arange(len(joints)), joints)(times)
    phase = np.arange(float(len(fine)))
    samples = [
        sample_frames("released", len(fine), v, np.random.default_rng([SEED, v])) for v in range(4)
    ]
    return [CapturedVideo(fine, phase, frames, PROTOCOL_FPS) for frames in samples]


def solved(
    folder: Path, name: str, videos: list[CapturedVideo]
) -> tuple[list[Pair], Float[np.ndarray, "n 2"]]:
    """Of each video the joints' errors and posterior covariances; of each camera but the
    reference's the error of its rotation and its posterior deviation, degrees."""
    action = folder / "actions" / name
    make_action(action, name, lambda: videos, "fine_tuned", {}, name)
    display = LineDisplay()
    job = Workspace(folder).ready_job(str(action), [], display)
    stored = {o.stage: o.stored for o in runner.run(job, display, STAGES)}
    keypoints = stored["keypoints"].decode(Keypoints)
    refined, params = stored["refine_sync"].decode(RefineSync), Params()
    group = solved_groups(
        keypoints,
        stored["camera_motion"].decode(CameraMotion),
        stored["initial_smpl"].decode(InitialSmpl),
        refined,
        params.fit,
        params.motion,
    )[0]
    scene = group.problem.scene_of(group.solution)
    noise = Noise(params.uncertainty)
    posterior = motion_posterior(scene, group.solution, group.problem.options, noise)
    truth = read_truth(action / "truth.npz", {v.id: v.frames for v in keypoints.videos})
    return _joints(group, posterior, refined, truth), _cameras(group, posterior, refined, truth)


def _joints(
    group: SolvedGroup, posterior: MotionPosterior, refined: RefineSync, truth: Truth
) -> list[Pair]:
    motions = {motion.id: motion for motion in refined.motion.videos}
    pairs = []
    for video, covariance in zip(group.ids, posterior.covariances_m2, strict=True):
        errors = joint_errors_mm(motions[video], truth)
        assert errors is not None
        pairs.append((errors, 1e6 * covariance[:, EVAL_INDICES]))
    return pairs


def _cameras(
    group: SolvedGroup, posterior: MotionPosterior, refined: RefineSync, truth: Truth
) -> Float[np.ndarray, "n 2"]:
    estimated = {camera.id: camera.R for camera in refined.motion.cameras}
    reference = refined.motion.reference
    rows = []
    for video, sd in zip(group.ids, posterior.camera_rotation_rad, strict=True):
        true, true_reference = (video_truth(truth, i) for i in (video, reference))
        if video != reference and true is not None and true_reference is not None:
            assert true.R is not None
            assert true_reference.R is not None
            error = camera_rotation_error_deg(
                estimated[video], estimated[reference], true.R, true_reference.R
            )
            rows.append((float(error), float(np.degrees(sd))))
    return np.array(rows)


def joint_coverage_error(pairs: Sequence[Pair], factor: float, place_mm: float) -> float:
    """Coverage error of the joints when claims are the posterior's covariance times a factor, plus
    that of their places in the body."""
    place = place_mm**2 * np.eye(3)
    return coverage_error(
        np.concatenate([probability_content(e, factor * C + place) for e, C in pairs])
    )


def main() -> None:
    """Solve, fit, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    videos = {f"perf-{clip}-{SEED}": performed_videos(clip) for clip in PERFORMED}
    videos |= {f"resampled-{clip}-{SEED}": resampled_videos(clip) for clip in RESAMPLED}
    results = {name: solved(folder, name, made) for name, made in videos.items()}
    for kind in ("perf", "resampled"):
        clips = [pairs for name, (pairs, _) in results.items() if name.startswith(kind)]
        for factor, place_mm in product(FACTORS, PLACES_MM):
            errors = [joint_coverage_error(pairs, factor, place_mm) for pairs in clips]
            each = ", ".join(f"{e:.3f}" for e in errors)
            print(
                f"{kind}: factor {factor}, places {place_mm:.0f} mm: "
                f"coverage error {np.mean(errors):.3f} ({each})"
            )
    error_deg, sd_deg = np.concatenate([cameras for _, cameras in results.values()]).T
    squares = 3.0 * np.square(error_deg / sd_deg)
    for factor in CAMERA_FACTORS:
        covered = coverage_error(chi2.cdf(squares / factor, df=3))
        print(f"CAMERA_VARIANCE_FACTOR {factor:.0f}: coverage error {covered:.3f}")


if __name__ == "__main__":
    main()
