"""Frames that other videos show and the reference does not: two of them settle what one cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.multiview.smpl_ba import Axis, continued, recover_motion
from imocap_core.motion.multiview.timeline import BeyondReference, make_timeline
from imocap_core.motion.state import MotionState
from tests.motion.made import WEIGHTS, Made, mpjpe_mm, scene, wide_prior
from tests.motion.test_smpl_ba import OPTIONS, TURNS_DEG, disturbed, in_own_axes

FRAMES = 20
SHOWN = slice(6, 15)  # of all frames by the reference
BEFORE, AFTER = SHOWN.start, FRAMES - SHOWN.stop


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(FRAMES, TURNS_DEG, np.random.default_rng(5))


def shorter(made: Made, confidence: float, others: tuple[int, ...] = (1, 2)) -> Scene:
    """A scene whose reference shows only a part; these others say so surely that they show the same
    moments beyond it."""
    position = np.arange(FRAMES) - float(BEFORE)
    count = SHOWN.stop - SHOWN.start
    inside = (position >= 0) & (position < count)
    maps = [np.arange(float(count)), *(np.where(inside, position, np.nan) for _ in range(2))]
    trust = [np.isfinite(m).astype(float) for m in maps]
    observations = list(made.observations)
    observations[0] = replace(
        observations[0],
        xy_px=observations[0].xy_px[SHOWN],
        confidence=observations[0].confidence[SHOWN],
    )
    none = BeyondReference(np.full(count, np.nan), np.zeros(count))
    beyond = [none] + [
        BeyondReference(np.where(inside, np.nan, position), (v in others) * confidence * ~inside)
        for v in (1, 2)
    ]
    timeline = make_timeline(maps, trust, count)
    return Scene(made.body, wide_prior(), observations, timeline, trust, 0, WEIGHTS, beyond)


def of_shorter(state: MotionState) -> MotionState:
    """A motion of all videos whose reference shows only a part."""
    R_local, trans, valid = state.R_local.clone(), state.trans.clone(), state.valid.clone()
    count = SHOWN.stop - SHOWN.start
    R_local[0, :count], trans[0, :count] = state.R_local[0, SHOWN], state.trans[0, SHOWN]
    valid[0, count:] = False
    return MotionState.of(R_local, trans, state.betas, valid)


def test_the_axis_is_continued_as_far_as_two_videos_reach(made: Made) -> None:
    longer, axis = continued(shorter(made, 0.8))
    assert axis == Axis(BEFORE, SHOWN.stop - SHOWN.start, AFTER)
    assert longer.timeline.from_reference.shape == (3, FRAMES)
    np.testing.assert_array_equal(
        longer.timeline.to_reference[0], np.arange(SHOWN.start, SHOWN.stop)
    )
    np.testing.assert_array_equal(longer.timeline.to_reference[1], np.arange(FRAMES))
    outside = [*range(SHOWN.start), *range(SHOWN.stop, FRAMES)]
    assert np.allclose(longer.confidences[1][outside], 0.8)
    assert np.allclose(longer.confidences[1][SHOWN], 1.0)
    assert np.allclose(longer.timeline.confidence[0][outside], 0.0)


@pytest.mark.parametrize(("confidence", "others"), [(0.0, (1, 2)), (0.8, (1,)), (0.8, ())])
def test_what_one_video_alone_shows_is_not_on_it(
    made: Made, confidence: float, others: tuple[int, ...]
) -> None:
    given = shorter(made, confidence, others)
    same, axis = continued(given)
    assert same is given
    assert axis.before == axis.after == 0


def test_a_video_that_is_nowhere_matched_has_no_place_beyond(made: Made) -> None:
    given = shorter(made, 0.8)
    given.timeline.to_reference[2][:] = np.nan
    assert continued(given)[1] == Axis(0, SHOWN.stop - SHOWN.start, 0)


def test_one_video_that_faces_the_wrong_way_there_is_turned_by_the_other(made: Made) -> None:
    """Before the reference begins the second video's motion has the back for the front."""
    truth = in_own_axes(made)
    start = disturbed(truth, 0.05)
    half_turn = torch.diag(torch.tensor([-1.0, 1.0, -1.0], dtype=torch.float64))
    start.R_local[1, : BEFORE - 1, 0] = half_turn @ start.R_local[1, : BEFORE - 1, 0]
    start, truth = of_shorter(start), of_shorter(truth)
    alone = recover_motion(shorter(made, 0.0), start, OPTIONS)
    together = recover_motion(shorter(made, 0.8), start, OPTIONS)
    assert together.common is not None
    assert together.spread is not None
    count = SHOWN.stop - SHOWN.start
    assert together.common.R_local.shape[1] == together.spread.keypoints_m.shape[1] == count
    errors = []
    for found in (alone, together):
        early = [
            MotionState.of(s.R_local[1:2, :BEFORE], s.trans[1:2, :BEFORE], s.betas[1:2],
                           s.valid[1:2, :BEFORE])
            for s in (found.state, truth)
        ]  # fmt: skip
        errors.append(mpjpe_mm(made.body, *early))
    assert errors[0] > 100
    assert errors[1] < 30
