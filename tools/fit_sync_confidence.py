"""Fit the weights of `imocap_core/sync/confidence.py` on scenes of training clips and print them:
python -m tools.fit_sync_confidence --seeds 1 2 --figure docs/images/sync_reliability.svg

Logistic regression with a weak ridge, every kind of scene of the same weight. Printed with it is
the expected calibration error of each kind, each clip predicted from the others; the figure is
their reliability diagram.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from benchmarks.sync_reliability import (
    KINDS,
    calibration_scenes,
    expected_calibration_error,
    right_frames,
)
from benchmarks.sync_scenes import SyncScene
from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, joint_synchronisation, synchronise
from imocap_core.sync.confidence import WEIGHTS, calibrated_confidence, confidence_features
from tools.reliability_picture import write_reliability

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("IMOCAP_DATA", ROOT.parent / "shared" / "data"))
RIDGE = 1e-3


def frames_of(scene: SyncScene, settings: SyncParams) -> tuple[np.ndarray, np.ndarray]:
    """Features (n, F) of all matched frames of a scene, and which are right."""
    features: dict[int, np.ndarray] = {}

    def recorded(route, distances, pairs):  # type: ignore[no-untyped-def]
        features[route.v] = confidence_features(route, distances, pairs)
        return calibrated_confidence(route, distances, pairs)

    with patch.object(joint_synchronisation, "calibrated_confidence", recorded):
        evidence = SyncEvidence(scene.poses, scene.fps)
        sync = synchronise(evidence, settings, np.random.default_rng(0))
    used = [v for v in range(len(scene.poses)) if v not in sync.screening.excluded]
    parts = []
    for k, x in features.items():
        v = used[k]
        right, judged = right_frames(scene, sync, v, settings.confidence_reach_s)
        parts.append((x[judged], right[judged]))
    return np.concatenate([x for x, _ in parts]), np.concatenate([y for _, y in parts])


def fitted(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weights of the logistic regression, the ridge on features of unit variance."""
    scale = np.maximum(x.std(axis=0), 1e-6)
    scale[0] = 1.0
    z, share = x / scale, weight / weight.sum()

    def loss(b: np.ndarray) -> tuple[float, np.ndarray]:
        u = z @ b
        penalty = RIDGE * np.concatenate([[0.0], b[1:]])
        value = share @ (np.logaddexp(0.0, u) - y * u) + penalty @ b
        return float(value), z.T @ (share * (expit(u) - y)) + 2.0 * penalty

    return np.asarray(minimize(loss, np.zeros(x.shape[1]), jac=True).x / scale)


def main() -> None:
    """Collect, fit, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--figure", type=Path)
    arguments = parser.parse_args()
    seeds = arguments.seeds
    xs, ys, kinds, clips = [], [], [], []
    for kind in KINDS:
        for seed in seeds:
            for scene in calibration_scenes(DATA / "train" / "cmu_train.npz", kind, seed):
                x, y = frames_of(scene, SyncParams())
                xs.append(x)
                ys.append(y)
                kinds += [kind] * len(y)
                clips += [scene.name.split()[-1]] * len(y)
    x, y = np.concatenate(xs), np.concatenate(ys)
    predicted = report(x, y, np.array(kinds), np.array(clips))
    if arguments.figure:
        write_reliability(arguments.figure, predicted, y, np.array(kinds), KINDS)


def report(x: np.ndarray, y: np.ndarray, kinds: np.ndarray, clips: np.ndarray) -> np.ndarray:
    """Print the weights, and the calibration error of clips that were left out; returns their
    predictions (n,)."""
    sizes = {kind: 1.0 / (kinds == kind).sum() for kind in np.unique(kinds)}
    weight = np.array([sizes[kind] for kind in kinds])
    predicted = np.empty(len(y))
    for clip in np.unique(clips):
        here = clips == clip
        predicted[here] = expit(x[here] @ fitted(x[~here], y[~here], weight[~here]))
    for kind in np.unique(kinds):
        of_kind = kinds == kind
        error = expected_calibration_error(predicted[of_kind], y[of_kind])
        print(f"{kind:12s} {of_kind.sum():6d} frames, calibration error {error:.3f}")
    for name, value in zip(WEIGHTS, fitted(x, y, weight), strict=True):
        print(f'    "{name}": {value:.3f},')
    return predicted


if __name__ == "__main__":
    main()
