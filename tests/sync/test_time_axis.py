"""One time axis: the phases that maps between made clips must give, its reference, and maps
averaged over several axes."""

from itertools import permutations

import numpy as np
import pytest
from jaxtyping import Float

from imocap_core.sync.axes import averaged_over_axes, axes_of, inverted
from imocap_core.sync.reference import chosen_reference
from imocap_core.sync.time_axis import (
    HARD_WEIGHT,
    PairMaps,
    WeightedMap,
    common_phase,
    composed,
    cycle_residuals,
    left_out_disagreement,
    pace_spread,
    shown_motion,
)
from imocap_core.sync.warp.soft_maps import Clocks


def positions_in(
    phase: Float[np.ndarray, " T"], other: Float[np.ndarray, " S"]
) -> Float[np.ndarray, " T"]:
    """Position of phases among another video's frames, fractional; NaN outside its range."""
    frames = np.arange(len(other), dtype=np.float64)
    if not np.isfinite(other).all():
        return np.full(len(phase), np.nan)
    rising = other + 1e-9 * frames  # of frames of equal phase, any will do
    return np.interp(phase, rising, frames, left=np.nan, right=np.nan)


FPS = 25.0


def clip(first_s: float, last_s: float, fps: float) -> np.ndarray:
    """Times (T,) of the frames of a clip."""
    return np.arange(first_s, last_s, 1.0 / fps)


def true_map(i: int, j: int, times: list[np.ndarray], weight: float = 1.0) -> WeightedMap:
    """The true positions of the frames of clip i in clip j; NaN outside."""
    positions = np.interp(
        times[i], times[j], np.arange(len(times[j]), dtype=float), left=np.nan, right=np.nan
    )
    return WeightedMap(i, j, positions, weight * np.isfinite(positions))


def every_map(times: list[np.ndarray]) -> list[WeightedMap]:
    M = len(times)
    return [true_map(i, j, times) for i in range(M) for j in range(M) if i != j]


def lengths(times: list[np.ndarray]) -> list[int]:
    return [len(t) for t in times]


def test_true_maps_give_the_true_phases() -> None:
    times = [clip(0, 4, FPS), clip(1, 5, 30.0), clip(-1, 3, 50.0)]
    phases = common_phase([FPS, 30.0, 50.0], lengths(times), 0, every_map(times))
    np.testing.assert_array_equal(phases[0], np.arange(100) / FPS)
    for phase, true in zip(phases, times, strict=True):
        inside = (true >= 0) & (true <= times[0][-1])
        np.testing.assert_allclose(phase[inside], true[inside], atol=2e-3)


def test_frames_that_only_other_videos_share_lie_outside_the_reference() -> None:
    times = [clip(0, 3, FPS), clip(1, 6, FPS), clip(2, 7, FPS)]
    phases = common_phase([FPS] * 3, lengths(times), 0, every_map(times))
    for v in (1, 2):
        np.testing.assert_allclose(phases[v], times[v], atol=0.02)
    assert phases[1][-1] > 2 * phases[0][-1] - 0.5


def test_a_chain_of_videos_reaches_one_that_the_reference_never_meets() -> None:
    times = [clip(0, 3, FPS), clip(2, 5, FPS), clip(4, 7, FPS)]
    maps = [true_map(i, j, times) for i, j in ((0, 1), (1, 0), (1, 2), (2, 1))]
    phases = common_phase([FPS] * 3, lengths(times), 0, maps)
    np.testing.assert_allclose(phases[2], times[2], atol=0.02)


def test_a_video_without_any_map_has_no_phase() -> None:
    times = [clip(0, 3, FPS), clip(0, 3, FPS), clip(0, 3, FPS)]
    maps = [true_map(0, 1, times), WeightedMap(2, 0, np.full(75, np.nan), np.zeros(75))]
    phases = common_phase([FPS] * 3, lengths(times), 0, maps)
    assert np.isfinite(phases[1]).all()
    assert np.isnan(phases[2]).all()


@pytest.mark.parametrize("seed", range(3))
def test_maps_through_phases_close_every_cycle_and_outliers_do_not_bend_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = [clip(0, 4, FPS), clip(0.2, 4.4, FPS), clip(-0.3, 3.8, 30.0)]
    maps = []
    for k in every_map(times):
        off = k.positions + rng.normal(0, 0.5, len(k.positions))
        off[40:52] += 20.0 * (k.i == 1 and k.j == 2)  # a dozen frames gone astray in one map
        maps.append(WeightedMap(k.i, k.j, off, k.weights))
    phase = common_phase([FPS, FPS, 30.0], lengths(times), 0, maps)
    for p, true in zip(phase, times, strict=True):
        assert (np.diff(p) >= 0).all()
        shared = (true > 0.2) & (true < 3.8)
        assert np.abs(p - true)[shared].max() < 0.06
    on = positions_in(phase[1], phase[2])
    back = positions_in(np.interp(on, np.arange(len(phase[2])), phase[2]), phase[1])
    matched = np.isfinite(back)
    assert matched.mean() > 0.8
    assert np.abs(back - np.arange(len(back)))[matched].max() < 0.75  # where phases pause, a frame


def test_a_hard_weight_prevails_against_all_evidence() -> None:
    times = [clip(0, 4, FPS), clip(0, 4, FPS), clip(0, 4, FPS)]
    hard, weight = np.full(100, np.nan), np.zeros(100)
    hard[50], weight[50] = 56.0, HARD_WEIGHT
    maps = [*every_map(times), WeightedMap(1, 2, hard, weight)]
    phase = common_phase([FPS] * 3, lengths(times), 0, maps)
    assert abs(positions_in(phase[1][50:51], phase[2])[0] - 56.0) < 0.5
    assert abs(phase[1][10] - times[1][10]) < 0.02


def shifted(offsets: list[float], length: int = 60) -> PairMaps:
    """Clips of one motion that start at `offsets` (frames): consistent maps."""
    frames = np.arange(length, dtype=float)
    positions = {
        (i, j): np.where(
            (frames + a - b >= 0) & (frames + a - b <= length - 1), frames + a - b, np.nan
        )
        for i, a in enumerate(offsets)
        for j, b in enumerate(offsets)
        if i != j
    }
    return PairMaps(positions, {k: np.isfinite(p).astype(float) for k, p in positions.items()})


def test_consistent_maps_close_their_cycles_and_agree() -> None:
    pairs = shifted([0.0, 3.5, 7.0, -2.0])
    triples = cycle_residuals(pairs, [60] * 4, [30.0] * 4)
    assert len(triples) == 4
    for t in triples:
        assert t.frames < 1e-9
        assert 0.7 < t.share <= 1.0
    off, share = left_out_disagreement(pairs, [60] * 4, 0)
    assert np.isnan(off[0])
    assert (off[1:] < 1e-9).all()
    assert (share[1:] > 0.7).all()


def test_a_wrong_map_shows_in_its_cycles_and_nowhere_else() -> None:
    pairs = shifted([0.0, 0.0, 0.0, 0.0])
    pairs.positions[1, 2] = np.minimum(pairs.positions[1, 2] + 6.0, 59.0)
    pairs.positions[2, 1] = np.maximum(pairs.positions[2, 1] - 6.0, 0.0)
    for t in cycle_residuals(pairs, [60] * 4, [30.0, 30.0, 30.0, 30.0]):
        if {1, 2} <= set(t.videos):
            assert 4.0 < t.frames < 6.5
            assert abs(t.seconds - t.frames / 30.0) < 1e-12
        else:
            assert t.frames < 1e-9


def test_the_video_whose_direct_map_differs_is_the_one_that_disagrees() -> None:
    pairs = shifted([0.0] * 5)
    pairs.positions[2, 0] = np.minimum(pairs.positions[2, 0] + 5.0, 59.0)
    off, _ = left_out_disagreement(pairs, [60] * 5, 0)
    assert 4.0 < off[2] < 5.1
    assert off[1] < 0.01  # the median over the ways leaves the wrong one out
    assert off[3] < 0.01


def test_two_videos_have_no_cycle_residual() -> None:
    pairs = shifted([0.0, 1.0])
    assert cycle_residuals(pairs, [60, 60], [30.0, 30.0]) == []
    off, share = left_out_disagreement(pairs, [60, 60], 0)
    assert np.isnan(off).all()
    assert np.isnan(share).all()


def test_composition_interpolates_and_loses_unmatched_frames() -> None:
    then = np.array([0.0, 2.0, np.nan, 6.0])
    got = composed(np.array([0.0, 0.5, 1.0, 1.5, 3.0, np.nan]), then)
    np.testing.assert_allclose(got, [0.0, 1.0, 2.0, np.nan, 6.0, np.nan])


LENGTHS = [60, 50, 70, 55]
REACH = 9.0


def warp(video: int, frames: np.ndarray) -> np.ndarray:
    """Phase of a video's frames: its own offset and pace."""
    return (frames + 2.0 * video) * (1.0 + 0.1 * video)


def maps_to(axis: int, error: float = 0.0) -> list[np.ndarray]:
    """True positions of all videos in one, as far as it reaches; the axis misplaced on the time of
    the action by `error`."""
    out = []
    for v, length in enumerate(LENGTHS):
        phase = warp(v, np.arange(float(length)))
        position = phase / (1.0 + 0.1 * axis) - 2.0 * axis + error * (v != axis)  # inverse
        inside = (position >= 0) & (position <= LENGTHS[axis] - 1)
        out.append(np.where(inside, position, np.nan))
    return out


@pytest.mark.parametrize("reference", range(4))
def test_axes_that_agree_change_nothing(reference: int) -> None:
    exact = {axis: maps_to(axis) for axis in range(4)}
    averaged = averaged_over_axes(exact, reference, LENGTHS, REACH)
    for before, after in zip(exact[reference], averaged, strict=True):
        np.testing.assert_allclose(after, before, atol=1e-9)


def test_an_error_of_the_reference_counts_as_one_of_the_axes() -> None:
    """All videos are placed 2 frames off in the reference, and rightly in each other."""
    maps = {0: maps_to(0, error=2.0), **{axis: maps_to(axis) for axis in (1, 2, 3)}}
    averaged = averaged_over_axes(maps, 0, LENGTHS, 1e6)
    within = slice(15, 30)  # away from the ends of all videos
    for v in (1, 2, 3):
        np.testing.assert_allclose((averaged[v] - maps_to(0)[v])[within], 2.0 / 4, atol=1e-9)


def test_an_axis_that_matches_another_repetition_hardly_counts() -> None:
    """Through the axis 1 everything lies 40 frames late."""
    exact = {axis: maps_to(axis) for axis in range(4)}
    late = [x + 40.0 * (v not in (0, 1)) for v, x in enumerate(maps_to(1))]
    averaged = averaged_over_axes({**exact, 1: late}, 0, LENGTHS, REACH)
    for v in (2, 3):
        error = np.abs(averaged[v] - maps_to(0)[v])[15:30]
        assert np.nanmax(error) < 0.05


def test_unmatched_frames_stay_so_and_no_axis_moves_time_backwards() -> None:
    rng = np.random.default_rng(0)
    maps = {
        axis: [np.maximum.accumulate(x + rng.normal(0, 0.7, len(x))) for x in maps_to(axis)]
        for axis in range(4)
    }
    averaged = averaged_over_axes(maps, 2, LENGTHS, REACH)
    for v in (0, 1, 3):
        matched = np.isfinite(averaged[v])
        np.testing.assert_array_equal(matched, np.isfinite(maps[2][v]))
        assert (np.diff(averaged[v][matched]) >= 0).all()


def test_inverse_of_a_map_and_of_its_plateaus() -> None:
    positions = np.array([np.nan, 0.0, 1.0, 1.0, 1.0, 2.5, np.nan])
    targets = np.array([-0.1, 0.0, 0.5, 1.0, 2.5, 2.6])
    expected = [np.nan, 1.0, 2.0, 3.0, 5.0, np.nan]
    np.testing.assert_allclose(inverted(positions, targets), expected)
    assert np.isnan(inverted(np.full(4, np.nan), targets)).all()


def test_the_reference_is_the_first_axis_and_the_most_central_follow() -> None:
    central = np.array([0.3, 0.9, 0.5, 0.7, 0.1])
    assert axes_of(2, central, most=3) == [2, 1, 3]
    assert axes_of(1, central[:2]) == [1, 0]


CENTRAL, SHOWN = np.array([0.52, 0.50, 0.45, 0.20]), np.array([0.50, 0.95, 0.74, 1.0])


def chosen(central: np.ndarray, shown: np.ndarray, eligible: list[bool]) -> int:
    """Of videos whose pace is alike."""
    return chosen_reference(central, np.full(4, 0.2), shown, eligible)


def test_it_lacks_no_repetition_of_the_central_videos_in_any_order() -> None:
    for order in permutations(range(4)):
        rows = list(order)
        assert rows[chosen(CENTRAL[rows], SHOWN[rows], [True] * 4)] == 1


@pytest.mark.parametrize("seed", range(5))
def test_small_changes_of_centrality_do_not_move_it(seed: int) -> None:
    change = np.random.default_rng(seed).uniform(-0.04, 0.04, 4)
    assert chosen(CENTRAL + change, SHOWN, [True] * 4) == 1


def test_the_most_central_of_videos_that_show_as_much_is_taken() -> None:
    assert chosen(CENTRAL, np.full(4, 0.95), [True] * 4) == 0


def test_only_eligible_videos_are_taken_unless_none_is() -> None:
    assert chosen(CENTRAL, SHOWN, [True, False, True, True]) == 2
    assert chosen(CENTRAL, SHOWN, [False] * 4) == 1


def shown(positions: dict[tuple[int, int], np.ndarray], moving: list[np.ndarray]) -> np.ndarray:
    """Shares of motion, ten frames a second."""
    pairs = PairMaps(positions, {pair: np.ones(len(x)) for pair, x in positions.items()})
    return shown_motion(pairs, moving, Clocks([10.0] * len(moving), np.ones(len(moving))))


def test_a_video_shows_the_motion_of_others_that_goes_on_in_it() -> None:
    """Of two repetitions the other video has one; the second is piled up at its last frame."""
    maps = {(0, 1): np.minimum(np.arange(100.0), 49.0), (1, 0): np.arange(50.0)}
    np.testing.assert_allclose(shown(maps, [np.ones(100), np.ones(50)]), [1.0, 0.5], atol=0.05)
    holds = np.r_[np.ones(50), np.zeros(50)]  # nothing is lacking: the performer stands still
    np.testing.assert_allclose(shown(maps, [holds, np.ones(50)]), [1.0, 1.0], atol=0.1)


def test_shown_motion_is_a_mean_over_the_other_videos_and_0_of_one_alone() -> None:
    same, nowhere = np.arange(30.0), np.full(30, np.nan)
    maps = {(u, v): nowhere if v == 2 else same for u, v in permutations(range(3), 2)}
    np.testing.assert_allclose(shown(maps, [np.ones(30)] * 3), [1.0, 1.0, 0.0], atol=0.1)
    assert shown({}, [np.ones(3)]) == [0.0]


def test_of_videos_that_show_as_much_the_steadiest_is_taken() -> None:
    alike, steady = np.array([0.95, 0.9, 0.95, 1.0]), np.array([0.5, 0.2, 0.22, 0.0])
    assert chosen_reference(CENTRAL, steady, alike, [True] * 4) == 1
    assert chosen_reference(CENTRAL[::-1], steady[::-1], alike[::-1], [True] * 4) == 2


def played(paces: list[np.ndarray]) -> PairMaps:
    """Maps between videos that go through one action at these seconds of it per frame."""
    times = [np.cumsum(pace) for pace in paces]
    positions = {
        (i, j): np.interp(a, b, np.arange(len(b)), left=np.nan, right=np.nan)
        for i, a in enumerate(times)
        for j, b in enumerate(times)
        if i != j
    }
    return PairMaps(positions, {pair: np.ones(len(p)) for pair, p in positions.items()})


def stalling(rng: np.random.Generator, frames: int) -> np.ndarray:
    """A third of the time the action stands still for a quarter of a second."""
    stalls = np.repeat(rng.random(frames // 8) < 0.33, 8)
    return np.where(stalls, 1e-4, 1.5) / 30


@pytest.mark.parametrize("rate", [1.0, 0.25])
def test_the_pace_that_varies_is_told_from_the_steady_one(rate: float) -> None:
    rng = np.random.default_rng(3)
    steady = np.full(round(150 / rate), rate / 30)
    paces = [stalling(rng, 160), steady, stalling(rng, 152), stalling(rng, 160)]
    clocks = Clocks([30.0] * 4, np.array([1.0, rate, 1.0, 1.0]))
    spreads = pace_spread(played(paces), [len(p) for p in paces], clocks)
    assert spreads.argmin() == 1
    assert spreads[1] < 0.15
    assert min(spreads[[0, 2, 3]]) > 0.35


def test_of_two_videos_neither_is_said_to_be_the_unsteady_one() -> None:
    paces = [stalling(np.random.default_rng(1), 160), np.full(150, 1 / 30)]
    first, second = pace_spread(played(paces), [160, 150], Clocks([30.0] * 2, np.ones(2)))
    assert first == second > 0.2


def test_videos_that_share_nothing_have_no_spread() -> None:
    apart = {pair: np.full(20, np.nan) for pair in ((0, 1), (1, 0))}
    maps = PairMaps(apart, {pair: np.zeros(20) for pair in apart})
    assert not pace_spread(maps, [20, 20], Clocks([30.0] * 2, np.ones(2))).any()
    assert not pace_spread(PairMaps({}, {}), [20], Clocks([30.0], np.ones(1))).any()
