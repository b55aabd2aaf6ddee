"""Of long videos every n-th frame is compared at first: the maps are those of all frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.sync import SyncEvidence, SyncResult, affinity, synchronise
from imocap_core.sync.maps import BandedMap, refined_bands
from tests.sync.test_synchronise import FPS, PARAMS, error_s, estimated


def synchronised(phases: list[np.ndarray]) -> SyncResult:
    rng = np.random.default_rng(3)
    poses = [estimated(phase, rng) for phase in phases]
    params = replace(PARAMS, outliers="ignore", mirrored="ignore", consensus_rounds=1)
    return synchronise(SyncEvidence(poses, [FPS] * 2, reference=0), params, rng)


def test_maps_by_way_of_every_third_frame_are_those_of_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    phases = [np.linspace(1.0, 11.0, 300), np.linspace(0.0, 1.0, 280) ** 1.2 * 9.0 + 1.5]
    every = synchronised(phases)
    monkeypatch.setattr(affinity, "ALL_COMPARED", 300 * 280 // 9)
    coarse = synchronised(phases)
    assert coarse.affinity.pairs[0, 1].shape == (300, 280)
    assert np.median(error_s(phases, every.reference_frame, 0)) < 0.05
    np.testing.assert_allclose(
        coarse.reference_frame[1], every.reference_frame[1], rtol=0, atol=1e-3
    )
    np.testing.assert_allclose(coarse.confidence[1], every.confidence[1], rtol=0, atol=0.05)


def test_bands_of_all_frames_contain_those_of_every_nth() -> None:
    coarse = BandedMap.of(np.eye(50, 80))
    for rows, columns in refined_bands(coarse, (200, 320), 4, 5):
        assert columns.start <= max(0, rows.start - 5)
        assert min(320, rows.stop + 5) <= columns.stop < rows.stop + 64 * 4
    nowhere = BandedMap.of(np.zeros((50, 80)))
    assert all(c == slice(0, 320) for _, c in refined_bands(nowhere, (200, 320), 4, 5))
