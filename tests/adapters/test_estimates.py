"""The stage initial_smpl: an estimator's result becomes a start where the keypoints are."""

from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import torch

from imocap_core.adapters.estimates import estimate_of
from imocap_core.adapters.monocular import starts
from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.body import load_free_body
from imocap_core.body.layouts import layouts
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.readers.keypoint_readers import FORMATS
from imocap_core.io.readers.smpl_estimators import JOINT_READERS, ROTATIONS
from imocap_core.motion.monocular.starts import make_library
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body
from imocap_core.params import InitialSmplParams
from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.format_names import DetectionFormat, InitialFormat, Layout
from imocap_core.pipeline.stage import Context
from imocap_core.rotations import exp
from tests.io import made_estimates as made
from tests.made_keypoints import made_keypoints

WRITERS = {
    "hmr2": made.write_phalp,
    "wham": made.write_wham,
    "vibe": made.write_vibe,
    "hmmr": made.write_hmmr,
    "tram": made.write_tram,
    "sam3d_body": made.write_sam3d_body,
    "mediapipe_world": made.write_mediapipe,
}
PLACE_OF_KNEE = {"sam3d_body": (11, 70), "mediapipe_world": (25, 33)}
# Each frame's camera is turned a little further from the first one's.
TURNED = exp(torch.arange(made.FRAMES)[:, None] * torch.tensor([0.0, 0.1, 0.05])).double().numpy()


def video(kind: str, frames: int = made.FRAMES) -> VideoKeypoints:
    box = made.PERFORMER.box_px[np.minimum(np.arange(frames), made.FRAMES - 1)]
    return made_keypoints(
        np.arange(frames), size=made.SIZE, initial="given", initial_format=kind,
        confidence=np.ones((frames, 25)), person_box_px=box,
    )  # fmt: skip


def given(folder: Path, kind: str, path: Path, frames: int = made.FRAMES) -> Any:
    declared = {"id": "v1", "keypoints": "k", "fps": 30.0, "size": made.SIZE}
    declared |= {"initial": path.name, "initial_format": kind}
    context = Context(
        stage="initial_smpl", seed=0, reads=frozenset(("initial",)),
        progress=lambda share, what: None, report=folder,
        _action=Action(folder, "made", (Declaration(**declared),)),
    )  # fmt: skip
    return estimate_of(context, video(kind, frames), torch.as_tensor(TURNED))


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_arrives(kind: str, tmp_path: Path) -> None:
    found = given(tmp_path, kind, WRITERS[kind](tmp_path))
    if isinstance(found, torch.Tensor):
        expected = made.PERFORMER.R.copy()
        expected[:, 0] = TURNED @ expected[:, 0]
        np.testing.assert_allclose(found.numpy(), expected, atol=1e-5)
    else:
        known = np.isfinite(found).all(axis=(0, 2))
        assert known.sum() in (12, 13, 24)
        knee, place, count = SMPL_JOINTS.index("left_knee"), *PLACE_OF_KNEE[kind]
        expected = np.einsum("tij,tj->ti", TURNED, made.joints_of(made.PERFORMER, count)[:, place])
        np.testing.assert_allclose(found[:, knee], expected, atol=1e-9)


def test_the_projects_own_joints_are_in_the_first_cameras_axes(tmp_path: Path) -> None:
    joints = made.joints_of(made.PERFORMER, 8)
    np.savez(tmp_path / "joints.npz", joints=joints, joint_names=np.array(SMPL_JOINTS[:8]))
    found = given(tmp_path, "joints_npz", tmp_path / "joints.npz")
    np.testing.assert_array_equal(found[:, :8], joints)


def test_frames_without_an_estimate_lie_between_their_neighbours(tmp_path: Path) -> None:
    """Frame 2 is missing: half way from 1 to 3."""
    path = made.write_wham(tmp_path, frame_ids=np.array([0, 1, 20, 3, 4, 5]))
    found = given(tmp_path, "wham", path)
    ahead = found[1].transpose(-1, -2) @ found[2]
    torch.testing.assert_close(ahead, found[2].transpose(-1, -2) @ found[3], atol=1e-5, rtol=0)
    assert found.isfinite().all()


def test_what_action_yaml_may_name_is_read_and_nothing_else_is() -> None:
    assert set(get_args(InitialFormat)) == {"smpl_npz", *JOINT_READERS, *ROTATIONS}
    assert set(get_args(DetectionFormat)) == set(FORMATS)
    assert set(get_args(Layout)) <= set(layouts())


def test_the_body_is_placed_where_the_keypoints_are() -> None:
    """Rotations alone: depth and place come from the picture."""
    body = Body.of(load_free_body(), "body25")
    theta = 0.1 * np.random.default_rng(0).normal(size=(8, 24, 3))
    R_local = exp(torch.as_tensor(theta))
    R_local[:, 0] = exp(torch.tensor([np.pi, 0.0, 0.0], dtype=torch.float64)) @ R_local[:, 0]
    trans = torch.tensor([0.3, 0.1, 4.0], dtype=torch.float64).expand(8, 3)
    xyz = (
        body.model.shape(torch.zeros(1, 10).double()).pose(R_local, trans).keypoints(body.keypoints)
    )
    K = np.array([[600.0, 0, 320], [0, 600.0, 180], [0, 0, 1]])
    xy = (xyz / xyz[..., 2:]).numpy() @ K.T
    observation = Observation(xy[..., :2], np.ones(xy.shape[:2]), K, 30.0, noise_share=0.01)
    prior = load_pose_prior()
    library = make_library(body, prior, np.random.default_rng(0), poses=2, directions=2)
    (start,) = starts(body, library, observation, R_local, None, None, InitialSmplParams())
    assert torch.equal(start.R_local, R_local)
    assert float((start.trans - trans).norm(dim=-1).max()) < 0.25  # weak perspective, 4 m away
