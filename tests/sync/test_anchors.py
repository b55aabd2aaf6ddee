"""What the user knows, on made motion: anchors that agree, anchors that don't, forbidden spans."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from imocap_core.sync import Anchor, Hints, SyncResult
from imocap_core.sync.anchors import AnchorPoint, anchored_squares, led_through
from imocap_core.sync.reference import anchor_penalty
from imocap_core.sync.warp.template import NearbySquares
from tests.sync.test_synchronise import FOUR_FPS, estimated, four_phases, run
from tests.sync.test_synchronise import PARAMS as USUAL
from tests.sync.test_time_axis import positions_in

PARAMS = replace(USUAL, consensus_rounds=1, outliers="ignore", mirrored="ignore")


@cache
def poses() -> list[np.ndarray]:
    rng = np.random.default_rng(5)
    return [estimated(p, rng) for p in four_phases()[:3]]


NO_HINTS = Hints()


def run_three(hints: Hints = NO_HINTS) -> SyncResult:
    return run(poses(), PARAMS, fps=[FOUR_FPS] * 3, reference=0, hints=hints)


@cache
def without_hints() -> SyncResult:
    return run_three()


def test_a_hard_anchor_is_met_exactly_against_the_evidence() -> None:
    free = without_hints()
    target = int(free.reference_frame[1][40]) + 6
    tied = run_three(Hints((Anchor(1, 40, 0, target, hard=True),)))
    f = tied.reference_frame[1]
    assert abs(f[40] - target) <= 0.5
    assert tied.confidence[1][40] == 1.0
    assert (np.diff(f[np.isfinite(f)]) >= 0).all()
    assert abs(free.reference_frame[1][40] - target) > 3.3
    assert np.nanmax(np.abs(f - free.reference_frame[1])[:20]) < 1.05
    assert abs(tied.phase[1][40] * FOUR_FPS - target) <= 0.5


def test_a_soft_anchor_pulls_and_does_not_force() -> None:
    free = without_hints().reference_frame[1]
    near, far = (run_three(Hints((Anchor(0, int(free[40]) + off, 1, 40),))) for off in (2, 30))
    wanted = int(free[40]) + 2
    assert abs(near.reference_frame[1][40] - wanted) < abs(free[40] - wanted)
    assert abs(far.reference_frame[1][40] - free[40]) < 15  # evidence of all frames outweighs it


@pytest.mark.parametrize("hard", [False, True])
def test_an_anchor_between_two_others_ties_them(hard: bool) -> None:
    free = without_hints()
    before = positions_in(free.phase[1][34:35], free.phase[2])[0]
    target = before + 3.0
    tied = run_three(Hints((Anchor(1, 34, 2, target, hard),)))
    after = positions_in(tied.phase[1][34:35], tied.phase[2])[0]
    assert abs(after - target) < (0.5 if hard else abs(before - target))


def test_frames_in_forbidden_spans_match_nothing_and_nothing_matches_them() -> None:
    hints = Hints(forbidden=((1, 14, 24), (0, 47, 54)))
    result = run_three(hints)
    assert np.isnan(result.reference_frame[1][14:24]).all()
    assert np.isfinite(result.reference_frame[1][27:34]).all()
    assert np.isnan(result.phase[1][14:24]).all()
    assert (result.confidence[0][47:54] == 0).all()
    for v in (1, 2):
        f = result.reference_frame[v]
        assert not ((f >= 47) & (f <= 53)).any()


def test_all_impossible_hints_are_named_at_once() -> None:
    hints = Hints(
        (Anchor(0, 10, 1, 500.0), Anchor(2, 5, 2, 6.0), Anchor(0, 10, 2, 20), Anchor(2, 5, 0, 60)),
        ((1, 70, 200),),
    )
    with pytest.raises(ValueError, match="anchor") as error:
        run_three(hints)
    message = str(error.value)
    assert "anchor 1: expected a frame 0 to 59 of video 1, got 500" in message
    assert "anchor 2: ties video 2 to itself" in message
    assert "anchors 3 and 4 cross in time" in message
    assert "forbidden: video 1 has no frames 70 to 199" in message


def test_the_penalty_leaves_other_rows_alone_and_makes_the_anchor_cheapest() -> None:
    squares = np.random.default_rng(0).uniform(1, 2, (6, 40))
    out = anchored_squares(
        squares, [AnchorPoint(3, 20.0, False)], matched_square=0.5, nat=0.1, fps_to=25.0
    )
    np.testing.assert_array_equal(np.delete(out, 3, axis=0), np.delete(squares, 3, axis=0))
    assert out[3].argmin() == 20
    same = anchored_squares(squares, [], matched_square=1.0, nat=1.0, fps_to=25.0)
    assert same is squares


def test_a_map_led_through_ties_stays_in_order_and_keeps_gaps() -> None:
    positions = np.array([0.0, 1.0, np.nan, 3.0, 4.0, 5.0])
    out, trust = led_through(positions, np.full(6, 0.5), [(1, 2.5), (4, 4.5)])
    np.testing.assert_allclose(out, [0.0, 2.5, np.nan, 3.0, 4.5, 5.0])
    assert trust.tolist() == [0.5, 1.0, 0.5, 0.5, 1.0, 0.5]


def test_an_anchor_weighs_the_same_at_any_rate_of_observations() -> None:
    """Its nats against the evidence's: squares times observations, as warps weigh them."""
    penalty = anchor_penalty([[], [AnchorPoint(3, 20.0, False)]], [30.0, 30.0], 0, 1)
    squares = NearbySquares.of(np.ones((6, 40)))
    nats = [
        (penalty(1, squares, 1.0, rate).nearby.dense() - 1.0) * rate / 30.0 for rate in (15.0, 60.0)
    ]
    assert nats[0].max() > 1.0
    np.testing.assert_allclose(nats[0], nats[1])
