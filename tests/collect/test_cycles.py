"""A movement is a whole cycle, and every cycle is found once."""

import numpy as np
import pytest

from imocap_core.collect.films import ShotTrack
from imocap_core.collect.listing import Occurrence, occurrence_of, shows_same
from imocap_core.collect.matching import Match
from imocap_core.collect.movement import cycle_around, cycles_of, in_whole_cycles
from imocap_core.collect.shots import Shot
from imocap_core.params import RepetitionParams
from tests.collect.made_tracks import FPS, movement, track

CYCLES = ((0, 40), (40, 80), (85, 120))


def match(first: int, stop: int, score: float) -> Match:
    return Match(0, first, stop, 1.0, score, mirrored=False)


def repeated(times: int) -> ShotTrack:
    once = track(movement(1), pause_s=0.0)
    joints = np.concatenate([once.joints] * times)
    fields = {name: np.concatenate([getattr(once, name)] * times) for name in ("xy_px", "box_px")}
    return ShotTrack(**(vars(once) | fields | {"joints": joints}))


def test_cycles_are_those_of_the_track_itself() -> None:
    once = len(repeated(1).joints)
    cycles = cycles_of(repeated(3), RepetitionParams())
    assert len(cycles) == 3
    assert [b - a for a, b in cycles] == pytest.approx([once] * 3, abs=0.25 * FPS)
    assert cycles_of(repeated(1), RepetitionParams()) == ()


def test_a_part_of_a_cycle_is_the_cycle_and_more_than_one_is_not() -> None:
    assert cycle_around(50, 70, CYCLES) == (40, 80)
    assert cycle_around(35, 80, CYCLES) == (40, 80)
    assert cycle_around(0, 80, CYCLES) is None
    assert cycle_around(0, 10, ()) is None


def test_every_cycle_is_found_once_and_as_a_whole() -> None:
    matches = [match(50, 70, 0.8), match(68, 80, 0.7), match(2, 38, 0.6), match(90, 110, 0.3)]
    found = in_whole_cycles(matches, CYCLES, 0.5)
    assert [(m.first, m.stop, m.score) for m in found] == [
        (40, 80, 0.8),
        (0, 40, 0.6),
        (85, 120, 0.3),  # a repetition of what is found
    ]
    assert found[0].rate == 0.5  # half of the movement in half of the time
    assert in_whole_cycles(matches, CYCLES, 0.9) == []


def test_without_cycles_matches_stay_as_they_are_and_no_moment_is_found_twice() -> None:
    matches = [match(50, 70, 0.8), match(60, 90, 0.7), match(80, 100, 0.6), match(0, 9, 0.3)]
    assert in_whole_cycles(matches, (), 0.5) == [matches[0], matches[2]]


def test_a_person_followed_twice_is_one_and_two_people_are_two() -> None:
    def occurrence(number: int, aside_px: float) -> Occurrence:
        shown = track(movement(1), track=number)
        moved = ShotTrack(**(vars(shown) | {"box_px": shown.box_px + aside_px}))
        return occurrence_of(match(10, 60, 0.8), moved, Shot(0, 90, "cut", "cut"), 0.1, alone=False)

    first = occurrence(0, 0.0)
    assert shows_same(first, occurrence(1, 5.0))
    assert not shows_same(first, occurrence(1, 400.0))
    assert not shows_same(first, first)  # another occurrence of the same track is another time
