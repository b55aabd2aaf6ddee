"""A movement is found from any side, at any speed, in a mirror, and in nothing else; a take that is
shown again is told from another performance."""

import cv2
import numpy as np
import pytest

from imocap_core.collect import matching
from imocap_core.collect.films import ShotTrack
from imocap_core.collect.movement import dominant_template
from imocap_core.collect.same_takes import compared_pairs, repeated_motion, same_picture
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.params import CollectParams
from tests.collect.made_tracks import FPS, joined, movement, track

PARAMS = CollectParams()
SOUGHT, OTHERS = movement(1), [movement(seed) for seed in (2, 3, 4)]
POOL = [track(m, shot=k) for k, m in enumerate((SOUGHT, *OTHERS))]


def pool_of(tracks: list[ShotTrack]) -> matching.TrackSamples:
    return matching.pooled([matching.samples_of(t, 1.0) for t in tracks])


def template() -> matching.Template:
    samples = matching.samples_of(POOL[0], 1.0)
    inside = (samples.frame >= 0.5 * FPS) & (samples.frame < 2.5 * FPS)
    return matching.template_of(matching.part_of(samples, inside), pool_of(POOL))


def found(of: ShotTrack) -> list[matching.Match]:
    matches = matching.matches_in(
        0, of, [matching.samples_of(of, rate) for rate in matching.RATES], template()
    )
    return [match for match in matches if match.score >= PARAMS.certain_score]


@pytest.mark.parametrize("azimuth_deg", [0.0, 70.0, 180.0])
@pytest.mark.parametrize("rate", [0.25, 0.5, 1.0, 2.0])
def test_the_view_and_the_speed_do_not_matter(rate: float, azimuth_deg: float) -> None:
    (match,) = found(track(SOUGHT, shot=7, rate=rate, azimuth_deg=azimuth_deg))
    assert match.rate == pytest.approx(rate, rel=0.25)
    assert not match.mirrored
    begin, end = 0.5 * FPS / rate, 2.5 * FPS / rate
    shared = min(match.stop, end) - max(match.first, begin)
    assert shared / (max(match.stop, end) - min(match.first, begin)) > 0.7


def test_a_mirrored_shot_is_recognised() -> None:
    (match,) = found(track(SOUGHT, shot=8, mirrored=True, azimuth_deg=40))
    assert match.mirrored
    assert match.mirror_margin > matching.MIRROR_MARGIN


@pytest.mark.parametrize("other", [0, 1, 2])
def test_another_movement_is_not_found(other: int) -> None:
    assert found(track(OTHERS[other], shot=9, azimuth_deg=30)) == []


def test_who_stands_still_is_not_found() -> None:
    moving = track(SOUGHT, shot=3)
    first = np.repeat(moving.joints[:1], len(moving.joints), axis=0)
    assert found(ShotTrack(**{**vars(moving), "joints": first})) == []


def test_a_movement_twice_in_a_shot_is_found_twice() -> None:
    once = track(SOUGHT, shot=5)
    assert len(found(joined(once, once))) == 2


def test_what_is_repeated_most_is_the_dominant_movement() -> None:
    tracks = [track(m, shot=k) for k, m in enumerate(OTHERS)]
    tracks += [track(SOUGHT, shot=10 + k, azimuth_deg=80.0 * k) for k in range(4)]
    samples = [[matching.samples_of(t, rate) for rate in matching.RATES] for t in tracks]
    best = dominant_template(samples, pool_of(tracks), lambda a, b: False)
    assert best[1] >= len(OTHERS)


@pytest.mark.parametrize("replayed", [(), (SOUGHT,)])
def test_where_nothing_but_a_take_s_replays_is_repeated_there_is_no_dominant_movement(
    replayed: tuple,
) -> None:
    tracks = [track(m, shot=k) for k, m in enumerate((*replayed, *OTHERS, *replayed))]
    samples = [[matching.samples_of(t, rate) for rate in matching.RATES] for t in tracks]
    same = {(0, 4), (4, 0)} if replayed else set()
    assert dominant_template(samples, pool_of(tracks), lambda a, b: (a, b) in same) is None


def test_an_occurrence_exceeds_what_everybody_else_is_like() -> None:
    others = [0.30, 0.32, 0.34, 0.36, 0.38, 0.31, 0.33, 0.35]
    assert 0.38 < matching.score_threshold([*others, 0.6, 0.65], PARAMS) < 0.6
    assert matching.score_threshold([0.0] * 10, PARAMS) == PARAMS.least_score
    assert matching.score_threshold([0.9] * 10, PARAMS) == PARAMS.certain_score
    few = matching.score_threshold([0.1, 0.9], PARAMS)
    assert PARAMS.least_score < few < PARAMS.certain_score


TWINS = mirror_indices(SMPL_JOINTS)
ORIGINAL = track(movement(1), noise_m=0.004)
BODY = 400.0  # pixels, about


@pytest.mark.parametrize("rate", [0.25, 0.5, 1.0, 2.0])
def test_a_take_at_another_speed_and_size_is_a_replay(rate: float) -> None:
    again = track(movement(1), shot=3, rate=rate, noise_m=0.004).xy_px * 0.8 + [40.0, -25.0]
    replay = repeated_motion(ORIGINAL.xy_px, again, FPS, TWINS)
    assert replay.rate == pytest.approx(1 / rate, rel=0.1)
    assert replay.scale == pytest.approx(1.25, rel=0.02)
    assert not replay.mirrored


def test_a_mirrored_take_is_a_replay() -> None:
    again = [640.0, 0.0] - ORIGINAL.xy_px[:, list(TWINS)] * [1.0, -1.0]
    replay = repeated_motion(ORIGINAL.xy_px, again, FPS, TWINS)
    assert replay.mirrored


def test_another_performance_before_the_same_camera_is_none() -> None:
    other = movement(1)
    rng = np.random.default_rng(5)
    other.c[-1] += rng.normal(0, 0.12, other.c[-1].shape)
    assert repeated_motion(ORIGINAL.xy_px, track(other).xy_px, FPS, TWINS) is None


def test_a_take_run_backwards_is_none() -> None:
    assert repeated_motion(ORIGINAL.xy_px, ORIGINAL.xy_px[::-1], FPS, TWINS) is None


def test_who_stands_still_repeats_nothing() -> None:
    still = np.repeat(ORIGINAL.xy_px[:1], 60, axis=0)
    assert repeated_motion(still, still, FPS, TWINS) is None


def test_pictures_are_compared_where_the_person_is() -> None:
    again = ORIGINAL.xy_px * 0.5 + [30.0, 10.0]
    replay = repeated_motion(ORIGINAL.xy_px, again, FPS, TWINS)
    pairs = compared_pairs(replay)
    assert all(a == b for a, b in pairs)
    texture = cv2.GaussianBlur(np.random.default_rng(0).random((480, 640)), (0, 0), 6)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    moved = cv2.warpAffine(texture, np.array([[0.5, 0, 30.0], [0, 0.5, 10.0]]), (640, 480))
    box = ORIGINAL.box_px[pairs[0][0]]
    assert same_picture(texture, moved, box, replay) > 0.95
    assert same_picture(texture, texture[::-1], box, replay) < 0.5
