"""What the user knows, on made motion: anchors that agree, anchors that don't, forbidden spans."""

import numpy as np
import pytest

from imocap_core.sync import Anchor, Hints
from imocap_core.sync.anchors import bent, led_through
from imocap_core.sync.phase import positions_in
from imocap_core.sync.reference_anchors import bend_of
from tests.sync.test_synchronise import four_phases, run, seen


def poses() -> list[np.ndarray]:
    rng = np.random.default_rng(5)
    return [seen(p, rng) for p in four_phases()]


def test_a_hard_anchor_is_met_exactly_against_the_evidence() -> None:
    free = run(poses(), reference=0)
    at = int(free.reference_frame[1][60]) + 9
    tied = run(poses(), reference=0, hints=Hints((Anchor(1, 60, 0, at, hard=True),)))
    f = tied.reference_frame[1]
    assert abs(f[60] - at) <= 0.5
    assert tied.confidence[1][60] == 1.0
    assert (np.diff(f[np.isfinite(f)]) >= 0).all()
    assert abs(free.reference_frame[1][60] - at) > 5
    assert np.nanmax(np.abs(f - free.reference_frame[1])[:30]) < 2.0
    assert abs(tied.phase[1][60] * 30.0 - at) <= 0.5


def test_a_soft_anchor_pulls_and_does_not_force() -> None:
    free = run(poses(), reference=0).reference_frame[1]
    near, far = (
        run(poses(), reference=0, hints=Hints((Anchor(0, int(free[60]) + off, 1, 60),)))
        for off in (2, 60)
    )
    wanted = int(free[60]) + 2
    assert abs(near.reference_frame[1][60] - wanted) < abs(free[60] - wanted)
    assert abs(far.reference_frame[1][60] - free[60]) < 30  # evidence of all frames outweighs it


@pytest.mark.parametrize("hard", [False, True])
def test_an_anchor_between_two_others_ties_them(hard: bool) -> None:
    free = run(poses(), reference=0)
    before = positions_in(free.phase[1][50:51], free.phase[2])[0]
    target = before + 5.0
    tied = run(poses(), reference=0, hints=Hints((Anchor(1, 50, 2, target, hard),)))
    after = positions_in(tied.phase[1][50:51], tied.phase[2])[0]
    assert abs(after - target) < (0.5 if hard else abs(before - target))


def test_frames_in_forbidden_spans_match_nothing_and_nothing_matches_them() -> None:
    hints = Hints(forbidden=((1, 20, 35), (0, 70, 80)))
    result = run(poses(), reference=0, hints=hints)
    assert np.isnan(result.reference_frame[1][20:35]).all()
    assert np.isfinite(result.reference_frame[1][40:50]).all()
    assert np.isnan(result.phase[1][20:35]).all()
    assert (result.confidence[0][70:80] == 0).all()
    for v in (1, 2, 3):
        f = result.reference_frame[v]
        assert not ((f >= 70) & (f <= 79)).any()


def test_all_impossible_hints_are_named_at_once() -> None:
    hints = Hints(
        (Anchor(0, 10, 1, 500.0), Anchor(2, 5, 2, 6.0), Anchor(0, 10, 3, 20), Anchor(3, 5, 0, 60)),
        ((1, 100, 200),),
    )
    with pytest.raises(ValueError, match="anchor") as error:
        run(poses(), hints=hints)
    said = str(error.value)
    assert "anchor 1: expected a frame 0 to 119 of video 1, got 500" in said
    assert "anchor 2: ties video 2 to itself" in said
    assert "anchors 3 and 4 cross in time" in said
    assert "forbidden: video 1 has no frames 100 to 199" in said


def test_bending_leaves_other_rows_alone_and_makes_the_anchor_cheapest() -> None:
    squares = np.random.default_rng(0).uniform(1, 2, (6, 40))
    out = bent(squares, [(3, 20.0, False)], near=0.5, unit=0.1, fps_to=25.0)
    np.testing.assert_array_equal(np.delete(out, 3, axis=0), np.delete(squares, 3, axis=0))
    assert out[3].argmin() == 20
    assert bent(squares, [], near=1.0, unit=1.0, fps_to=25.0) is squares


def test_a_map_led_through_ties_stays_in_order_and_keeps_gaps() -> None:
    at = np.array([0.0, 1.0, np.nan, 3.0, 4.0, 5.0])
    out, trust = led_through(at, np.full(6, 0.5), [(1, 2.5), (4, 4.5)])
    np.testing.assert_allclose(out, [0.0, 2.5, np.nan, 3.0, 4.5, 5.0])
    assert trust.tolist() == [0.5, 1.0, 0.5, 0.5, 1.0, 0.5]


def test_an_anchor_is_worth_as_much_whatever_the_looks_a_second() -> None:
    """Its nats against the evidence's: squares times looks, as warps weigh them."""
    bend = bend_of([[], [(3, 20.0, False)]], [30.0, 30.0], 0, 1)
    assert bend is not None
    squares = np.ones((6, 40))
    nats = [(bend(1, squares, 1.0, looks) - squares) * looks / 30.0 for looks in (15.0, 60.0)]
    assert nats[0].max() > 1.0
    np.testing.assert_allclose(nats[0], nats[1])
