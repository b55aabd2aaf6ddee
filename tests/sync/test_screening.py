"""Videos of another action and mirrored videos, on made motion whose truth is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, SyncResult, estimated_rates, screened
from imocap_core.sync.screening.explanation import mirrored_poses, signs_of
from imocap_core.sync.screening.screening import Screening, sentences
from tests.sync.test_synchronise import FOUR_FPS, PARAMS, estimated, four_phases, run

TWINS = (1, 0, 3, 2, 5, 4, 7, 6, 8, 9, 11, 10)
SCREENED = replace(PARAMS, consensus_rounds=0)  # maps are refined after the screening


def run_four(poses: list[np.ndarray], params: SyncParams = SCREENED, **given) -> SyncResult:
    return run(poses, params, fps=[FOUR_FPS] * len(poses), **given)


def judged(poses: list[np.ndarray], params: SyncParams = SCREENED, **given: object) -> Screening:
    """The screening alone, as `synchronise` does it before it matches anything."""
    return screened(SyncEvidence(poses, [FOUR_FPS] * len(poses), **given), params)


def four_videos(seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [estimated(p, rng) for p in four_phases()]


def stranger(rng: np.random.Generator) -> np.ndarray:
    """A clip of a part of the motion that the others never reach."""
    return estimated(np.linspace(40, 47, 60), rng)


def test_reflecting_twice_changes_nothing_and_swaps_sides_once() -> None:
    poses = np.random.default_rng(0).normal(size=(5, 12, 3))
    once = mirrored_poses(poses, TWINS)
    np.testing.assert_array_equal(mirrored_poses(once, TWINS), poses)
    np.testing.assert_array_equal(once[:, 0], poses[:, 1] * [-1, 1, 1])


@cache
def of_genuine_videos() -> SyncResult:
    return run_four(four_videos(12), twins=TWINS)


@pytest.mark.parametrize("where", [0, 3])
def test_a_video_of_another_action_is_excluded_and_the_rest_is_as_without_it(where: int) -> None:
    alone, poses = of_genuine_videos(), four_videos(12)
    with_it = [*poses[:where], stranger(np.random.default_rng(13)), *poses[where:]]
    result = run_four(with_it)
    assert result.screening.excluded == (where,)
    assert np.isnan(result.reference_frame[where]).all()
    assert np.isnan(result.phase[where]).all()
    assert (result.confidence[where] == 0).all()
    rest = [f for v, f in enumerate(result.reference_frame) if v != where]
    for f, g in zip(rest, alone.reference_frame, strict=True):
        np.testing.assert_allclose(f, g, atol=0.25)
    assert result.relaxed.blocks.lengths == tuple(len(x) for x in with_it)
    messages = sentences(result.screening, ["a", "b", "c", "d", "e"])
    assert len(messages) == 1
    assert messages[0].startswith("abcde"[where] + " seems to show another action")


def test_the_switch_reports_or_ignores_and_a_given_reference_stays() -> None:
    rng = np.random.default_rng(12)
    poses = [*(estimated(p, rng) for p in four_phases()), stranger(rng)]
    reported = judged(poses, replace(SCREENED, outliers="report"))
    assert (reported.outliers, reported.excluded) == ((4,), ())
    assert "used nevertheless" in " ".join(sentences(reported, "abcde"))
    ignored = judged(poses, replace(SCREENED, outliers="ignore"))
    assert (ignored.outliers, sentences(ignored, "abcde")) == ((), [])
    assert judged(poses, reference=4).excluded == ()


def test_detections_that_fit_no_body_are_left_out_and_decide_nothing() -> None:
    poses, others = four_videos(12), [0, 1, 3]
    screening = judged(poses, unfit=[2])
    assert screening.excluded == (2,)
    assert "c has detections that fit no body: left out" in sentences(screening, "abcd")[0]
    assert judged(poses, unfit=[2], reference=2).unfit == ()
    evidence = SyncEvidence([x[::4] if v == 0 else x for v, x in enumerate(poses)], [FOUR_FPS] * 4)
    alone = estimated_rates(evidence.among(others), SCREENED)
    rates = estimated_rates(replace(evidence, unfit=[2]), SCREENED)
    np.testing.assert_array_equal(rates, np.insert(alone, 2, 1.0))
    assert alone[0] != 1.0


def test_no_clean_clip_and_no_bad_estimate_is_an_outlier_or_mirrored() -> None:
    rng, phases = np.random.default_rng(15), four_phases()
    bad = [estimated(p, rng, 0.15 if v == 1 else 0.03) for v, p in enumerate(phases)]
    clean = judged(four_videos(100), twins=TWINS)
    for screening in (of_genuine_videos().screening, clean, judged(bad)):
        assert (screening.outliers, screening.mirrored) == ((), ())


def test_a_mirrored_video_is_detected_and_matched_as_well_as_unmirrored() -> None:
    poses = four_videos(13)
    straight = run_four(poses, twins=TWINS, reference=1)
    poses[0] = mirrored_poses(poses[0], TWINS)
    result = run_four(poses, twins=TWINS, reference=1)
    assert (result.screening.flipped, result.screening.outliers) == ((0,), ())
    for f, g in zip(result.reference_frame, straight.reference_frame, strict=True):
        np.testing.assert_allclose(f, g, atol=1e-6)


def test_reported_mirrored_videos_are_neither_flipped_nor_outliers() -> None:
    poses = four_videos(13)
    poses[2] = mirrored_poses(poses[2], TWINS)
    screening = judged(poses, replace(SCREENED, mirrored="report"), twins=TWINS)
    assert (screening.mirrored, screening.flipped, screening.outliers) == ((2,), (), ())
    assert "left as it is" in sentences(screening, "abcd")[0]


def test_what_the_user_declares_overrides_the_evidence() -> None:
    poses = four_videos(13)
    poses[2] = mirrored_poses(poses[2], TWINS)
    assert judged(poses, twins=TWINS, mirrored=[None, None, True, None]).flipped == (2,)
    ignoring = replace(SCREENED, outliers="ignore")
    assert 2 not in judged(poses, ignoring, twins=TWINS, mirrored=[None, None, False, None]).flipped
    with pytest.raises(ValueError, match="twins"):
        run_four(poses, mirrored=[None, None, True, None])


def test_of_two_videos_the_second_is_the_mirrored_one() -> None:
    poses = four_videos(14)[:2]
    poses[0] = mirrored_poses(poses[0], TWINS)
    assert judged(poses, twins=TWINS).flipped == (1,)


def test_signs_are_solved_together_and_the_smaller_side_turns() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        true = rng.choice([-1, 1], 7)
        true = -true if true.sum() < 0 else true
        evidence = np.outer(true, true) * rng.uniform(0.5, 1.0, (7, 7))
        evidence = evidence + evidence.T - np.diag(np.diag(evidence)) * 2
        np.testing.assert_array_equal(signs_of(evidence, [False] * 7), true)


def walk(start: float, rng: np.random.Generator) -> np.ndarray:
    """Three cycles of a movement that is its own mirror image half a cycle later."""
    left = np.random.default_rng(3).normal(size=(6, 3, 3)) * 0.2
    rest = np.random.default_rng(4).normal(size=(6, 3))
    turns = 2 * np.pi * (start + np.linspace(0, 3, 100))
    poses = np.empty((100, 12, 3))
    for side, shift, sign in ((0, 0.0, 1.0), (1, np.pi, -1.0)):
        angle = turns + shift
        curves = np.stack([np.ones_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
        joints = np.einsum("tk,jkc->tjc", curves, left) + rest
        poses[:, side::2] = joints * [sign, 1.0, 1.0]
    return poses + 0.02 * rng.normal(size=poses.shape)


def test_walks_that_begin_with_the_other_foot_are_not_mirrored() -> None:
    rng = np.random.default_rng(16)
    swapped = tuple(j + 1 if j % 2 == 0 else j - 1 for j in range(12))
    poses = [walk(start, rng) for start in (0.0, 0.05, 0.5, 0.0)]
    assert judged(poses, twins=swapped).mirrored == ()
