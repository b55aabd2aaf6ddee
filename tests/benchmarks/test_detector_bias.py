"""The systematic errors measured on a simulated detector are those that it was given."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.detector.detection_errors import DetectedClip
from benchmarks.detector.detector_bias import detector_bias, swapped_body_share
from imocap_core.conventions import OTHER
from imocap_core.synthetic.detector import DetectorErrors, KeypointErrors, detect

NAMES = tuple(
    f"{side}_{kind}" for kind in ("shoulder", "elbow", "wrist", "hip") for side in ("left", "right")
)
HEIGHT_PX, FPS, FRAMES = 400.0, 30.0, 800
QUIET = {"noise": 1e-6, "outlier_rate": 0.0, "miss_rate": 0.0, "swap_rate": 0.0}


def film(seed: int, frames: int = FRAMES, **errors: object) -> DetectedClip:
    rng = np.random.default_rng(seed)
    still = 300 + 60 * rng.normal(size=(1, len(NAMES), 2))
    true = (
        still + 10 * rng.normal(size=(frames, 1, 2)) + 5 * rng.normal(size=(frames, len(NAMES), 2))
    )
    height = np.full(frames, HEIGHT_PX)
    detections = detect(true, height, NAMES, FPS, rng, DetectorErrors(**(QUIET | errors)))  # type: ignore[arg-type]
    visible = np.where(detections.confidence[..., None] > 0, detections.xy_px, np.nan)
    return DetectedClip(visible, true, height, "front", FPS)


def test_the_share_of_the_way_comes_back_and_is_no_offset() -> None:
    marking = {
        "wrist": KeypointErrors(towards="elbow", share=0.1),
        "hip": KeypointErrors(towards=OTHER, share=0.2),
    }
    films = [film(seed, by_kind=marking) for seed in range(3)]
    for kind, target, share in (
        ("wrist", "elbow", 0.1),
        ("hip", OTHER, 0.2),
        ("elbow", "wrist", 0.0),
    ):
        bias = detector_bias(films, NAMES, kind, target)
        assert bias.share == pytest.approx(share, abs=1e-4)
        assert bias.lasting < 1e-4
    assert detector_bias(films, NAMES, "wrist", "").lasting > 1e-3


def test_lasting_offsets_are_separated_from_noise() -> None:
    films = [
        film(seed, noise=0.006, persistent_share=1.0, persistence_s=0.15, constant_offset=0.01)
        for seed in range(30)
    ]
    bias = detector_bias(films, NAMES, "elbow", "")
    assert bias.lasting == pytest.approx(0.01, rel=0.25)
    assert bias.spread == pytest.approx(0.006, rel=0.15)
    assert bias.persistent > 0.9
    assert bias.persistence_s == pytest.approx(0.15, rel=0.3)


def test_outliers_come_at_their_rate_and_stay_in_bouts() -> None:
    marking = {"wrist": KeypointErrors(outliers=2.0), "hip": KeypointErrors(outliers=0.0)}
    films = [
        film(seed, outlier_rate=0.03, outlier_noise=0.3, outlier_s=0.2, by_kind=marking)
        for seed in range(4)
    ]
    wrist = detector_bias(films, NAMES, "wrist", "")
    assert wrist.outlier_rate == pytest.approx(0.06, rel=0.25)
    assert wrist.outlier_s == pytest.approx(0.2, rel=0.15)
    assert wrist.outlier_size == pytest.approx(0.3, rel=0.15)
    assert detector_bias(films, NAMES, "hip", "").outlier_rate == 0


def test_only_a_body_swapped_as_a_whole_is_turned() -> None:
    clean = film(1, frames=100)
    for kinds, share in ((("shoulder", "elbow", "wrist"), 0.0), (("shoulder", "hip"), 0.3)):
        detected = clean.detected_px.copy()
        for kind in kinds:
            left, right = NAMES.index(f"left_{kind}"), NAMES.index(f"right_{kind}")
            detected[20:50, [left, right]] = clean.detected_px[20:50, [right, left]]
        swapped = DetectedClip(detected, clean.true_px, clean.height_px, "front", FPS)
        assert swapped_body_share(swapped, NAMES, 0.01) == pytest.approx(share)
