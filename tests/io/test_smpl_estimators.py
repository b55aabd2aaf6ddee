"""Files of AMASS's kind and of truth: the archive's names and shapes, no shape numbers of another
body, and read by aitviewer, which needs IMOCAP_AITVIEWER: an interpreter that has it."""

import ast
import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WrongUse
from imocap_core.export.npz_files import write_amass
from imocap_core.files import has_pose2sim_truth
from imocap_core.io.readers.estimates import read_joints_npz
from imocap_core.io.readers.smpl_estimators import read_smpl_npz
from imocap_core.io.truth import project_name, read_pose2sim_truth, read_truth
from imocap_core.pipeline.action import Action
from imocap_core.pipeline.source import PROJECT, closure
from imocap_core.result.body import posed_joints
from tests.pipeline.made_result import BETAS, FPS, LENGTHS, Made, made_result

AITVIEWER = os.environ.get("IMOCAP_AITVIEWER")
READER = Path(__file__).resolve().parents[2] / "tools" / "aitviewer_joints.py"
SHARED = {"trans": ("T", 3), "betas": (16,), "gender": ()}
# What AMASS's files have: SMPL+H of 2019, SMPL-X of 2021.
ARCHIVE = {
    "poses": SHARED | {"poses": ("T", 156), "dmpls": ("T", 8), "mocap_framerate": ()},
    "stageii": SHARED
    | {"poses": ("T", 165), "root_orient": ("T", 3), "pose_body": ("T", 63), "num_betas": ()}
    | {"pose_jaw": ("T", 3), "pose_eye": ("T", 6), "pose_hand": ("T", 90)}
    | {"mocap_frame_rate": (), "mocap_time_length": (), "surface_model_type": ()},
    "smpl": SHARED | {"poses": ("T", 72), "betas": (10,), "mocap_framerate": ()},
}
KIND = {"poses": "smplh", "stageii": "smplx", "smpl": "smpl"}
PARTS = {
    "poses": ("root_orient", "pose_body", "pose_hand"),
    "stageii": ("root_orient", "pose_body", "pose_jaw", "pose_eye", "pose_hand"),
    "smpl": ("root_orient", "pose_body"),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    made = made_result(tmp_path_factory.mktemp("amass"))
    made.export("amass")
    return made


def arrays(made: Made, video: str, generation: str = "poses") -> dict[str, np.ndarray]:
    with np.load(made.out / f"{video}_{generation}.npz", allow_pickle=False) as data:
        return dict(data)


@pytest.mark.parametrize("generation", ARCHIVE)
@pytest.mark.parametrize("video", LENGTHS)
def test_names_and_shapes_are_the_archives(made: Made, video: str, generation: str) -> None:
    data = arrays(made, video, generation)
    T = LENGTHS[video]
    for name, shape in ARCHIVE[generation].items():
        assert data[name].shape == tuple(T if n == "T" else n for n in shape), name
    parts = [data[name] for name in PARTS[generation]]
    np.testing.assert_array_equal(np.concatenate(parts, axis=1), data["poses"])
    assert data["gender"].item() == "neutral"
    assert data["surface_model_type"] == KIND[generation]
    assert data["mocap_framerate"] == data["mocap_frame_rate"] == FPS[video]
    assert round(float(data["mocap_time_length"] * data["mocap_frame_rate"])) == T


def test_both_bodies_have_one_pose(made: Made) -> None:
    smplh, smplx = (arrays(made, "b", g)["poses"].reshape(21, -1, 3) for g in KIND if g != "smpl")
    assert smplh[:, :22].any()
    assert not smplx[:, 22:25].any()  # jaw and eyes
    np.testing.assert_array_equal(np.delete(smplx, range(22, 25), axis=1), smplh)


def test_hands_are_of_the_videos_that_have_them(tmp_path: Path) -> None:
    turns = np.random.default_rng(0).normal(size=(4, 156))
    arrays = {"poses": np.ones((4, 72)), "trans": np.zeros((4, 3)), "fps": np.float64(30)}
    arrays |= {"betas": BETAS, "joints": np.zeros((4, 24, 3))}
    arrays |= {"joint_names": np.array(SMPL_JOINTS), "model": np.array("free_body d")}
    files = write_amass(tmp_path, "v", arrays | {"poses_smplh": turns})
    smplh, smplx, smpl = (np.load(file)["poses"] for file in files)
    np.testing.assert_array_equal(smpl, arrays["poses"])
    np.testing.assert_array_equal(smplh, turns)
    np.testing.assert_array_equal(np.delete(smplx, range(66, 75), axis=1), turns)
    assert not np.load(write_amass(tmp_path, "v", arrays)[0])["pose_hand"].any()


def test_our_shape_reaches_no_other_body(made: Made) -> None:
    data = arrays(made, "a")
    assert not data["betas"].any()
    assert not arrays(made, "a", "stageii")["betas"].any()
    assert not arrays(made, "a", "smpl")["betas"].any()
    np.testing.assert_allclose(data["imocap_betas"], BETAS)
    assert data["imocap_model"].item().startswith("free_body ")
    assert "imocap_betas" in json.loads((made.out / "export_amass.json").read_text())["betas"]


def test_the_pose_through_our_body_gives_the_joints_z_up(made: Made) -> None:
    data = arrays(made, "b")
    model = load_free_body(hands=True)
    joints = posed_joints(model, data["imocap_betas"], data["poses"], data["trans"])
    np.testing.assert_allclose(joints[:, :22], data["imocap_joints"][:, :22], atol=1e-6)
    head, foot = (joints[:, SMPL_JOINTS.index(name), 2] for name in ("head", "left_foot"))
    assert (head - foot).min() > 1.2


def test_our_own_reader_takes_it(made: Made) -> None:
    read = read_smpl_npz(made.out / "b_poses.npz", np.arange(100, 121))
    assert read.theta.shape == (21, 72)
    assert not read.betas.any()


def test_y_up_is_refused(made: Made) -> None:
    with pytest.raises(WrongUse, match="z up"):
        made.export("amass", up="y")


@pytest.mark.skipif(AITVIEWER is None, reason="IMOCAP_AITVIEWER names no interpreter with it")
def test_aitviewer_reads_it(made: Made, tmp_path: Path) -> None:
    """With our body in the place of SMPL+H's, whose files have a licence of their own."""
    model = load_free_body(hands=True)
    (tmp_path / "smplh").mkdir()
    np.savez_compressed(
        tmp_path / "smplh" / "SMPLH_FEMALE.npz",
        v_template=model.v_template.numpy(), shapedirs=model.shapedirs.numpy(),
        posedirs=np.zeros((*model.v_template.shape, 459), np.float32),
        J_regressor=model.J_regressor.numpy(), weights=model.weights.numpy(),
        kintree_table=np.array([model.parents, range(52)]), f=model.faces.numpy(),
        hands_meanl=np.zeros(45), hands_meanr=np.zeros(45),
        hands_componentsl=np.eye(45), hands_componentsr=np.eye(45),
    )  # fmt: skip
    file, out = made.out / "b_poses.npz", tmp_path / "joints.npy"
    command = [str(AITVIEWER), str(READER), str(file), str(tmp_path), str(out)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    data = arrays(made, "b")
    ours = posed_joints(model, np.zeros(10), data["poses"], data["trans"])
    np.testing.assert_allclose(np.load(out), ours[:, :22], atol=1e-5)  # it keeps the body's


def saved(tmp_path, **arrays):
    path = tmp_path / "v1.npz"
    np.savez(path, **arrays)
    return path


def joints(count):
    return np.arange(count * 6, dtype=np.float32).reshape(count, 2, 3)


NAMES = np.array(["left_hip", "right_hip"])


@pytest.mark.parametrize(
    ("count", "frames", "used", "rows"),
    [
        (4, None, range(10, 14), [0, 1, 2, 3]),  # as many as used frames
        (20, None, range(10, 14), [10, 11, 12, 13]),  # of the whole video
        (3, [9, 5, 7], [5, 9], [1, 0]),
    ],
)
def test_rows_are_those_of_the_used_frames(tmp_path, count, frames, used, rows):
    listed = {} if frames is None else {"frames": frames}
    path = saved(tmp_path, joints=joints(count), joint_names=NAMES, **listed)
    read = read_joints_npz(path, np.array(used))
    assert np.array_equal(read.joints, joints(count)[rows])
    assert read.joint_names == ("left_hip", "right_hip")


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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    xyz = np.arange(5 * 2 * 3, dtype=np.float32).reshape(5, 2, 3)
    np.savez(tmp_path / "trc_reference.npz", xyz_zup_m=xyz, names=np.array(["RHip", "Head"]))
    eye = np.tile(np.eye(3), (2, 1, 1))
    eye[1] *= -1
    np.savez(
        tmp_path / "calibration.npz", K=eye, R=eye, t=np.ones((2, 3)), cams=np.array(["b", "a"])
    )
    return tmp_path


def test_rows_are_source_frame_numbers_and_phases(folder: Path) -> None:
    truth = read_pose2sim_truth(folder, {"a": np.array([1, 2]), "b": np.array([3, 4, 5])})
    a, b = truth.videos["a"], truth.videos["b"]
    np.testing.assert_array_equal(a.joints[:, 0, 0], [6, 12])
    np.testing.assert_array_equal(a.phase, [1, 2])
    np.testing.assert_array_equal(np.isnan(b.joints[:, 0, 0]), [False, False, True])
    assert truth.phase_end == 4
    assert a.joint_names == ("right_hip", "head_top")


def test_cameras_follow_their_ids_not_their_order(folder: Path) -> None:
    truth = read_pose2sim_truth(folder, {"a": np.array([1]), "c": np.array([1])})
    np.testing.assert_array_equal(truth.videos["a"].R, -np.eye(3))
    assert truth.videos["c"].R is None


def test_marker_names() -> None:
    assert project_name("RBigToe") == "right_big_toe"
    assert project_name("LWrist") == "left_wrist"
    assert project_name("Nose") == "nose"
    assert project_name("Neck") == "upper_neck"


def test_recognised_only_as_a_pair(folder: Path) -> None:
    assert has_pose2sim_truth(folder)
    (folder / "calibration.npz").unlink()
    assert not has_pose2sim_truth(folder)


def test_a_wrong_field_is_named(folder: Path) -> None:
    np.savez(folder / "trc_reference.npz", names=np.array(["RHip"]))
    with pytest.raises(ValueError, match=r"trc_reference.*xyz_zup_m"):
        read_pose2sim_truth(folder, {"a": np.array([1])})


def test_a_stage_that_scores_depends_on_both_files(folder: Path) -> None:
    action = Action(folder, "rig", ())
    assert action.truth_files == ("calibration.npz", "trc_reference.npz")
    assert Action(folder, "rig", (), truth="mine.npz").truth_files == ("mine.npz",)
    (folder / "trc_reference.npz").unlink()
    assert not action.truth_files


READERS = {"imocap_core.io.truth"}
GRAPH = yaml.safe_load((PROJECT / "pipeline.yaml").read_text())["stages"]
BEFORE = [PROJECT / spec["script"] for name, spec in GRAPH.items() if name != "evaluate"]


def test_the_graph_gives_it_to_evaluate_alone() -> None:
    assert [name for name, spec in GRAPH.items() if "truth" in spec["reads"]] == ["evaluate"]


@pytest.mark.parametrize("script", BEFORE, ids=lambda script: script.stem)
def test_no_earlier_stage_reaches_a_reader_of_it(script: Path) -> None:
    assert READERS.isdisjoint(closure(script))


@pytest.mark.parametrize("script", BEFORE, ids=lambda script: script.stem)
def test_no_earlier_stage_names_it(script: Path) -> None:
    named = {
        node.attr if isinstance(node, ast.Attribute) else node.value
        for node in ast.walk(ast.parse(script.read_text()))
        if isinstance(node, ast.Attribute)
        or (isinstance(node, ast.Constant) and node.value in ("truth", "truth.npz"))
    }
    assert named.isdisjoint({"truth", "truth.npz"})


def test_evaluate_does() -> None:
    found = closure(PROJECT / GRAPH["evaluate"]["script"])
    assert not READERS.isdisjoint(found)
