"""Degraded footage: its pictures, action folders, choices and scores."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks import detection_errors
from benchmarks.degraded import ACTIONS
from benchmarks.degraded_footage import FOOTAGES, THIRDS, degraded_pictures, make_footage
from benchmarks.detector import (
    DEGRADATIONS,
    LEGS,
    PARTS,
    SIDES,
    PerformerLimbs,
    best_shift,
    errors,
    halved,
    motion_blur,
    score_of,
    second_person,
    shifted,
)
from imocap_core.conventions import OTHER
from imocap_core.io.video import probe, read_rgb, write_h264
from imocap_core.synthetic.detector import DetectorErrors, KeypointErrors, detect, persistent_noise


def limbs(x: float = 60.0) -> np.ndarray:
    """Somebody who stands at x: 12 joints, left, then right."""
    rows = np.array([30, 50, 70, 70, 100, 130], float)
    left, right = np.column_stack([x + 0 * rows + 8, rows]), np.column_stack([x + 0 * rows, rows])
    return np.concatenate([left, right])


def picture() -> np.ndarray:
    return np.random.default_rng(0).integers(1, 255, (160, 200, 3)).astype(np.uint8)


def test_the_second_person_is_the_first_s_mirror_image_and_leaves_most_of_it() -> None:
    plain = picture()
    pasted = second_person(plain, limbs(), 0.5)
    changed = (pasted != plain).any(axis=2).any(axis=0)
    assert 0 < changed.sum() < 60
    assert np.flatnonzero(changed)[0] > 60  # beside, not over
    assert np.array_equal(plain, picture())


def test_blur_and_halving_keep_the_mean_and_their_sizes() -> None:
    plain = picture()
    assert motion_blur(plain, limbs(), 0.0).shape == plain.shape
    assert halved(plain, limbs(), 0.0).shape == (80, 100, 3)
    for change in (motion_blur, halved):
        assert change(plain, limbs(), 0.0).mean() == pytest.approx(plain.mean(), rel=0.02)
        assert change(plain, limbs(), 0.0).std() < 0.8 * plain.std()
    assert len({degradation.name for degradation in DEGRADATIONS}) == len(DEGRADATIONS)


def walk(frames: int = 12) -> np.ndarray:
    return np.stack([limbs(40 + 5 * t) for t in range(frames)])


def result(xy: np.ndarray) -> PerformerLimbs:
    return PerformerLimbs(np.arange(len(xy)), xy, 1.0, 1.0)


def test_exact_detections_have_no_errors_and_missing_ones_count() -> None:
    row = errors(result(walk()), walk()) | {"people": 1.0, "ms": 1.0}
    exact = score_of("a", "plain", [row])
    assert (exact.followed_pct, exact.error_pct, exact.pck_1, exact.swapped) == (100, 0, 100, 0)
    missing = walk()
    missing[:6] = np.nan
    row = errors(result(missing), walk()) | {"people": 1.0, "ms": 1.0}
    half = score_of("a", "plain", [row])
    assert (half.followed_pct, half.error_pct, half.pck_2, half.swapped) == (50, 0, 50, 0)


def test_swapped_bodies_are_counted() -> None:
    row = errors(result(np.roll(walk(), 6, axis=1)), walk())
    assert np.asarray(row["swapped"]).all()


@pytest.mark.parametrize("by", [-3, 0, 2])
def test_the_shift_of_the_reference_is_estimated(by: int) -> None:
    assert best_shift(result(shifted(walk(), by)), walk()) == by
    assert np.isnan(shifted(walk(), by)).any() == (by != 0)


BIASED_NAMES = tuple(
    f"{side}_{kind}" for kind in ("shoulder", "elbow", "wrist", "hip") for side in ("left", "right")
)
FRAMES = 800
QUIET = {"noise": 1e-6, "outlier_rate": 0.0, "miss_rate": 0.0, "swap_rate": 0.0}


def biased_film(seed: int, frames: int = FRAMES, **errors: object) -> detection_errors.DetectedClip:
    rng = np.random.default_rng(seed)
    still = 300 + 60 * rng.normal(size=(1, len(BIASED_NAMES), 2))
    true = (
        still
        + 10 * rng.normal(size=(frames, 1, 2))
        + 5 * rng.normal(size=(frames, len(BIASED_NAMES), 2))
    )
    height = np.full(frames, HEIGHT_PX)
    detections = detect(true, height, BIASED_NAMES, FPS, rng, DetectorErrors(**(QUIET | errors)))  # type: ignore[arg-type]
    visible = np.where(detections.confidence[..., None] > 0, detections.xy_px, np.nan)
    return detection_errors.DetectedClip(visible, true, height, "front", FPS)


def test_the_share_of_the_way_comes_back_and_is_no_offset() -> None:
    marking = {
        "wrist": KeypointErrors(towards="elbow", share=0.1),
        "hip": KeypointErrors(towards=OTHER, share=0.2),
    }
    films = [biased_film(seed, by_kind=marking) for seed in range(3)]
    for kind, target, share in (
        ("wrist", "elbow", 0.1),
        ("hip", OTHER, 0.2),
        ("elbow", "wrist", 0.0),
    ):
        bias = detection_errors.detector_bias(films, BIASED_NAMES, kind, target)
        assert bias.share == pytest.approx(share, abs=1e-4)
        assert bias.lasting < 1e-4
    assert detection_errors.detector_bias(films, BIASED_NAMES, "wrist", "").lasting > 1e-3


def test_lasting_offsets_are_separated_from_noise() -> None:
    films = [
        biased_film(
            seed, noise=0.006, persistent_share=1.0, persistence_s=0.15, constant_offset=0.01
        )
        for seed in range(30)
    ]
    bias = detection_errors.detector_bias(films, BIASED_NAMES, "elbow", "")
    assert bias.lasting == pytest.approx(0.01, rel=0.25)
    assert bias.spread == pytest.approx(0.006, rel=0.15)
    assert bias.persistent > 0.9
    assert bias.persistence_s == pytest.approx(0.15, rel=0.3)


def test_outliers_come_at_their_rate_and_stay_in_bouts() -> None:
    marking = {"wrist": KeypointErrors(outliers=2.0), "hip": KeypointErrors(outliers=0.0)}
    films = [
        biased_film(seed, outlier_rate=0.03, outlier_noise=0.3, outlier_s=0.2, by_kind=marking)
        for seed in range(4)
    ]
    wrist = detection_errors.detector_bias(films, BIASED_NAMES, "wrist", "")
    assert wrist.outlier_rate == pytest.approx(0.06, rel=0.25)
    assert wrist.outlier_s == pytest.approx(0.2, rel=0.15)
    assert wrist.outlier_size == pytest.approx(0.3, rel=0.15)
    assert detection_errors.detector_bias(films, BIASED_NAMES, "hip", "").outlier_rate == 0


def test_only_a_body_swapped_as_a_whole_is_turned() -> None:
    clean = biased_film(1, frames=100)
    for kinds, share in ((("shoulder", "elbow", "wrist"), 0.0), (("shoulder", "hip"), 0.3)):
        detected = clean.detected_px.copy()
        for kind in kinds:
            left, right = BIASED_NAMES.index(f"left_{kind}"), BIASED_NAMES.index(f"right_{kind}")
            detected[20:50, [left, right]] = clean.detected_px[20:50, [right, left]]
        swapped = detection_errors.DetectedClip(
            detected, clean.true_px, clean.height_px, "front", FPS
        )
        assert detection_errors.swapped_body_share(swapped, BIASED_NAMES, 0.01) == pytest.approx(
            share
        )


NAMES = ("nose", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow",
         "right_wrist")  # fmt: skip
HEIGHT_PX, FPS = 400.0, 30.0
BIAS, SPREAD = np.array([0.01, -0.02]), 0.008


def film(rng: np.random.Generator, frames: int = 3000) -> detection_errors.DetectedClip:
    true = 300 + 150 * rng.uniform(-1, 1, (1, len(NAMES), 2)) + 20 * rng.normal(size=(frames, 1, 2))
    error = BIAS + SPREAD * persistent_noise(true.shape, 0.3 * FPS, rng)
    return detection_errors.DetectedClip(
        true + HEIGHT_PX * error, true, np.full(frames, HEIGHT_PX), "front", FPS
    )


def test_bias_spread_and_persistence_come_back() -> None:
    rng = np.random.default_rng(0)
    for row in detection_errors.point_errors([film(rng), film(rng)], NAMES):
        assert (row.bias_x, row.bias_y) == pytest.approx(tuple(BIAS), abs=0.0015)
        assert row.spread == pytest.approx(SPREAD, rel=0.1)
        assert row.persistent == pytest.approx(0.5, abs=0.1)
        assert row.persistence_s == pytest.approx(0.3, abs=0.12)
        assert row.outlier_rate < 0.001
        assert row.miss_rate == 0


def test_errors_scale_with_the_person() -> None:
    small = film(np.random.default_rng(1))
    large = detection_errors.DetectedClip(
        3 * small.detected_px, 3 * small.true_px, 3 * small.height_px, "front", FPS
    )
    for a, b in zip(
        detection_errors.point_errors([small], NAMES),
        detection_errors.point_errors([large], NAMES),
        strict=True,
    ):
        assert a.spread == pytest.approx(b.spread)
        assert a.bias_x == pytest.approx(b.bias_x)


def test_outliers_and_misses_are_counted_apart() -> None:
    rng = np.random.default_rng(2)
    clean = film(rng)
    detected = clean.detected_px.copy()
    wrong = rng.random(len(detected)) < 0.04
    detected[wrong, 0] += 0.2 * HEIGHT_PX
    detected[rng.random(len(detected)) < 0.1, 1] = np.nan
    spoiled = detection_errors.DetectedClip(detected, clean.true_px, clean.height_px, "front", FPS)
    nose, shoulder = detection_errors.point_errors([spoiled], NAMES)[:2]
    assert nose.outlier_rate == pytest.approx(wrong.mean(), abs=0.003)
    assert nose.outlier_size == pytest.approx(0.2, rel=0.1)
    assert (nose.unused_rate, nose.used_outlier_rate) == (0.0, nose.outlier_rate)
    is_used = np.tile(~wrong[:, None], len(NAMES))
    is_used[np.flatnonzero(wrong)[0]] = True  # one of the wrong ones is used all the same
    (unsure, *_) = detection_errors.point_errors([replace(spoiled, is_used=is_used)], NAMES)
    assert unsure.outlier_rate == nose.outlier_rate
    assert unsure.unused_rate == pytest.approx((wrong.sum() - 1) / len(wrong))
    assert unsure.used_outlier_rate == pytest.approx(1 / is_used[:, 0].sum(), abs=0.002)
    assert nose.spread == pytest.approx(SPREAD, rel=0.1)
    assert nose.bias_x == pytest.approx(BIAS[0], abs=0.0015)
    assert shoulder.miss_rate == pytest.approx(0.1, abs=0.02)
    assert shoulder.outlier_rate < 0.001


def test_swapped_arms_and_only_those_are_counted() -> None:
    clean = film(np.random.default_rng(3), frames=200)
    assert detection_errors.swapped_share(clean, NAMES, "arm") == 0
    detected = clean.detected_px.copy()
    detected[50:80, 1:4], detected[50:80, 4:7] = (
        clean.detected_px[50:80, 4:7],
        clean.detected_px[50:80, 1:4],
    )
    swapped = detection_errors.DetectedClip(detected, clean.true_px, clean.height_px, "front", FPS)
    assert detection_errors.swapped_share(swapped, NAMES, "arm") == pytest.approx(30 / 200)


def test_white_errors_have_no_persistence() -> None:
    rng = np.random.default_rng(4)
    true = np.zeros((2000, 1, 2))
    noise = detection_errors.DetectedClip(
        rng.normal(0, 4.0, true.shape), true, np.full(2000, HEIGHT_PX), "front", FPS
    )
    (row,) = detection_errors.point_errors([noise], ["nose"])
    assert np.isnan(row.persistent)
    assert row.spread == pytest.approx(0.01, rel=0.05)


COUNT, SIZE = 12, (112, 96)  # width, height
VIDEOS = ("v1", "v2", "v3", "v4")
BY_NAME = {footage.name: footage for footage in FOOTAGES}


def standing_limbs() -> np.ndarray:
    """Somebody who stands in the middle, in pixels: 12 joints, left, then right."""
    rows = np.array([20, 30, 42, 42, 60, 80], float)
    left, right = (np.column_stack([np.full(6, x), rows]) for x in (60.0, 46.0))
    return np.concatenate([left, right])


def pictures() -> list[np.ndarray]:
    """Light pictures, each with a grey level of its own."""
    return [np.full((SIZE[1], SIZE[0], 3), 100 + 10 * t, np.uint8) for t in range(COUNT)]


def changed(name: str, video: int = 1, limbs_px: np.ndarray | None = None) -> np.ndarray:
    """The pictures of one degraded video (T, height, width, 3)."""
    where = np.tile(standing_limbs(), (COUNT, 1, 1)) if limbs_px is None else limbs_px
    return np.stack(list(degraded_pictures(pictures(), where, BY_NAME[name], video)))


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """An action of four videos with keypoints declared, a calibration and a triangulation, in which
    the performer's metres are pixels."""
    folder = tmp_path / "data" / ACTIONS[0]
    (folder / "videos").mkdir(parents=True)
    for video in VIDEOS:
        write_h264(folder / "videos" / f"{video}.mp4", pictures(), 30.0, crf=6)
    eye = np.tile(np.eye(3), (4, 1, 1))
    np.savez(folder / "calibration.npz", K=eye, R=eye, t=np.zeros((4, 3)), cams=np.array(VIDEOS))
    xyz = np.tile(np.column_stack([standing_limbs(), np.ones(12)]), (COUNT, 1, 1))
    markers = [f"{side[0].upper()}{part.title()}" for side in SIDES for part in PARTS]
    np.savez(folder / "trc_reference.npz", xyz_zup_m=xyz, names=np.array(markers))
    declared = [
        {"id": video, "video": f"videos/{video}.mp4", "keypoints": f"keypoints/{video}"}
        | {"format": "openpose", "layout": "body25b", "frames": [0, COUNT]}
        for video in VIDEOS
    ]
    (folder / "action.yaml").write_text(yaml.safe_dump({"name": "tiny", "videos": declared}))
    return folder


def made(source: Path, name: str) -> Path:
    folder = source.parents[1] / f"tiny-{name}"
    make_footage(folder, source, BY_NAME[name])
    return folder


def has_hidden_legs(picture: np.ndarray) -> bool:
    return all(picture[int(y), int(x)].max() < 30 for x, y in standing_limbs()[LEGS])


@pytest.mark.parametrize(("video", "begin"), [*enumerate(THIRDS)])
def test_legs_are_hidden_in_their_third_alone(video: int, begin: float) -> None:
    hidden, plain = changed("legs-all", video), np.stack(pictures())
    inside = np.array([begin <= t / COUNT < begin + 1 / 3 for t in range(COUNT)])
    assert inside.sum() == COUNT // 3
    assert [has_hidden_legs(picture) for picture in hidden] == inside.tolist()
    np.testing.assert_array_equal(hidden[~inside], plain[~inside])
    np.testing.assert_array_equal(hidden[:, :35], plain[:, :35])  # above the hips


def test_pictures_without_the_performer_s_place_stay_as_they_are() -> None:
    where = np.tile(standing_limbs(), (COUNT, 1, 1))
    where[5, 0] = np.nan
    hidden = changed("legs-one", limbs_px=where)
    assert [has_hidden_legs(picture) for picture in hidden[4:8]] == [True, False, True, True]


def test_a_dropped_frame_shows_the_last_picture_again() -> None:
    levels = changed("dropped-one")[:, 0, 0, 0].astype(int)
    plain = np.array([picture[0, 0, 0] for picture in pictures()], int)
    assert len(levels) == COUNT
    assert levels[0] == plain[0]
    for t in range(1, COUNT):
        assert levels[t] in (plain[t], levels[t - 1])
    assert 2 < len(set(levels)) < COUNT - 2
    assert (changed("dropped-all", 2)[:, 0, 0, 0] != levels).any()  # each video drops others


def test_a_degraded_action_is_detected_and_has_the_truth_of_its_source(source: Path) -> None:
    folder = made(source, "legs-one")
    action = yaml.safe_load((folder / "action.yaml").read_text())
    assert action["name"] == "tiny-legs-one"
    assert action["videos"] == [
        {"id": v, "video": f"videos/{v}.mp4", "keypoints": "detect", "frames": [0, COUNT]}
        for v in VIDEOS
    ]
    for file in ("calibration.npz", "trc_reference.npz", "videos/v1.mp4", "videos/v3.mp4"):
        assert (folder / file).read_bytes() == (source / file).read_bytes()
    assert probe(folder / "videos" / "v2.mp4") == probe(source / "videos" / "v2.mp4")
    inside = [has_hidden_legs(picture) for _, picture in read_rgb(folder / "videos" / "v2.mp4")]
    assert inside == [4 <= t < 8 for t in range(COUNT)]


def test_a_folder_is_made_once_and_again_when_its_source_changes(source: Path) -> None:
    folder = made(source, "plain")
    before = folder.stat().st_ino
    assert made(source, "plain").stat().st_ino == before
    write_h264(source / "videos" / "v1.mp4", pictures()[::-1], 30.0)
    assert made(source, "plain").stat().st_ino != before
