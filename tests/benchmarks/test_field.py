"""`imocap benchmark field` and `penn`: measures, groups of clips, hidden limbs."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.field import CURVES, STATISTICS
from benchmarks.penn import GROUP, LIMBS, NAMES, Clip, groups_of, make_group, straight_px
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.readers.keypoint_arrays import read_keypoints_npz


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


def clips(count: int) -> list[Clip]:
    rng = np.random.default_rng(3)
    return [
        Clip(n, "squat", (480, 360), rng.uniform(50, 300, (40, 13, 2)), np.ones((40, 13), bool))
        for n in range(count)
    ]


def test_groups_are_disjoint_and_the_first_of_more_groups() -> None:
    every, few = groups_of(clips(17), "squat", 10), groups_of(clips(17), "squat", 2)
    ids = [clip.id for group in every for clip in group]
    assert len(every) == 17 // GROUP
    assert len(set(ids)) == len(ids)
    assert [[c.id for c in g] for g in few] == [[c.id for c in g] for g in every[:2]]
    assert groups_of(clips(17), "bowl", 3) == []


def test_a_group_is_read_as_it_was_labelled(tmp_path: Path) -> None:
    group = clips(2)
    make_group(tmp_path / "squat_00", group)
    people = read_keypoints_npz(tmp_path / "squat_00" / "keypoints" / "c0001.npz", "penn13")
    assert "penn13" in (tmp_path / "squat_00" / "action.yaml").read_text()
    assert people is not None


def test_straight_motion_is_interpolated() -> None:
    limb = LIMBS[0]
    assert [NAMES[k] for k in limb] == ["left_elbow", "left_wrist"]
    xy = np.zeros((30, 13, 2)) + np.arange(30.0)[:, None, None]
    seen = np.ones((30, 13), bool)
    seen[10:20, limb] = False
    assert straight_px(xy, seen, limb) == pytest.approx(xy[:, limb])
