"""The benchmark of the screening: what is planted is what is counted."""

from dataclasses import replace

import numpy as np

from benchmarks import screening
from benchmarks.screening_casts import mirrored_performance, occluded
from imocap_core.synthetic.detector import Detections

GOOD = screening.SceneRow(
    scene="a", development=True, videos=4, asymmetric=True, clean_excluded=0, clean_flipped=0,
    stranger="v2", stranger_excluded="v2", mirrored="v3", mirrored_flipped="v3",
    mirrored_excluded="-", wrongly_treated=0, near_symmetric_flips=0,
)  # fmt: skip
BAD = replace(
    GOOD, development=False, clean_excluded=1, stranger_excluded="v1 v3", mirrored_flipped="-",
    wrongly_treated=3,
)  # fmt: skip


def test_a_performance_mirrored_twice_is_itself_and_once_is_not() -> None:
    joints = np.random.default_rng(0).normal(size=(7, 14, 3))
    once = mirrored_performance(joints)
    np.testing.assert_array_equal(mirrored_performance(once), joints)
    assert not np.allclose(once, joints)


def test_occlusion_only_takes_detections_away() -> None:
    detections = Detections(np.ones((90, 18, 2)), np.full((90, 18), 0.8))
    hidden = [occluded(detections, np.random.default_rng(seed)) for seed in range(20)]
    shares = [float((h.confidence == 0).mean()) for h in hidden]
    assert min(shares) == 0.0
    assert 0.0 < max(shares) < 0.2
    for film in hidden:
        visible = film.confidence > 0
        np.testing.assert_array_equal(film.xy_px[visible], 1.0)
        np.testing.assert_array_equal(film.xy_px[~visible], 0.0)


def test_strangers_are_mutual_and_of_another_repertoire() -> None:
    pairs = [
        (a, b) for a in screening.CLIPS for b in screening.CLIPS if screening.are_strangers(a, b)
    ]
    assert all(
        screening.are_strangers(b, a) and a.split("_")[0] != b.split("_")[0] for a, b in pairs
    )
    assert not any(a in screening.WALKS and b in screening.WALKS for a, b in pairs)
    assert {a for a, _ in pairs} == set(screening.CLIPS)


def test_counts_are_of_what_was_planted() -> None:
    rows = [GOOD, BAD]
    assert screening.genuine_treated(rows) == (3, 20)
    assert screening.clean_treated(rows) == (1, 8)
    assert screening.strangers_excluded(rows) == (1, 2)
    assert screening.mirrored_flipped(rows) == (1, 2)
    near = replace(BAD, asymmetric=False, near_symmetric_flips=1)
    assert screening.mirrored_flipped([near]) == (0, 0)
    assert screening.near_symmetric_flipped([GOOD, near]) == (1, 12)
    assert 0.0 < screening.ASYMMETRIC < 1.0
