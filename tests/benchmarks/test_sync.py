"""The parts of the sync benchmark: scores of known maps, tables."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.sync.calibration import calibration, confidences_and_errors
from benchmarks.sync.calibration_scenes import CHANGED, standing_before, with_inserted
from benchmarks.sync.freeze_frames import FROZEN, frozen_scene
from benchmarks.sync.map_scores import event_errors_frames, pair_error_pct, score_maps
from benchmarks.sync.perturbed_scenes import half_wrong, leg_occluded, person_swapped
from benchmarks.sync.reliability import reliability_row
from benchmarks.sync.rivals import rival
from benchmarks.sync.scenes import SyncScene
from benchmarks.sync.slow_motion import SLOWED, slowed_scene
from benchmarks.tcc import POSES
from imocap_core.conventions import EVAL_14


def scene() -> SyncScene:
    """Two videos of 101 phases; the second starts 5 later."""
    phases = [np.arange(101.0), np.arange(5.0, 95.0)]
    poses = [np.zeros((len(p), 14, 3)) for p in phases]
    return SyncScene("made", poses, phases, [30.0, 30.0], 100.0, events=[50, 45])


def test_true_maps_score_zero_and_shifted_ones_their_shift() -> None:
    made = scene()
    reference_map, true = np.arange(101.0), np.arange(90.0) + 5.0
    assert score_maps(made, 0, [reference_map, true]).error_pct == 0.0
    shifted = score_maps(made, 0, [reference_map, true + 2.0], [np.ones(101), np.full(90, 0.5)])
    assert shifted.error_pct == pytest.approx(2.0)
    assert shifted.within_one == 0.0
    assert shifted.confidence == 0.5
    assert pair_error_pct(made, 1, 0, true - 1.0) == pytest.approx(1.0)


def test_an_unmatched_event_is_infinitely_far() -> None:
    made = scene()
    estimate = np.arange(90.0) + 6.0
    assert event_errors_frames(made, 0, [np.arange(101.0), estimate]) == pytest.approx([1.0])
    estimate[45] = np.nan
    assert np.isinf(event_errors_frames(made, 0, [np.arange(101.0), estimate])).all()


def test_the_confidence_is_held_against_the_errors() -> None:
    made = scene()
    reference_map, true = np.arange(101.0), np.arange(90.0) + 5.0
    estimate = true.copy()
    estimate[:45] += 6.0  # 0.2 s off
    trust = np.where(np.arange(90) < 45, 0.3, 0.95)
    estimate[80:] = np.nan
    pairs = confidences_and_errors(made, 0, [reference_map, estimate], [np.ones(101), trust])
    assert len(pairs) == 80
    rows = {r.confidence: r for r in calibration(pairs, 0.1)}
    assert list(rows) == ["0.2 to 0.4", "0.9 to 1.0", "0.0 to 1.0"]
    assert (rows["0.2 to 0.4"].within, rows["0.9 to 1.0"].within) == (0.0, 1.0)
    assert rows["0.2 to 0.4"].median_s == pytest.approx(0.2)
    assert rows["0.0 to 1.0"].frames == 80
    assert rows["0.0 to 1.0"].within == pytest.approx(35 / 80)


def test_rivals_answer_in_the_reference() -> None:
    rng = np.random.default_rng(0)
    phases = [np.linspace(0.0, 1.0, n) for n in (40, 30)]
    way = rng.normal(size=(14, 3))
    rest = rng.normal(size=(14, 3))
    poses = [rest + np.sin(5 * p)[:, None, None] * way for p in phases]
    made = SyncScene("made", poses, [100 * p for p in phases], [30.0, 25.0], 100.0)
    frames, _ = rival("stretch", made, 0)
    np.testing.assert_allclose(frames[1], np.linspace(0.0, 39.0, 30))
    few = replace(POSES, steps=5)
    frames, trust = rival("tcc", made, 0, tcc=few)
    np.testing.assert_array_equal(frames[0], np.arange(40.0))
    assert len(frames[1]) == len(trust[1]) == 30
    assert np.nanmax(frames[1]) <= 39.0
    with pytest.raises(ValueError, match="expected one of tcc, stretch"):
        rival("guess", made, 0)


def three_videos() -> SyncScene:
    """Three videos of 60 frames of one motion."""
    rng = np.random.default_rng(2)
    phases = [np.arange(60.0) for _ in range(3)]
    return SyncScene("made", [rng.normal(size=(60, 14, 3)) for _ in phases], phases, [30.0] * 3, 59)


def test_slow_motion_shows_more_frames_of_the_same_phases() -> None:
    rng = np.random.default_rng(3)
    walk = rng.normal(size=(14, 3)) + np.linspace(0, 1, 40)[:, None, None]
    shown = ([walk, walk], [np.arange(40.0), np.arange(40.0)])
    scene = slowed_scene("made", shown, 4.0)
    slow = scene.phases[SLOWED]
    assert len(slow) == len(scene.poses[SLOWED]) == 157
    np.testing.assert_allclose(slow, np.arange(157) / 4)
    assert scene.fps == [30.0, 30.0]


def test_freeze_frames_repeat_pictures_and_their_phases() -> None:
    made = three_videos()
    identical, frozen = frozen_scene(made, "identical")
    phases, poses = identical.phases[FROZEN], identical.poses[FROZEN]
    assert len(poses) == len(phases) == len(frozen) == 60 + 2 * 29
    np.testing.assert_array_equal(np.unique(phases), np.arange(60.0))
    values, counts = np.unique(phases[frozen], return_counts=True)
    assert counts.tolist() == [30, 30]
    assert values[1] == 59.0
    for value in values:
        assert np.ptp(poses[phases == value], axis=0).max() == 0.0
    recoded = frozen_scene(made, "re-coded")[0].poses[FROZEN]
    assert 0 < np.abs(recoded - poses)[frozen].max() < 0.02
    np.testing.assert_array_equal(recoded[~frozen], poses[~frozen])


def test_calibration_scenes_keep_the_phases_that_videos_share() -> None:
    made, rng = three_videos(), np.random.default_rng(4)
    changed = with_inserted(made, np.ones((80, 14, 3)), rng).phases[CHANGED]
    np.testing.assert_array_equal(changed[np.isfinite(changed)], np.arange(60.0))
    assert 8 <= np.isnan(changed).sum() < 30
    for phase in standing_before(made, rng).phases:
        assert (np.diff(phase) > 0).all()
        np.testing.assert_array_equal(phase[-60:], np.arange(60.0))


def test_failing_detections_change_one_video_and_no_phase() -> None:
    made, rng = three_videos(), np.random.default_rng(5)
    strangers = rng.normal(size=(80, 14, 3))
    for changed, least in (
        (half_wrong(made, strangers, rng), 0.5),
        (leg_occluded(made, rng), 0.4),
        (person_swapped(made, strangers, rng), 0.2),
    ):
        for v, (before, after) in enumerate(zip(made.poses, changed.poses, strict=True)):
            differs = (before != after).any(axis=(1, 2))
            assert least <= differs.mean() < 0.9 if v == CHANGED else not differs.any()
        assert changed.phases is made.phases


def test_an_occluded_leg_leaves_the_other_joints() -> None:
    made = three_videos()
    changed = leg_occluded(made, np.random.default_rng(6))
    joints = (made.poses[CHANGED] != changed.poses[CHANGED]).any(axis=(0, 2))
    names = {EVAL_14[j] for j in np.flatnonzero(joints)}
    assert names in ({"left_knee", "left_ankle"}, {"right_knee", "right_ankle"})


def test_a_row_of_the_reliability_counts_what_is_sure() -> None:
    judged = np.array([[0.95, 1], [0.95, 1], [0.95, 0], [0.2, 0]])
    row = reliability_row("made", judged)
    assert (row.frames, row.right, row.sure) == (4, 0.5, 0.75)
    assert row.right_of_sure == pytest.approx(2 / 3)
