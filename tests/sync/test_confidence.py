"""Calibrated confidence: what lowers it, and that it stays a probability."""

from dataclasses import replace

import numpy as np

from imocap_core.params import SyncParams
from imocap_core.sync.affinity import DistanceMatrix, distance_matrix
from imocap_core.sync.confidence import (
    WEIGHTS,
    Repetition,
    Route,
    calibrated_confidence,
    confidence_features,
)
from imocap_core.sync.time_axis import PairMaps
from tests.sync.test_synchronise import FPS, PARAMS, estimated, pose_at, run

T = 90


def matched() -> tuple[Route, DistanceMatrix, PairMaps]:
    """Three identical clips, matched frame by frame, with the mass 0.9."""
    rng = np.random.default_rng(0)
    poses = [pose_at(np.arange(T) / FPS) + 0.02 * rng.normal(size=(T, 12, 3)) for _ in range(3)]
    distances = distance_matrix(poses, None, None, [FPS] * 3, SyncParams())
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
    params = replace(PARAMS, max_rate=32.0)
    result = run([estimated(phase, rng), mixed, estimated(phase, rng)], params, reference=0)
    rest = np.r_[:60, 60 + frames : 120 + frames]
    assert np.abs(result.reference_frame[1][rest] - np.arange(120.0)).max() < 4.0
    confidence = result.confidence[1]
    assert np.median(confidence[60 : 60 + frames]) < 0.75 * np.median(confidence[rest])
