"""The simulated detector has errors of the stated rates and sizes."""

import numpy as np
import pytest

from imocap_core.camera.projection import project
from imocap_core.conventions import OTHER, SMPL_JOINTS
from imocap_core.synthetic.detector import DetectorErrors, KeypointErrors, detect, false_people

NAMES = (
    "nose",
    "left_wrist",
    "right_wrist",
    "left_elbow",
    "right_elbow",
    "left_knee",
    "right_knee",
)
FRAMES = 4000


def still(height_px: float = 300.0):
    """A person who does not move: true keypoints (T, K, 2), heights (T,)."""
    figure = np.array([[50, 0], [0, 40], [100, 40], [20, 30], [80, 30], [40, 90], [60, 90.0]])
    return np.tile(figure, (FRAMES, 1, 1)), np.full(FRAMES, height_px)


def only(**kinds: object) -> DetectorErrors:
    quiet = {"noise": 1e-9, "outlier_rate": 0.0, "miss_rate": 0.0, "swap_rate": 0.0}
    return DetectorErrors(**(quiet | kinds))  # type: ignore[arg-type]


def test_noise_has_the_stated_size_and_half_of_it_persists():
    truth, height = still()
    errors = only(noise=4 / 600)
    detections = detect(truth, height, NAMES, 30.0, np.random.default_rng(0), errors)
    noise = detections.xy_px - truth
    assert noise.std() == pytest.approx(2.0, rel=0.15)
    lagged = (noise[3:] * noise[:-3]).mean() / (noise**2).mean()
    rho = np.exp(-1 / (errors.persistence_s * 30))
    assert lagged == pytest.approx(0.5 * rho**3, abs=0.06)


def test_noise_scales_with_the_person():
    errors = only(noise=4 / 600)
    sizes = []
    for height_px in (100.0, 400.0):
        truth, height = still(height_px)
        detections = detect(truth, height, NAMES, 30.0, np.random.default_rng(1), errors)
        sizes.append((detections.xy_px - truth).std())
    assert sizes[1] / sizes[0] == pytest.approx(4.0)


def test_misses_outliers_and_swaps_come_at_their_rates():
    truth, height = still()
    rng = np.random.default_rng(2)
    missed = detect(truth, height, NAMES, 30.0, rng, only(miss_rate=0.02))
    gone = missed.confidence == 0
    assert gone.mean() == pytest.approx(0.02, abs=0.004)
    assert (missed.xy_px[gone] == 0).all()
    outliers = detect(truth, height, NAMES, 30.0, rng, only(outlier_rate=0.02))
    assert (np.abs(outliers.xy_px - truth).max(axis=-1) > 1).mean() == pytest.approx(
        0.02, abs=0.004
    )
    swapped = detect(truth, height, NAMES, 30.0, rng, only(swap_rate=0.007)).xy_px
    arms = np.abs(swapped[:, 1] - truth[:, 2]).max(axis=-1) < 1
    assert 0.002 < arms.mean() < 0.016
    assert (np.abs(swapped[arms][:, 3] - truth[arms][:, 4]) < 1).all()  # the elbow goes along


def test_errors_by_kind_draw_no_random_numbers():
    """Detectors without them give the same detections: the protocol's inputs depend on it."""
    truth, height = still()
    plain = detect(truth, height, NAMES, 30.0, np.random.default_rng(5), only(noise=0.01))
    by_kind = {
        "wrist": KeypointErrors(),
        "knee": KeypointErrors(towards="ankle", share=0.5),
    }  # no ankle here
    named = only(noise=0.01, by_kind=by_kind)
    again = detect(truth, height, NAMES, 30.0, np.random.default_rng(5), named)
    assert (plain.xy_px == again.xy_px).all()
    assert (plain.confidence == again.confidence).all()


def test_keypoints_are_offset_towards_others():
    truth, height = still()
    by_kind = {
        "wrist": KeypointErrors(towards="elbow", share=0.25),
        "knee": KeypointErrors(0, 0, OTHER, 0.1),
    }
    marked = detect(
        truth, height, NAMES, 30.0, np.random.default_rng(6), only(by_kind=by_kind)
    ).xy_px
    assert marked[0, 1] == pytest.approx(0.75 * truth[0, 1] + 0.25 * truth[0, 3], abs=1e-4)
    assert marked[0, 5] == pytest.approx(truth[0, 5] + 0.1 * (truth[0, 6] - truth[0, 5]), abs=1e-4)
    assert marked[0, 3] == pytest.approx(truth[0, 3], abs=1e-4)


def test_the_difficulty_of_a_point_changes_from_film_to_film_and_not_the_total():
    truth, height = still()
    spreads = []
    for seed in range(60):
        errors = only(noise=0.01, difficulty_spread=0.5, persistent_share=0.0)
        detections = detect(
            truth[:400], height[:400], NAMES, 30.0, np.random.default_rng(seed), errors
        )
        spreads.append((detections.xy_px - truth[:400]).std(axis=(0, 2)) / 300)
    stated = np.array(spreads)
    assert np.sqrt((stated**2).mean()) == pytest.approx(0.01, rel=0.1)
    assert np.log(stated).std() == pytest.approx(0.5, rel=0.15)


def test_a_whole_body_is_turned_at_its_rate():
    truth, height = still()
    detections = detect(
        truth, height, NAMES, 30.0, np.random.default_rng(7), only(full_swap_rate=0.05)
    ).xy_px
    turned = np.abs(detections[:, [1, 3, 5]] - truth[:, [2, 4, 6]]).max(axis=(1, 2)) < 1
    straight = np.abs(detections - truth).max(axis=(1, 2)) < 1
    assert turned.mean() == pytest.approx(0.05, rel=0.3)
    assert (turned | straight).all()


def test_confidence_reflects_error_but_imperfectly():
    truth, height = still()
    detections = detect(truth, height, NAMES, 30.0, np.random.default_rng(3))
    detected = detections.confidence > 0
    error = np.linalg.norm(detections.xy_px - truth, axis=-1)[detected]
    ranks = np.corrcoef(
        error.argsort().argsort(), detections.confidence[detected].argsort().argsort()
    )
    assert -0.9 < ranks[0, 1] < -0.2
    assert (detections.confidence[detected] <= 1).all()


def test_false_people_are_rare_brief_and_never_absent():
    truth, height = still()
    performer = detect(truth, height, NAMES, 30.0, np.random.default_rng(4))
    for seed in range(4):
        present = [
            s is not None for s in false_people(performer, (640, 360), np.random.default_rng(seed))
        ]
        assert 1 <= sum(present) < 0.03 * FRAMES


def test_detections_of_a_clip_lie_within_noise_of_the_projected_truth(clips):
    """Truth joints through K, R_t, t reproduce the detector's wrists, knees and ankles."""
    for clip in clips:
        names = ("left_wrist", "right_wrist", "left_knee", "right_knee", "left_ankle")
        xy = project(
            clip.joints[:, [SMPL_JOINTS.index(n) for n in names]],
            clip.camera.K,
            clip.camera.R_cam_from_world,
            clip.camera.t[:, None],
        )
        columns = [7, 4, 13, 10, 14]  # the same in BODY_25's order
        detected = clip.detections.confidence[:, columns] > 0
        error = np.linalg.norm(clip.detections.xy_px[:, columns] - xy, axis=-1)[detected]
        assert 0.5 < np.median(error) < 4.0
        assert np.median(np.linalg.norm(clip.xy_px[:, columns] - xy, axis=-1)) < 2.5
