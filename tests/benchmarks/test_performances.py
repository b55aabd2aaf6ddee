"""Sets of performances, what is measured of them, and captured joints on other bones."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.actions import performers
from benchmarks.actions.captured_videos import MAX_VIDEOS, PLACEMENTS, data_base, placement
from benchmarks.angles import _accelerations, _peaks, bend_deg, peak_m_s
from benchmarks.performances import FILE, _first_scores, sizes
from imocap_core.conventions import EVAL_14

ROW = EVAL_14.index
ROOT = Path(__file__).resolve().parents[2]
CAPTURED = data_base(ROOT) / "performances" / FILE


def test_sets_double_up_to_all_takes() -> None:
    assert list(sizes(32)) == [2, 4, 8, 16, 32]
    assert list(sizes(5)) == [2, 4]


def test_cameras_stand_around_the_performer() -> None:
    assert [placement(v) for v in range(MAX_VIDEOS)] == list(PLACEMENTS)
    azimuths = sorted(placement(v).azimuth_deg for v in range(MAX_VIDEOS, 32))
    assert max(np.diff(azimuths)) < 45


@pytest.mark.skipif(not CAPTURED.is_file(), reason="needs the captured takes (IMOCAP_DATA)")
def test_a_take_is_filmed_alike_in_every_set() -> None:
    alone, among = performers.takes(CAPTURED, 2, 2), performers.takes(CAPTURED, 0, 4)
    assert [video.place for video in alone] == [2, 3]
    assert [len(video.frames) for video in alone] == [len(video.frames) for video in among[2:]]


def test_the_first_mode_is_of_poses_not_of_places() -> None:
    rng = np.random.default_rng(0)
    scores = rng.normal(size=6)
    still = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.0, 0.7]])
    true = []
    for score in scores:
        joints = np.tile(still, (20, 1, 1))
        joints[:, 2, 0] += 0.1 * score
        true.append(joints + rng.normal(size=3))
    got = _first_scores(true, ["left_hip", "right_hip", "head"])
    assert abs(np.corrcoef(got, scores)[0, 1]) == pytest.approx(1.0)


def test_the_bend_of_a_straight_limb_is_0() -> None:
    limb = np.array([[[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]], [[0, 0, 0], [1, 0, 0], [1, 1, 0]]])
    np.testing.assert_allclose(bend_deg(limb), [0.0, 90.0], atol=1e-6)


def test_the_highest_speed_is_that_of_the_fastest_moment() -> None:
    place = np.zeros((31, 3))
    place[:, 0] = np.cumsum([0.0] + [0.02] * 10 + [0.1] * 10 + [0.01] * 10)
    assert peak_m_s(place, 30.0) == pytest.approx(3.0)


def test_a_peak_is_compared_behind_the_same_filter_as_the_captured_one() -> None:
    place = np.random.default_rng(0).normal(size=(60, 12, 3))
    for factor, error in ((1.0, 0.0), (1.1, 10.0)):
        assert list(_peaks(factor * place, place, 30.0).values()) == pytest.approx([error] * 4)


def test_accelerations_know_no_direction_and_a_filter_takes_the_noise_out() -> None:
    rng = np.random.default_rng(1)
    path = np.cumsum(np.cumsum(rng.normal(size=(80, 12, 3)), axis=0), axis=0) * 1e-3
    turned = path @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(_accelerations(turned, path, 30.0)[:, 1], 0.0, atol=1e-9)
    errors = _accelerations(path + 1e-3 * rng.normal(size=path.shape), path, 30.0)[:, 1]
    assert errors[2] < errors[1] < errors[0]


def joints() -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.normal(0, 0.3, (5, 14, 3)) + [1.0, 2.0, 1.0]


def test_bones_get_their_ratios_and_keep_their_directions() -> None:
    ratio = performers.bone_ratios("walk")["A"]
    before, after = joints(), performers.with_bones(joints(), ratio)
    for far, near in performers.PARENT_OF.items():
        a, b = (x[:, ROW(far)] - x[:, ROW(near)] for x in (before, after))
        np.testing.assert_allclose(b, ratio[far] * a, atol=1e-12)
    for far in performers.LIMBS:
        expected = ratio[far] * performers.limb_lengths_m(before)[far]
        assert performers.limb_lengths_m(after)[far] == pytest.approx(expected)


def test_the_mean_body_changes_nothing() -> None:
    ratio = dict.fromkeys(performers.bone_ratios("walk")["A"], 1.0)
    np.testing.assert_allclose(performers.with_bones(joints(), ratio), joints(), atol=1e-12)


def test_a_foot_in_contact_stays_in_contact() -> None:
    """Legs of one ratio: a foot that stands still in the capture stands still."""
    standing = joints()
    standing[:, ROW("left_ankle")] = standing[0, ROW("left_ankle")]
    hips = standing[:, [ROW("left_hip"), ROW("right_hip")]].mean(axis=1)
    ratio = dict.fromkeys(performers.bone_ratios("walk")["A"], 1.1)
    moved = performers.with_bones(standing, ratio)[:, ROW("left_ankle")]
    assert np.ptp(moved, axis=0).max() < 1e-12
    assert np.ptp(hips, axis=0).max() > 0.1


def test_performers_have_bodies_of_their_own() -> None:
    first, second = performers.bone_ratios("walk").values()
    assert max(abs(first[bone] - second[bone]) for bone in performers.LIMBS) > 0.02
    assert performers.bone_ratios("walk") == performers.bone_ratios("walk")
    assert set(performers.bone_ratios("walk")) == set(performers.PERFORMERS)
