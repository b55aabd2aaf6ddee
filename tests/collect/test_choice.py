"""The best occurrences of every view become videos, and the others have a reason."""

from dataclasses import replace

import pytest

from imocap_core.collect.listing import Occurrence, SameTakeAs, decide, occurrence_of
from imocap_core.collect.matching import Match
from imocap_core.collect.shots import Shot
from imocap_core.params import CollectParams
from tests.collect.made_tracks import movement, track

PARAMS = CollectParams(keep=3)
GOOD = Occurrence(
    film=0, shot=0, track=0, first=0, stop=60, rate=1.0, score=0.8, mirrored=False,
    mirror_margin=0.0, azimuth_deg=0.0, height_px=300.0, visible=1.0, confidence=0.9,
    box_px=(0, 0, 100, 280), box_frame=30, alone=True,
)  # fmt: skip


def reasons(occurrences: list[Occurrence], again: dict[int, SameTakeAs] | None = None) -> list[str]:
    names = [f"s{k}" for k in range(len(occurrences))]
    fps = [30.0] * len(names)
    return [d.reason for d in decide(occurrences, again or {}, names, fps, PARAMS)]


def test_every_view_has_its_best_before_one_has_two() -> None:
    front = [replace(GOOD, score=score) for score in (0.9, 0.8, 0.7)]
    side = [replace(GOOD, azimuth_deg=90.0, score=0.5), replace(GOOD, azimuth_deg=270.0, score=0.5)]
    assert reasons([*front, *side]) == [
        "",
        "less visible than others of that view (s0)",
        "less visible than others of that view (s0)",
        "",
        "",
    ]


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ({"height_px": 40.0}, "too small: 40 px"),
        ({"stop": 9}, "too short: 0.3 s"),
        ({"visible": 0.5}, "the person is detected in 50% of it only"),
    ],
)
def test_what_cannot_be_captured_is_no_video(fault: dict[str, float], reason: str) -> None:
    assert reasons([GOOD, replace(GOOD, **fault)]) == ["", reason]


def test_a_take_is_taken_once() -> None:
    again = {1: SameTakeAs(0, 0.25), 2: SameTakeAs(0, 1.02)}
    assert reasons([GOOD, GOOD, GOOD], again) == [
        "",
        "replay of s0 at 0.25 times its speed",
        "duplicate of s0",
    ]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 200.0, 300.0])
def test_views_are_told_apart_in_a_mirror_too(azimuth_deg: float, mirrored: bool) -> None:
    straight = track(movement(1), noise_m=0.0)
    turned = track(movement(1), azimuth_deg=azimuth_deg, mirrored=mirrored, noise_m=0.0)
    shot = Shot(0, 1000, "cut", "cut")
    match = Match(0, 15, 75, 1.0, 0.9, False)
    before = occurrence_of(match, straight, shot, 0.0, alone=True)
    after = occurrence_of(replace(match, mirrored=mirrored), turned, shot, 0.0, alone=True)
    change = (after.azimuth_deg - before.azimuth_deg) % 360
    assert min(abs(change - azimuth_deg), abs(change - 360 + azimuth_deg)) < 1.0


def test_a_margin_stays_within_the_shot() -> None:
    there = track(movement(1), first=100)
    shot = Shot(100, 100 + len(there.joints), "cut", "cut")
    occurrence = occurrence_of(Match(0, 2, 80, 1.0, 0.9, False), there, shot, 0.2, alone=True)
    assert (occurrence.first, occurrence.stop) == (100, 186)
