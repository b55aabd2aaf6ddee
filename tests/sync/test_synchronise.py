"""From poses to warps on made motion whose warps are known."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, SyncResult, axes, reference, synchronise

PARAMS = SyncParams(
    method="softmap", rounds=2, warp="posterior", consensus_rounds=5,
    evidence_per_s=15.0, unmatched_level=1.0, positions_per_frame=4, max_rate=np.inf,
    confidence_reach_s=0.1, least_difference_m=0.04, outliers="exclude",
    mirrored="flip",
)  # fmt: skip
FPS = 30.0
FOUR_FPS = 15.0  # of `four_phases`: shorter runs than with 30


def pose_at(phase: np.ndarray) -> np.ndarray:
    """A smooth motion of 12 joints (T, 12, 3), metres, that never returns to a pose; phase in
    seconds."""
    rng = np.random.default_rng(11)
    rest = 0.4 * rng.normal(size=(12, 3))
    swing, rate = 0.25 * rng.normal(size=(5, 12, 3)), rng.uniform(0.5, 2.5, 5)
    moved = sum(
        s * np.sin(r * phase + k)[:, None, None]
        for k, (s, r) in enumerate(zip(swing, rate, strict=True))
    )
    return np.asarray(rest + moved)


def estimated(phase: np.ndarray, rng: np.random.Generator, noise_m: float = 0.03) -> np.ndarray:
    """The motion as one monocular estimate: its own axes, scale and noise."""
    pose = pose_at(phase) + noise_m * rng.normal(size=(len(phase), 12, 3))
    turned = pose @ Rotation.random(random_state=int(rng.integers(1000))).as_matrix()
    return np.asarray(rng.uniform(0.8, 1.25) * turned + rng.normal(size=3))


def four_phases() -> list[np.ndarray]:
    """Clips of 8 s of motion with differing starts, ends and speeds."""
    u = np.linspace(0, 1, 60)
    return [
        np.linspace(1.0, 6.0, 75),
        1.0 + 5.0 * u**1.4,
        0.2 + 5.0 * (u + 0.1 * np.sin(2 * np.pi * u)),
        2.0 + 5.5 * u,
    ]


def error_s(
    phases: Sequence[np.ndarray], frames: Sequence[np.ndarray], reference: int
) -> np.ndarray:
    """Per matched frame of the other videos: |estimated - true phase|, seconds of motion."""
    index = np.arange(len(phases[reference]))
    return np.concatenate(
        [
            np.abs(np.interp(f, index, phases[reference]) - p)[np.isfinite(f)]
            for v, (p, f) in enumerate(zip(phases, frames, strict=True))
            if v != reference
        ]
    )


def run(poses: Sequence[np.ndarray], params: SyncParams = PARAMS, **given):
    given = {"fps": [FPS] * len(poses)} | given
    rng, screening = given.pop("rng", np.random.default_rng(0)), given.pop("screening", None)
    return synchronise(SyncEvidence(poses, **given), params, rng, screening)


def run_four(poses: Sequence[np.ndarray], params: SyncParams = PARAMS, **given):
    """`run` of videos with as many frames a second as `four_phases`."""
    return run(poses, params, fps=[FOUR_FPS] * len(poses), **given)


@cache
def of_four(**changes: str | int) -> SyncResult:
    """The synchronisation of `four_phases` with the first as reference."""
    poses, rng = four_phases(), np.random.default_rng(5)
    poses = [estimated(p, rng) for p in poses]
    return run_four(poses, replace(PARAMS, **changes), reference=0)


LONG = pytest.mark.long


@pytest.mark.parametrize(
    ("changes", "limit_s"), [pytest.param({"consensus_rounds": 0}, 0.1, marks=LONG), ({}, 0.03)]
)
def test_recovers_given_warps(changes: dict[str, str | int], limit_s: float) -> None:
    phases, result = four_phases(), of_four(**changes)
    assert error_s(phases, result.reference_frame, 0).mean() < limit_s, result.status
    for f in result.reference_frame:
        assert (np.diff(f[np.isfinite(f)]) >= 0).all()
    np.testing.assert_array_equal(result.reference_frame[0], np.arange(len(phases[0])))


@LONG
def test_sharper_last_refinements_claim_no_more_confidence(monkeypatch: pytest.MonkeyPatch) -> None:
    sharp = of_four()
    monkeypatch.setattr(axes, "SHARPNESS", 1.0)
    usual = of_four.__wrapped__()
    moved = [np.nanmax(np.abs(a - b)) for a, b in zip(
        sharp.reference_frame[1:], usual.reference_frame[1:], strict=True)]  # fmt: skip
    assert max(moved) > 0.1  # frames: the last refinements do something
    claimed, before = (np.concatenate(r.confidence).mean() for r in (sharp, usual))
    assert claimed < before + 0.01


def test_what_the_reference_does_not_show_is_unmatched() -> None:
    phases, result = four_phases(), of_four()
    for phase, f, trust in zip(phases, result.reference_frame, result.confidence, strict=True):
        outside = (phase < phases[0][0] - 0.2) | (phase > phases[0][-1] + 0.2)
        inside = (phase > phases[0][0] + 0.2) & (phase < phases[0][-1] - 0.2)
        assert np.isnan(f[outside]).mean() > 0.8 if outside.any() else True
        assert np.isfinite(f[inside]).mean() > 0.98
        np.testing.assert_array_equal(trust[np.isnan(f)], 0.0)


@LONG
def test_without_unmatched_frames_every_frame_has_a_position() -> None:
    rng = np.random.default_rng(6)
    poses = [estimated(p, rng) for p in four_phases()]
    result = run_four(poses[:2], replace(PARAMS, unmatched_level=np.inf, consensus_rounds=1))
    assert np.isfinite(np.concatenate(result.reference_frame)).all()


@LONG
def test_a_hold_is_crossed_evenly() -> None:
    rng = np.random.default_rng(7)
    hold = np.concatenate([np.linspace(0, 2, 60), np.full(60, 2.0), np.linspace(2, 4, 60)])
    result = run([estimated(hold, rng, 0.02), estimated(hold, rng, 0.02)], reference=0)
    f = result.reference_frame[1]
    assert np.abs(f - np.arange(180.0))[60:120].max() < 8
    assert np.diff(f)[65:115].max() < 3
    assert result.confidence[1][70:110].mean() < result.confidence[1][10:50].mean()


def test_a_video_whose_person_is_often_lost_is_no_reference(monkeypatch) -> None:
    stage, eligible = sys.modules["imocap_core.sync.synchronise"], []
    jointly = stage.synchronise_jointly
    monkeypatch.setattr(
        stage, "synchronise_jointly", lambda *given: (eligible.append(given[3]), jointly(*given))[1]
    )
    poses = [estimated(p, np.random.default_rng(5)) for p in four_phases()]
    confidence = [np.ones(x.shape[:2]) for x in poses]
    for v, lost in ((1, 8), (2, 20)):  # one frame of so many
        confidence[v][::lost] = 0.0
    assert run_four(poses, confidence=confidence).reference != 1
    assert eligible == [[True, False, True, True]]


@LONG
def test_frame_rates_may_differ() -> None:
    rng = np.random.default_rng(8)
    phases = [np.arange(0, 5, 1 / 50), np.arange(0.5, 4.5, 1 / 24)]
    result = run([estimated(p, rng) for p in phases], fps=[50.0, 24.0], reference=0)
    assert error_s(phases, result.reference_frame, 0).mean() < 0.03


@LONG
def test_missing_joints_and_frames_are_bridged() -> None:
    rng = np.random.default_rng(9)
    phases = four_phases()
    poses = [estimated(p, rng) for p in phases]
    poses[1][27:30] = np.nan
    poses[2][:, 3] = np.nan
    poses[3][rng.random(poses[3].shape[:2]) < 0.2] = np.nan
    result = run_four(poses, reference=0)
    assert error_s(phases, result.reference_frame, 0).mean() < 0.04


@pytest.mark.parametrize("count", [1, 2, pytest.param(6, marks=LONG)])
def test_any_number_of_videos(count: int) -> None:
    rng = np.random.default_rng(10)
    phases = [np.linspace(0.1 * v, 4.0 + 0.1 * v, 40 + 4 * v) for v in range(count)]
    result = run([estimated(p, rng) for p in phases])
    assert len(result.centrality) == count
    assert result.centrality[result.reference] >= 0.8 * result.centrality.max()
    assert result.status
    if count > 1:
        assert error_s(phases, result.reference_frame, result.reference).mean() < 0.04


def test_of_many_videos_each_is_compared_with_a_few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "_MOST_HUBS", 2)
    rng = np.random.default_rng(10)
    phases = [np.linspace(0.1 * v, 4.0 + 0.1 * v, 40) for v in range(6)]
    result = run([estimated(p, rng) for p in phases])
    compared = {v for v in range(6) if sum(v in pair for pair in result.relaxed.pairs) == 10}
    assert len(compared) == 2
    assert result.reference in compared
    assert len(result.relaxed.pairs) == 18  # of 30
    assert all(np.isfinite(f).mean() > 0.7 for f in result.reference_frame)
    assert error_s(phases, result.reference_frame, result.reference).mean() < 0.04


@LONG
def test_a_stranger_is_never_the_reference() -> None:
    rng = np.random.default_rng(12)
    poses = [estimated(p, rng) for p in four_phases()]
    poses[2] = estimated(np.linspace(40, 47, 80), rng)
    result = run_four(poses, replace(PARAMS, consensus_rounds=0))  # the reference is chosen before
    assert result.reference != 2
    assert result.centrality.argmin() == 2


def test_all_faults_are_named_at_once() -> None:
    with pytest.raises(ValueError, match=r"fps: expected one per video.*video 1"):
        run([np.zeros((5, 12, 3)), np.zeros((5, 11, 3))], fps=[30.0])
    with pytest.raises(ValueError, match="reference: expected 0 to 0"):
        run([np.zeros((5, 12, 3))], reference=3)
