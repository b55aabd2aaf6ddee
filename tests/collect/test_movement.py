"""A movement is a whole cycle, and every cycle is found once."""

import numpy as np
import pytest

from imocap_core.collect.films import ShotTrack
from imocap_core.collect.listing import Occurrence, occurrence_of, shows_same
from imocap_core.collect.matching import (
    RATES,
    FilmTracks,
    Match,
    part_of,
    samples_of,
    squared_distances,
    template_of,
)
from imocap_core.collect.movement import (
    MOST,
    by_further_examples,
    clearest,
    cycle_around,
    cycles_of,
    in_whole_cycles,
    matches_of_all,
    template_at,
    threshold,
)
from imocap_core.collect.shots import Shot
from imocap_core.params import CollectParams
from tests.collect.made_tracks import FPS, joined, movement, track

CYCLES = ((0, 40), (40, 80), (85, 120))


def cycle(first: int, stop: int, score: float) -> Match:
    return Match(0, first, stop, 1.0, score, mirrored=False)


def repeated(times: int) -> ShotTrack:
    return joined(*[track(movement(1), pause_s=0.0)] * times)


def test_cycles_are_those_of_the_track_itself() -> None:
    once = len(repeated(1).joints)
    cycles = cycles_of(repeated(3))
    assert len(cycles) == 3
    assert [b - a for a, b in cycles] == pytest.approx([once] * 3, abs=0.25 * FPS)
    assert cycles_of(repeated(1)) == ()


def test_a_part_of_a_cycle_is_the_cycle_and_more_than_one_is_not() -> None:
    assert cycle_around(50, 70, CYCLES) == (40, 80)
    assert cycle_around(35, 80, CYCLES) == (40, 80)
    assert cycle_around(0, 80, CYCLES) is None
    assert cycle_around(0, 10, ()) is None


def test_every_cycle_is_found_once_and_as_a_whole() -> None:
    matches = [cycle(50, 70, 0.8), cycle(68, 80, 0.7), cycle(2, 38, 0.6), cycle(90, 110, 0.3)]
    found = in_whole_cycles(matches, CYCLES, 0.5)
    assert [(m.first, m.stop, m.score) for m in found] == [
        (40, 80, 0.8),
        (0, 40, 0.6),
        (85, 120, 0.3),  # a repetition of what is found
    ]
    assert found[0].rate == 0.5  # half of the movement in half of the time
    assert in_whole_cycles(matches, CYCLES, 0.9) == []


def test_without_cycles_matches_stay_as_they_are_and_no_moment_is_found_twice() -> None:
    matches = [cycle(50, 70, 0.8), cycle(60, 90, 0.7), cycle(80, 100, 0.6), cycle(0, 9, 0.3)]
    assert in_whole_cycles(matches, (), 0.5) == [matches[0], matches[2]]


def test_a_person_followed_twice_is_one_and_two_people_are_two() -> None:
    def occurrence(number: int, aside_px: float) -> Occurrence:
        shown = track(movement(1), track=number)
        moved = ShotTrack(**(vars(shown) | {"box_px": shown.box_px + aside_px}))
        return occurrence_of(cycle(10, 60, 0.8), moved, Shot(0, 90, "cut", "cut"), 0.1, alone=False)

    first = occurrence(0, 0.0)
    assert shows_same(first, occurrence(1, 5.0))
    assert not shows_same(first, occurrence(1, 400.0))
    assert not shows_same(first, first)  # another occurrence of the same track is another time


PARAMS = CollectParams()
SHOWN, OTHERS = movement(1), [movement(seed) for seed in range(2, 8)]
UNLIKE = 0.35  # share of another movement in the example
SHOWINGS = [track(SHOWN, shot=k, azimuth_deg=70.0 * k, noise_m=0.05) for k in range(5)]
FILMS = [*SHOWINGS, *(track(m, shot=10 + k) for k, m in enumerate(OTHERS))]


def filmed(tracks: list[ShotTrack]) -> FilmTracks:
    return FilmTracks(tracks, [[samples_of(t, rate) for rate in RATES] for t in tracks])


@pytest.fixture(scope="module")
def people() -> FilmTracks:
    return filmed(FILMS)


@pytest.fixture(scope="module")
def by_example(people: FilmTracks) -> list[list[Match]]:
    shown, other = track(SHOWN, shot=20), track(movement(9), shot=21)
    joints = (1 - UNLIKE) * shown.joints + UNLIKE * other.joints
    samples = samples_of(ShotTrack(**{**vars(shown), "joints": joints}), 1.0)
    inside = (samples.frame >= 0.5 * FPS) & (samples.frame < 2.5 * FPS)
    return matches_of_all(people, template_of(part_of(samples, inside), people.pool()))


@pytest.fixture(scope="module")
def by_examples(people: FilmTracks, by_example: list[list[Match]]) -> list[list[Match]]:
    return by_further_examples(people, by_example, PARAMS)


def best(matches: list[list[Match]]) -> np.ndarray:
    return np.array([max((m.score for m in of_track), default=0.0) for of_track in matches])


def test_showings_are_told_better_from_the_rest(by_example, by_examples):
    before, after = best(by_example), best(by_examples)
    own, rest = slice(len(SHOWINGS)), slice(len(SHOWINGS), None)
    assert after[own].min() > before[own].min() + 0.1
    assert after[rest].max() < before[rest].max() + 0.05


def test_matches_stay_where_they_are_best_first(by_example, by_examples):
    for before, after in zip(by_example, by_examples, strict=True):
        assert sorted((m.first, m.stop) for m in before) == sorted((m.first, m.stop) for m in after)
        assert [m.score for m in after] == sorted((m.score for m in after), reverse=True)


def match(track: int, score: float, *, mirrored: bool = False, begin_s: float = 0.5) -> Match:
    first = round(begin_s * FPS)
    return Match(track, first, first + round(2 * FPS), 1.0, score, mirrored)


def scores(people: FilmTracks, matches: list[Match]) -> list[float]:
    """The scores of one match a track by further examples."""
    again = by_further_examples(people, [[m] for m in matches], PARAMS)
    return [of_track[0].score for of_track in again]


def test_one_wrong_example_among_right_ones_weighs_little() -> None:
    wrong = len(SHOWINGS)
    once_more = track(OTHERS[0], shot=30, azimuth_deg=40)
    by_example = [0.8, 0.8, 0.8, 0.8, 0.45, 0.8, *[0.1] * (len(OTHERS) - 1), 0.3]
    assert FILMS[wrong].shot == 10
    score = scores(filmed([*FILMS, once_more]), [match(k, s) for k, s in enumerate(by_example)])
    assert score[wrong - 1] > 0.5  # the last showing
    assert score[-1] < PARAMS.least_score  # the wrong movement once more


def test_an_example_is_not_compared_with_itself(people: FilmTracks) -> None:
    alone = [match(0, 0.6), *(match(k, 0.1) for k in range(1, len(FILMS)))]
    assert scores(people, alone)[0] == 0.6


def test_another_stretch_of_the_same_track_counts_for_itself() -> None:
    shown, other = track(SHOWN, shot=40), track(OTHERS[0], shot=41)
    people = filmed([joined(shown, other), *SHOWINGS])
    later = len(shown.joints) / FPS + 0.5
    first, second = match(0, 0.3), match(0, 0.3, begin_s=later)
    clear = [[match(k, 0.8)] for k in range(1, len(SHOWINGS) + 1)]
    again = by_further_examples(people, [[first, second], *clear], PARAMS)
    by_place = {m.first: m.score for m in again[0]}
    assert by_place[first.first] > 0.5
    assert by_place[second.first] < 0.3


def test_a_mirrored_match_is_an_example_of_the_movement_as_it_is() -> None:
    people = filmed([track(SHOWN, shot=0), track(SHOWN, shot=1, mirrored=True), FILMS[-1]])
    pool = people.pool()
    plain = template_at(people, match(0, 0.9), pool)
    back = template_at(people, match(1, 0.9, mirrored=True), pool)
    unturned = template_at(people, match(1, 0.9), pool)
    near, far = (
        np.diagonal(squared_distances(plain.samples, t.samples)).mean() for t in (back, unturned)
    )
    assert near < 0.1 * far


def test_only_clear_matches_are_examples() -> None:
    unclear = [[match(k, 0.45)] for k in range(3)]
    assert clearest(unclear, PARAMS) == []
    clear = [[match(k, 0.9 - 0.01 * k), match(k, 0.8)] for k in range(MOST + 2)]
    rest = [[match(20 + k, 0.1)] for k in range(30)]
    assert clearest([*clear, *rest, []], PARAMS) == [of_track[0] for of_track in clear[:MOST]]
    assert threshold([*clear, *rest, []], PARAMS) == PARAMS.least_score


def test_without_clear_matches_the_example_decides_alone(people: FilmTracks) -> None:
    weak = [[match(k, 0.3 + 0.01 * k)] for k in range(len(FILMS))]
    assert by_further_examples(people, weak, PARAMS) == weak
