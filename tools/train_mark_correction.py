"""Train the correction of BlazePose's marks of shoulders and hips:

    python -m tools.train_mark_correction DATA/train/cmu_train.npz --work FOLDER [--write]

The films of `tools.fit_detector_marks`, cached in FOLDER. The network learns the shift from the
detected point to the projected mark of the layout, from left sides and mirrored right ones, with a
Student loss. Prints the mean distance in % of the height, points off by more than 5 % left out, of
films that took no part (one group of performers after another), and with --write stores the
network that all films trained in imocap_core/lifter/data.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from imocap_core.body.layouts import joint_mix, layout_names
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.detect.detectors import detector_of
from imocap_core.lifter.keypoint_offsets import (
    FLIP,
    TRUNK,
    ShiftNetwork,
    corrected_marks,
    left_limb,
    write_weights,
)
from imocap_core.params import DetectParams
from tools.fit_detector_marks import CLIPS, ROOT, VIEWS, DetectedFilm, films

LAYOUT = "blazepose33"
NAMES = layout_names(LAYOUT)
WIDTH, DROPOUT = 24, 0.2
STEPS, BATCH, RATE, DECAY = 900, 512, 4e-3, 0.3
JITTER = 0.06  # of the body's spread, added to the input
UNIT = 0.1  # of the body's spread: the output's
FREEDOM = 4.0  # degrees of the Student loss
FAR = 0.05  # of the height: no longer the same mark
HEIGHT_M = 1.7
GROUPS = (("01", "06", "11"), ("02", "10", "03"), ("07", "12"), ("05",), ("13",))  # performers


@dataclass(frozen=True)
class Samples:
    """Features and true shifts of the left side of an end of the trunk."""

    features: Float[Tensor, "N F"]
    shift: Float[Tensor, "N 2"]


def mark_px(film: DetectedFilm, name: str) -> Float[np.ndarray, "T 2"]:
    """Where the layout's mark projects."""
    mix = joint_mix(LAYOUT, name)
    places = [SMPL_JOINTS.index(joint) for joint in mix]
    xyz = np.einsum("j,tji->ti", list(mix.values()), film.joints[:, places])
    return np.asarray(xyz[:, :2] / xyz[:, 2:] * film.K[[0, 1], [0, 1]] + film.K[:2, 2])


def samples(every: Sequence[DetectedFilm], end: str) -> Samples:
    """All frames of some films in which somebody was detected, right sides mirrored."""
    twins = list(mirror_indices(NAMES))
    features, shifts = [], []
    for film in every:
        detected = np.isfinite(film.detected_px).all(axis=(1, 2))
        xy = film.detected_px[detected]
        mirrored = xy[:, twins] * FLIP
        for side, pose_px, flip in (("left", xy, np.ones(2)), ("right", mirrored, FLIP)):
            limb = left_limb(pose_px, NAMES, end)
            mark = mark_px(film, f"{side}_{end}")[detected] * flip
            features.append(limb.features)
            shift_px = mark - pose_px[:, NAMES.index(f"left_{end}")]
            shifts.append(shift_px / limb.spread_px[:, None])
    arrays = (torch.as_tensor(np.concatenate(a)).float() for a in (features, shifts))
    return Samples(*arrays)


def train(given: Samples, seed: int) -> ShiftNetwork:
    """A network for the samples."""
    torch.manual_seed(seed)
    mean, scale = given.features.mean(0), given.features.std(0) + 0.01
    x, jitter = (given.features - mean) / scale, JITTER / scale
    sizes = (x.shape[1], WIDTH, WIDTH, 2)
    layers = [nn.Linear(n, m) for n, m in itertools.pairwise(sizes)]
    first, second, last = layers
    network = nn.Sequential(first, nn.Tanh(), nn.Dropout(DROPOUT), second, nn.Tanh(), last)
    log_scale = nn.Parameter(torch.tensor(-3.0))
    with torch.no_grad():
        last.weight.mul_(0.1)
        last.bias.zero_()
    optimizer = torch.optim.AdamW([*network.parameters(), log_scale], RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, STEPS, pct_start=0.1)
    for _ in range(STEPS):
        batch = torch.randint(0, len(x), (BATCH,))
        output = network(x[batch] + jitter * torch.randn_like(x[batch]))
        squared = (given.shift[batch] - UNIT * output).square().sum(-1)
        surprise = (squared / (FREEDOM * (2 * log_scale).exp())).log1p()
        loss = 2 * log_scale + (FREEDOM / 2 + 1) * surprise.mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    with torch.no_grad():
        last.weight.mul_(UNIT)
        last.bias.mul_(UNIT)
    weights, biases = (
        tuple(getattr(layer, name).detach().numpy() for layer in layers)
        for name in ("weight", "bias")
    )
    return ShiftNetwork(mean.numpy(), scale.numpy(), weights, biases)


def correction_of(every: Sequence[DetectedFilm], seed: int) -> dict[str, ShiftNetwork]:
    """The networks that some films train, by end of the trunk."""
    return {end: train(samples(every, end), seed) for end in TRUNK}


def distances(
    film: DetectedFilm, xy_px: Float[np.ndarray, "T K 2"], end: str
) -> Float[np.ndarray, "_"]:
    """Of the detected points of both sides from their marks, shares of the height."""
    depth = np.median(film.joints[..., 2], axis=1)
    away = [
        np.linalg.norm(xy_px[:, NAMES.index(name)] - mark_px(film, name), axis=-1)
        for name in (f"left_{end}", f"right_{end}")
    ]
    return np.concatenate([a * depth / film.K[0, 0] / HEIGHT_M for a in away])


def report(every: Sequence[DetectedFilm], seed: int) -> None:
    """Print the distances in films that took no part, without and with the correction."""
    performer = [clip.split("_")[0] for clip in CLIPS for _ in range(VIEWS)]
    pairs = list(zip(every, performer, strict=True))
    plain: dict[str, list[np.ndarray]] = {end: [] for end in TRUNK}
    moved: dict[str, list[np.ndarray]] = {end: [] for end in TRUNK}
    for group in GROUPS:
        correction = correction_of([film for film, p in pairs if p not in group], seed)
        for film in (film for film, p in pairs if p in group):
            corrected = corrected_marks(film.detected_px, NAMES, correction)
            for end in TRUNK:
                plain[end].append(distances(film, film.detected_px, end))
                moved[end].append(distances(film, corrected, end))
    for end in TRUNK:
        before, after = np.concatenate(plain[end]), np.concatenate(moved[end])
        near = before < FAR
        print(f"{end:9} {100 * before[near].mean():.2f} -> {100 * after[near].mean():.2f} %")


def main() -> None:
    """Film, detect, train, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    parser.add_argument("--work", type=Path, required=True, help="films that were detected")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true", help="store the network in the package")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    detector = detector_of(DetectParams(detector="blazepose"), ROOT)
    every = films(arguments.train, arguments.work, detector)
    report(every, arguments.seed)
    if arguments.write:
        folder = ROOT / "imocap_core" / "lifter" / "data"
        write_weights(folder / f"{LAYOUT}.safetensors", correction_of(every, arguments.seed))


if __name__ == "__main__":
    main()
