"""joints_npz, smpl_npz and truth.npz: read, cut to the used frames, refused when wrong."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.io.readers.joint_estimators import read_joints_npz
from imocap_core.io.readers.smpl_estimators import read_smpl_npz
from imocap_core.io.truth import read_truth


def saved(tmp_path, **arrays):
    path = tmp_path / "v1.npz"
    np.savez(path, **arrays)
    return path


def joints(count):
    return np.arange(count * 6, dtype=np.float32).reshape(count, 2, 3)


NAMES = np.array(["left_hip", "right_hip"])


def test_rows_are_the_used_frames_when_there_are_as_many(tmp_path):
    path = saved(tmp_path, joints=joints(4), joint_names=NAMES)
    read = read_joints_npz(path, np.arange(10, 14))
    assert np.array_equal(read.joints, joints(4))
    assert read.joint_names == ("left_hip", "right_hip")


def test_rows_of_a_whole_video_are_picked_by_frame(tmp_path):
    path = saved(tmp_path, joints=joints(20), joint_names=NAMES)
    assert np.array_equal(read_joints_npz(path, np.arange(10, 14)).joints, joints(20)[10:14])


def test_the_file_may_say_which_frames_it_has(tmp_path):
    path = saved(tmp_path, joints=joints(3), joint_names=NAMES, frames=[9, 5, 7])
    assert np.array_equal(read_joints_npz(path, np.array([5, 9])).joints, joints(3)[[1, 0]])


def test_frames_that_are_not_there_are_named(tmp_path):
    path = saved(tmp_path, joints=joints(12), joint_names=NAMES)
    with pytest.raises(ValueError, match=r"got 12 rows and none for frame 12 \(2 missing\)"):
        read_joints_npz(path, np.arange(10, 14))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"joint_names": NAMES}, r"joints: expected an array \(T, J, 3\), it is missing"),
        ({"joints": np.zeros((4, 6)), "joint_names": NAMES}, r"joints: .* got float64 \(4, 6\)"),
        ({"joints": np.zeros((4, 2, 3))}, "joint_names: expected 2 names, got nothing"),
        ({"joints": np.zeros((4, 2, 3)), "joint_names": NAMES[:1]}, "expected 2 names"),
    ],
)
def test_wrong_joints_are_named(tmp_path, arrays, message):
    with pytest.raises(ValueError, match=message):
        read_joints_npz(saved(tmp_path, **arrays), np.arange(4))


def test_a_file_that_is_no_npz_is_refused(tmp_path):
    path = tmp_path / "v1.npz"
    with pytest.raises(ValueError, match="no such file"):
        read_joints_npz(path, np.arange(4))
    np.save(tmp_path / "one.npy", np.zeros(3))
    for content in (b"not an archive", b"", (tmp_path / "one.npy").read_bytes()):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="is not a readable npz"):
            read_joints_npz(path, np.arange(4))


def test_smpl_reads_what_export_writes(tmp_path):
    rng = np.random.default_rng(0)
    poses, trans = rng.normal(size=(5, 72)), rng.normal(size=(5, 3))
    R = np.diag([1.0, -1.0, -1.0])
    shape_and_camera = {"betas": np.arange(10.0), "R": R, "t": np.ones(3)}
    path = saved(tmp_path, poses=poses, trans=trans, frames=[2, 3, 4, 5, 6], **shape_and_camera)
    read = read_smpl_npz(path, np.array([3, 4]))
    assert np.array_equal(read.theta, poses[1:3])
    assert np.array_equal(read.trans, trans[1:3])
    assert np.array_equal(read.R, R)
    assert read.betas.tolist() == list(range(10))


def test_smpl_h_keeps_the_body_and_rests_the_hands(tmp_path):
    poses = np.ones((3, 156))
    path = saved(tmp_path, poses=poses, trans=np.zeros((3, 3)), betas=np.ones((3, 16)))
    read = read_smpl_npz(path, np.arange(3))
    assert (read.theta[:, :66] == 1).all()
    assert (read.theta[:, 66:] == 0).all()
    assert read.betas.shape == (10,)
    assert np.array_equal(read.R, np.eye(3))


def test_wrong_smpl_is_named(tmp_path):
    path = saved(tmp_path, poses=np.zeros((3, 70)), trans=np.zeros((3, 3)))
    with pytest.raises(ValueError, match="poses: expected 72 or 156 columns, got 70"):
        read_smpl_npz(path, np.arange(3))
    path = saved(tmp_path, poses=np.zeros((3, 72)), trans=np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"trans: expected numbers of shape \(3, 3\)"):
        read_smpl_npz(path, np.arange(3))


def test_any_part_of_the_truth_may_be_missing(tmp_path):
    first = {"v1/joints": joints(4), "v1/phase": np.arange(4.0)}
    path = saved(tmp_path, **first, joint_names=NAMES, **{"v2/K": np.eye(3)}, phase_end=3.0)
    truth = read_truth(path, {video: np.arange(4) for video in ("v1", "v2", "v3")})
    assert truth.phase_end == 3.0
    assert truth.videos["v1"].joints.shape == (4, 2, 3)
    assert truth.videos["v1"].K is None
    assert np.array_equal(truth.videos["v2"].K, np.eye(3))
    assert truth.videos["v3"].phase is None


def test_wrong_truth_is_named(tmp_path):
    path = saved(tmp_path, **{"v1/R": np.eye(4)})
    with pytest.raises(ValueError, match=r"v1/R: expected numbers of shape \(3, 3\)"):
        read_truth(path, {"v1": np.arange(4)})


def test_truth_of_a_whole_video_serves_a_part_of_it(tmp_path):
    used = np.array([3, 4])
    turned = Rotation.from_rotvec(np.outer(np.arange(6), [0.0, 0.2, 0.0])).as_matrix()
    centre = np.array([1.0, 2.0, 3.0])
    whole = {
        "v1/joints": joints(6),
        "v1/phase": np.arange(6.0),
        "v1/R_frames": turned,
        "v1/R": turned[0],
        "v1/t": -turned[0] @ centre,
    }
    truth = read_truth(saved(tmp_path, **whole, joint_names=NAMES), {"v1": used}).videos["v1"]
    assert np.array_equal(truth.joints, joints(6)[used])
    assert truth.phase.tolist() == [3.0, 4.0]
    assert np.array_equal(truth.R, turned[3])
    np.testing.assert_allclose(-truth.R.T @ truth.t, centre)
    listed = {"v1/phase": np.array([7.0, 8.0, 9.0]), "v1/frames": np.array([2, 3, 4])}
    truth = read_truth(saved(tmp_path, **listed), {"v1": used}).videos["v1"]
    assert truth.phase.tolist() == [8.0, 9.0]
    with pytest.raises(ValueError, match="none for frame 5"):
        read_truth(saved(tmp_path, **listed), {"v1": np.array([4, 5])})
