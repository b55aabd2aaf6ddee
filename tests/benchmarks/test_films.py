"""Rendered films, of fixed cameras and of walking ones, and the benchmark from them: the ground
truth agrees with the video."""

from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.actions.captured_videos import CapturedVideo
from benchmarks.rendered import measure, proposal
from benchmarks.rendered_action import RenderedChoice, _with_body_joints, key_of, true_pose
from benchmarks.synthetic import films, moving_yoga
from benchmarks.synthetic.films import FilmedMotion
from benchmarks.synthetic.retargeting import RetargetedMotion
from imocap_core.body import Shaped, load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WrongUse
from imocap_core.pipeline.make_demo import demo_body
from imocap_core.rotations import exp
from imocap_core.synthetic.cameras import CameraPlacement
from imocap_core.workspace import Workspace
from tests.benchmarks.test_detector import NAMES, SPREAD, film

FRAMES = 8
SIZE = (160, 120)


@cache
def performer() -> Shaped:
    model = load_free_body(dtype=torch.float64)
    return model.shape(torch.zeros(model.num_betas, dtype=torch.float64))


def upright(turn_rad: float = 0.0) -> RetargetedMotion:
    """Stands with z up, lifts the left arm, bends the right knee; turned about z."""
    turns = torch.zeros(FRAMES, 24, 3, dtype=torch.float64)
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)
    turns[:, SMPL_JOINTS.index("left_shoulder"), 2] = 0.9 * time
    turns[:, SMPL_JOINTS.index("right_knee"), 0] = 1.0 * time
    turns[:, 0, 0] = np.pi / 2
    R_local = exp(turns)
    about_z = exp(torch.tensor([0.0, 0.0, turn_rad], dtype=torch.float64))
    R_local[:, 0] = about_z @ R_local[:, 0]
    transl = torch.zeros(FRAMES, 3, dtype=torch.float64)
    transl[:, 2] = 1.0
    return RetargetedMotion(R_local.numpy(), transl.numpy())


def joints_of(motion: RetargetedMotion, shaped: Shaped) -> np.ndarray:
    posed = shaped.pose(torch.as_tensor(motion.R_local), torch.as_tensor(motion.transl))
    return posed.joints.numpy()


@pytest.mark.parametrize(
    ("turn_deg", "side"), [(0, "front"), (90, "side"), (180, "back"), (-90, "side")]
)
def test_what_a_camera_sees(turn_deg: float, side: str) -> None:
    joints = joints_of(upright(np.deg2rad(turn_deg)), performer())
    R = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # from -y, z up
    assert films.viewed_side(joints, R, -R @ np.array([0.0, -4.0, 1.0])) == side


def test_feet_stand_on_the_floor_and_everything_is_in_the_picture() -> None:
    filmed = films.film_motion(upright(), performer(), CameraPlacement(35.0, 3.0, 1.4, 1.0), SIZE)
    xy_px, depth_m = films.true_points_px(filmed, performer(), "body33")
    assert ((xy_px > 0) & (xy_px < SIZE)).all()
    assert (depth_m > 1).all()
    ankles = filmed.joints[:, [SMPL_JOINTS.index("left_ankle")], 2]
    assert 0.02 < np.median(ankles) < 0.15
    lowered = filmed.motion.transl + [0, 0, filmed.floor_m]
    assert np.allclose(lowered, upright().transl)


def test_the_video_shows_the_body_at_its_stated_place() -> None:
    filmed = films.film_motion(upright(), performer(), CameraPlacement(35.0, 3.0, 1.4, 1.0), SIZE)
    first, *_, last = islice(films.render_frames(filmed, performer(), 1, 7), FRAMES)
    assert first.shape == (SIZE[1], SIZE[0], 3)
    again = next(films.render_frames(filmed, performer(), 1, 7))
    assert np.array_equal(first, again)
    xy_px, _ = films.true_points_px(filmed, performer(), "smpl24")
    wrist = SMPL_JOINTS.index("left_wrist")
    moved = np.abs(last.astype(int) - first).sum(axis=-1)
    x, y = np.rint(xy_px[-1, wrist]).astype(int)
    assert moved[y - 2 : y + 3, x - 2 : x + 3].mean() > 5 * np.median(moved)


@pytest.mark.parametrize("kind", range(films.KINDS))
def test_a_large_room_contains_performer_and_camera(kind: int) -> None:
    path, camera = np.array([[-1.0, 2.0, 0], [3.0, -1.0, 0]]), np.array([4.0, -5.0, 1.5])
    azimuth = float(np.rad2deg(np.arctan2(camera[0], -camera[1])))
    floor, *walls = films.large_room(kind, azimuth, path, camera, 7)
    inverse = np.linalg.pinv(np.column_stack([floor.along, floor.down]))
    extent = np.array(floor.texture.shape[1::-1]) / 150
    for point in (*path, camera * [1, 1, 0]):
        place = inverse @ (point - floor.corner)
        assert ((place > 0.9) & (place < extent - 0.9)).all()
    for wall in walls:
        assert np.isclose(wall.corner[2], films.HEIGHT_M)
        assert np.allclose(wall.down, [0, 0, -1])


PATH = np.tile([0.0, 0.0, 0.9], (60, 1))
VIEW = CameraPlacement(30.0, 4.5, 1.4, 1.0)


@pytest.mark.parametrize("metres", [-2.0, 0.5])
def test_a_camera_walks_as_far_as_it_is_said_to(metres):
    rng = np.random.default_rng(1)
    camera = moving_yoga.walk_camera(
        VIEW, moving_yoga.CameraWalk(metres, 0.3), PATH, 25.0, (320, 180), rng
    )
    steps = np.diff(camera.centres[:, :2], axis=0)
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(np.hypot(metres, 0.3), rel=0.05)
    assert np.linalg.norm(camera.centres[-1, :2]) == pytest.approx(4.2)
    there_and_back = moving_yoga.walk_camera(
        VIEW, moving_yoga.CameraWalk(metres, bend=1.0, bob=False), PATH, 25.0, (320, 180), rng
    )
    np.testing.assert_allclose(there_and_back.centres[0], there_and_back.centres[-1], atol=1e-9)


def test_a_tripod_stays_on_its_spot():
    rng = np.random.default_rng(2)
    camera = moving_yoga.walk_camera(
        VIEW, moving_yoga.CameraWalk(0.0, bob=False), PATH, 25.0, (320, 180), rng
    )
    assert np.ptp(camera.centres, axis=0).max() < 1e-9


def test_a_film_shows_the_performer_where_the_true_keypoints_are():
    """The picture with the performer differs from an empty one near the keypoints alone."""
    shaped = demo_body(3)
    clip = moving_yoga.every_frame(
        moving_yoga.make_moving_clip(3, 1, shaped, moving_yoga.CameraWalk(1.0), (320, 180)), 40
    )
    frames = list(moving_yoga.moving_pictures(clip, 3, 1, shaped))
    assert len(frames) == len(clip.xy_px)
    assert frames[0].shape == (180, 320, 3)
    apart = clip.camera.centres[-1] - clip.camera.centres[0]
    assert 0.5 < np.linalg.norm(apart) < 1.1
    assert ((clip.xy_px > 0) & (clip.xy_px < (320, 180))).all()


def test_the_proposal_gives_back_what_simulated_detections_were_made_with() -> None:
    from benchmarks.detection_errors import point_errors

    rng = np.random.default_rng(0)
    given = [replace(film(rng, 600), side=side) for side in ("front", "front", "back")]
    table = proposal(given, point_errors(given, NAMES), NAMES)
    rows = dict(line.strip("| ").split(" | ") for line in table.splitlines()[2:] if "|" in line)
    assert float(rows["noise"]) == pytest.approx(SPREAD, rel=0.1)
    assert float(rows["persistence_s"]) == pytest.approx(0.3, abs=0.15)
    assert float(rows["swap_rate"]) == 0
    assert float(rows["miss_rate"]) == 0


def test_the_truth_speaks_of_the_common_world_whatever_the_floor() -> None:
    """A joint of the film, in the common world, is where the captured one was."""
    rng = np.random.default_rng(1)
    captured = rng.normal(size=(5, 24, 3))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    shift = np.array([1.0, 2.0, 0.3])
    shot = CapturedVideo(captured[:, :14], np.arange(5.0), np.arange(5), 30.0, turn, shift)
    floor = 0.12
    filmed = FilmedMotion(
        RetargetedMotion(np.zeros((5, 24, 3, 3)), np.zeros((5, 3))), captured - [0, 0, floor],
        np.eye(3), np.eye(3), np.array([0.0, 0.0, 4.0]), (64, 48), 0.0, floor,
    )  # fmt: skip
    truth = _with_body_joints(shot, filmed).truth("v1", filmed.K, filmed.R, filmed.t)
    assert np.allclose(truth["v1/joints"], captured @ turn.T + shift)
    in_camera = truth["v1/joints"] @ truth["v1/R"].T + truth["v1/t"]
    assert np.allclose(in_camera, filmed.joints + filmed.t)


def test_the_true_pose_puts_the_body_at_its_true_joints() -> None:
    shaped = load_free_body().shape(0.5 * torch.ones(10, dtype=torch.float64))
    theta = 0.3 * torch.randn(4, 24, 3, generator=torch.Generator().manual_seed(1)).double()
    motion = RetargetedMotion(exp(theta).numpy(), np.linspace(0, 1, 12).reshape(4, 3))
    joints = shaped.pose(*map(torch.as_tensor, (motion.R_local, motion.transl))).joints.numpy()
    turn = exp(torch.tensor([0.1, 0.7, -0.4], dtype=torch.float64)).numpy()
    shift = np.array([0.2, -1.0, 3.0])
    shot = CapturedVideo(joints[:, :14], np.arange(4.0), np.arange(4), 30.0, turn, shift)
    pose = true_pose("v1", motion, shot, shaped, np.full(10, 0.5))
    R_local = exp(torch.as_tensor(pose["v1/theta"]).reshape(4, 24, 3))
    posed = shaped.pose(R_local, torch.as_tensor(pose["v1/trans"])).joints.numpy()
    np.testing.assert_allclose(posed, joints @ turn.T + shift, atol=1e-9)


def test_names_and_numbers_are_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(WrongUse, match="--videos: expected 1 to 4, got 5"):
        RenderedChoice(videos=5)
    folder = tmp_path / "trials"
    folder.mkdir()
    (folder / "one.npz").write_bytes(b"x")
    monkeypatch.setenv("IMOCAP_DATA", str(tmp_path))
    with pytest.raises(WrongUse, match="--only two: expected one of one"):
        measure(Workspace(tmp_path), RenderedChoice(only=("two",)), None)  # type: ignore[arg-type]


def test_an_action_is_named_by_what_it_is_made_of(tmp_path: Path) -> None:
    file = tmp_path / "one.npz"
    file.write_bytes(b"x")
    keys = {key_of("one", file, videos, small) for videos in (3, 4) for small in (True, False)}
    file.write_bytes(b"y")
    keys.add(key_of("one", file, 4, False))
    assert len(keys) == 5
