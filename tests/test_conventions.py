"""The constants agree with each other."""

import pytest

from imocap_core import conventions as c

TREES = [(c.SMPL_JOINTS, c.SMPL_PARENTS, 24), (c.SMPLH_JOINTS, c.SMPLH_PARENTS, 52)]


@pytest.mark.parametrize(("names", "parents", "count"), TREES)
def test_trees_are_complete_ordered_and_symmetric(names, parents, count):
    assert len(names) == len(parents) == len(set(names)) == count
    assert parents[0] == -1
    assert all(0 <= parent < joint for joint, parent in enumerate(parents) if joint)
    mirror = c.mirror_indices(names)
    for joint, parent in enumerate(parents[1:], start=1):
        assert parents[mirror[joint]] == mirror[parent]  # the mirrored tree is the tree


def test_bodies_share_their_first_22_joints() -> None:
    for names, parents, _ in TREES:
        assert names[:22] == c.SMPL_JOINTS[:22]
        assert parents[:22] == c.SMPL_PARENTS[:22]


def test_evaluation_joints_grow_and_pair_up() -> None:
    assert c.EVAL_14[:12] == c.EVAL_17[:12] == c.EVAL_12
    assert [len(j) for j in (c.EVAL_12, c.EVAL_14, c.EVAL_17)] == [12, 14, 17]
    assert len(c.left_right_pairs(c.EVAL_12)) == 6
    assert set(c.EVAL_12) <= set(c.SMPL_JOINTS)


def test_sides_swap_back() -> None:
    assert c.swap_side("left_knee") == "right_knee"
    assert c.swap_side("nose") == "nose"
    assert c.mirror_indices(["left_eye", "nose"]) == (0, 1)  # its twin is not in the list
    two = ("nose", "left_knee", "right_knee", "nose", "right_knee", "left_knee")
    assert c.mirror_indices(two) == (0, 2, 1, 3, 5, 4)  # a twin in each of two layouts
    assert c.left_right_pairs(["right_hip", "nose", "left_hip"]) == ((2, 0),)
