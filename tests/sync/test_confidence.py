"""Calibrated confidence: what lowers it, and that it stays a probability."""

from dataclasses import replace

import numpy as np

from imocap_core.params import SyncParams
from imocap_core.sync.affinity import DistanceMatrix, distance_matrix
from imocap_core.sync.confidence import (
    DISTINCT,
    WEIGHTS,
    Repetition,
    Route,
    calibrated_confidence,
    confidence_features,
    next_repetition,
    repeats,
)
from imocap_core.sync.time_axis import PairMaps
from tests.sync.test_synchronise import FPS, PARAMS, estimated, pose_at, run

T = 90


def matched() -> tuple[Route, DistanceMatrix, PairMaps]:
    """Three identical clips, matched frame by frame, with the mass 0.9."""
    rng = np.random.default_rng(0)
    poses = [pose_at(np.arange(T) / FPS) + 0.02 * rng.normal(size=(T, 12, 3)) for _ in range(3)]
    distances = distance_matrix(poses, None, [FPS] * 3, SyncParams())
    same = np.arange(float(T))
    pairs = {(i, j): same for i in range(3) for j in range(3) if i != j}
    route = Route(1, 0, same, np.full(T, 0.9), FPS, FPS, 3.0)
    return route, distances, PairMaps(pairs, {key: np.ones(T) for key in pairs})


def test_more_mass_is_more_confidence_and_all_are_probabilities() -> None:
    route, distances, pairs = matched()
    confidences = [
        calibrated_confidence(replace(route, mass=np.full(T, mass)), distances, pairs)
        for mass in (0.0, 0.3, 0.6, 0.9, 1.0)
    ]
    assert (np.diff(confidences, axis=0) > 0).all()
    assert np.min(confidences) > 0
    assert np.max(confidences) < 1


def test_time_that_collapses_while_the_performer_moves_lowers_it() -> None:
    route, distances, pairs = matched()
    collapsed = route.positions.copy()
    collapsed[40:64] = 40.0
    plain = calibrated_confidence(route, distances, pairs)
    lowered = calibrated_confidence(replace(route, positions=collapsed), distances, pairs)
    assert (lowered[47:57] < 0.3 * plain[47:57]).all()
    np.testing.assert_allclose(lowered[:25], plain[:25], atol=0.1)


def test_routes_that_disagree_lower_it() -> None:
    route, distances, pairs = matched()
    off = {key: p + (9.0 if key == (1, 2) else 0.0) for key, p in pairs.positions.items()}
    off[1, 0] = pairs.positions[1, 0] + 9.0
    lowered = calibrated_confidence(route, distances, PairMaps(off, pairs.confidence))
    assert (lowered < calibrated_confidence(route, distances, pairs)).all()


def test_a_map_that_fits_a_repetition_later_as_well_lowers_it() -> None:
    route, distances, pairs = matched()
    plain, nearly, as_well = (
        calibrated_confidence(replace(route, repetition=repetition), distances, pairs)
        for repetition in (None, Repetition(30.0, 1.4), Repetition(30.0, 1.0))
    )
    assert (as_well < nearly).all()
    assert (nearly < plain).all()


def test_unmatched_frames_have_none() -> None:
    route, distances, pairs = matched()
    positions = route.positions.copy()
    positions[:10] = np.nan
    confidence = calibrated_confidence(replace(route, positions=positions), distances, pairs)
    assert (confidence[:10] == 0).all()
    assert (confidence[10:] > 0).all()
    nothing = replace(route, positions=np.full(T, np.nan))
    assert (calibrated_confidence(nothing, distances, pairs) == 0).all()


def test_every_feature_has_a_weight() -> None:
    features = confidence_features(*matched())
    assert features.shape == (T, len(WEIGHTS))
    assert np.isfinite(features).all()


def test_frames_without_poses_have_finite_features() -> None:
    route, distances, pairs = matched()
    distances.block(1, 0)[20:30] = np.nan
    distances.block(1, 0)[:, 50:55] = np.nan
    assert np.isfinite(confidence_features(route, distances, pairs)).all()


def test_inserted_frames_of_another_pose_cost_nothing_but_are_not_trusted() -> None:
    rng, frames = np.random.default_rng(3), 12
    phase = np.linspace(0.5, 4.5, 120)
    plain, other = (
        pose_at(p) + 0.03 * rng.normal(size=(len(p), 12, 3))
        for p in (phase, np.linspace(40, 42, frames))
    )
    mixed = np.concatenate([plain[:60], other, plain[60:]])
    params = replace(PARAMS, max_rate=32.0, consensus_rounds=1)
    result = run([estimated(phase, rng), mixed, estimated(phase, rng)], params, reference=0)
    rest = np.r_[:60, 60 + frames : 120 + frames]
    assert np.abs(result.reference_frame[1][rest] - np.arange(120.0)).max() < 4.0
    confidence = result.confidence[1]
    assert np.median(confidence[60 : 60 + frames]) < 0.75 * np.median(confidence[rest])


REPEATED_FRAMES = np.arange(120.0)


def squares(theirs: np.ndarray, mine: np.ndarray, noise: float = 0.05) -> np.ndarray:
    return np.asarray(((mine[:, None] - theirs[None]) ** 2).sum(-1) + noise)


def cycle(period: float) -> np.ndarray:
    angle = 2 * np.pi * REPEATED_FRAMES / period
    return np.column_stack([np.cos(angle), np.sin(angle)])


def evidence(points: np.ndarray, positions: np.ndarray = REPEATED_FRAMES) -> float:
    matched = np.isfinite(positions)
    best = next_repetition(squares(points, points), np.nan_to_num(positions), matched, FPS)
    return 0.0 if best is None else best.evidence


def test_a_cycle_fits_a_period_later_as_well() -> None:
    np.testing.assert_allclose(evidence(cycle(30.0)), np.log(DISTINCT), atol=1e-6)


def test_the_shift_is_a_period() -> None:
    points = np.column_stack([cycle(40.0), 0.004 * REPEATED_FRAMES])
    best = next_repetition(squares(points, points), REPEATED_FRAMES, np.ones(120, dtype=bool), FPS)
    assert abs(best.shift_frames) == 40.0


def test_a_path_and_a_stand_repeat_nothing() -> None:
    path = np.column_stack([0.1 * REPEATED_FRAMES, np.zeros(120)])
    assert evidence(path) == 0.0
    assert evidence(np.zeros((120, 2))) == 0.0
    assert evidence(np.concatenate([np.zeros((60, 2)), path[:60]])) == 0.0


def test_a_cycle_that_drifts_fits_less_well_later() -> None:
    drifting = np.column_stack([cycle(30.0), 0.004 * REPEATED_FRAMES])
    assert 0 < evidence(drifting) < np.log(DISTINCT)


def test_a_repetition_that_the_clip_does_not_show_twice_is_none() -> None:
    assert evidence(cycle(80.0)) == 0.0


def test_nothing_matched_and_nothing_known() -> None:
    assert evidence(cycle(30.0), np.full(120, np.nan)) == 0.0
    unknown = np.full((120, 120), np.nan)
    assert next_repetition(unknown, REPEATED_FRAMES, np.ones(120, dtype=bool), FPS) is None


def test_only_what_a_video_shows_twice_repeats() -> None:
    points = cycle(40.0)
    assert repeats(squares(points, points, 0.05), 41.0, 3.0)
    assert not repeats(squares(points, points, 0.05), 25.0, 3.0)
    once = np.concatenate([np.zeros((40, 2)), points[:40] - points[0], np.zeros((40, 2))])
    for period in range(10, 61, 5):  # a movement with a rest before and after it
        assert not repeats(squares(once, once), period, 3.0)
    assert not repeats(squares(points[:70], points[:70]), 40.0, 3.0)  # less than two cycles
    assert not repeats(np.full((50, 50), np.nan), 10.0, 2.0)
