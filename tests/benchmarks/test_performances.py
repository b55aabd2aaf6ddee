"""Sets of performances, groups of clips, and captured joints on other bones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import penn
from benchmarks.actions import performers
from benchmarks.actions.captured_videos import MAX_VIDEOS, PLACEMENTS, data_base, placement
from benchmarks.angles import _accelerations, _peaks, bend_deg, peak_m_s
from benchmarks.field import CURVES, STATISTICS
from benchmarks.performances import FILE, _first_scores, sizes
from imocap_core.conventions import EVAL_14, SMPL_JOINTS
from imocap_core.io.readers.keypoint_arrays import read_keypoints_npz

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


class Standing:
    """A person at rest: y up, facing +z, arms down and straight legs."""

    fps = 30.0
    joint_names = SMPL_JOINTS
    frames = np.arange(3)

    def __init__(self) -> None:
        at = dict.fromkeys(SMPL_JOINTS, (0.0, 1.0, 0.0)) | {
            "neck": (0.0, 1.5, 0.0),
            "head": (0.0, 1.6, 0.0),
            "spine3": (0.0, 1.3, 0.0),
        }
        for side, x in (("left", 0.2), ("right", -0.2)):
            heights = {"hip": 0.9, "knee": 0.5, "ankle": 0.1, "shoulder": 1.4, "wrist": 0.8}
            at |= {f"{side}_{joint}": (x, y, 0.0) for joint, y in heights.items()}
        self.joints = np.tile(np.array([at[name] for name in SMPL_JOINTS]), (3, 1, 1))


def curve(measure: str, video: Standing) -> float:
    return STATISTICS["median"](CURVES[measure](video))  # type: ignore[arg-type]


def test_measures_of_a_standing_person() -> None:
    video = Standing()
    assert curve("knee_flexion_deg", video) == pytest.approx(0.0, abs=1e-5)
    assert curve("trunk_from_horizontal_deg", video) == pytest.approx(90.0, abs=1e-5)
    assert curve("wrists_apart_mm", video) == pytest.approx(400.0)
    assert curve("right_wrist_ahead_m", video) == pytest.approx(0.0)
    assert curve("right_wrist_speed_m_s", video) == 0.0


def test_a_hand_before_the_chest_is_ahead_and_a_bent_leg_is_bent() -> None:
    video = Standing()
    video.joints[:, SMPL_JOINTS.index("right_wrist"), 2] = 0.4
    assert curve("right_wrist_ahead_m", video) == pytest.approx(0.4)
    video.joints[:, SMPL_JOINTS.index("left_ankle")] = (0.2, 0.5, -0.4)
    assert curve("knee_flexion_deg", video) == pytest.approx(90.0)


def clips(count: int) -> list[penn.Clip]:
    rng, seen = np.random.default_rng(3), np.ones((40, 13), bool)
    xy_px = [rng.uniform(50, 300, (40, 13, 2)) for _ in range(count)]
    return [penn.Clip(n, "squat", (480, 360), xy, seen) for n, xy in enumerate(xy_px)]


def test_groups_are_disjoint_and_the_first_of_more_groups() -> None:
    every, few = penn.groups_of(clips(17), "squat", 10), penn.groups_of(clips(17), "squat", 2)
    ids = [clip.id for group in every for clip in group]
    assert len(every) == 17 // penn.GROUP
    assert len(set(ids)) == len(ids)
    assert [[c.id for c in g] for g in few] == [[c.id for c in g] for g in every[:2]]
    assert penn.groups_of(clips(17), "bowl", 3) == []


def test_a_mixed_group_has_one_clip_of_another_action_at_its_place() -> None:
    bowls = [replace(clip, action="bowl") for clip in clips(4)]
    for name, group, place in penn.with_strangers({"squat": [clips(4)], "bowl": [bowls]}):
        assert [v for v in range(4) if not name.startswith(group[v].action)] == [place]


def test_a_group_is_read_as_it_was_labelled(tmp_path: Path) -> None:
    group = clips(2)
    penn.make_group(tmp_path / "squat_00", group)
    people = read_keypoints_npz(tmp_path / "squat_00" / "keypoints" / "c0001.npz", "penn13")
    assert "penn13" in (tmp_path / "squat_00" / "action.yaml").read_text()
    assert people is not None


def test_straight_motion_is_interpolated() -> None:
    limb = penn.LIMBS[0]
    assert [penn.NAMES[k] for k in limb] == ["left_elbow", "left_wrist"]
    xy = np.zeros((30, 13, 2)) + np.arange(30.0)[:, None, None]
    seen = np.ones((30, 13), bool)
    seen[10:20, limb] = False
    assert penn.straight_px(xy, seen, limb) == pytest.approx(xy[:, limb])
