"""The camera of every frame, where it moves: one projection, however it is read."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.adapters.participants import mirrored_camera
from imocap_core.adapters.relative_motion import paths_of, relative_motions
from imocap_core.artifacts.schemas import Camera, VideoMotion
from imocap_core.camera.projection import Lens, intrinsics, project
from imocap_core.result.video import VideoCamera

FRAMES, SIZE = 6, (480, 270)
K = intrinsics(450.0, SIZE)
TURNS = Rotation.from_rotvec(np.linspace([0, 0, 0], [0.02, 0.3, 0.01], FRAMES)).as_matrix()
PATH = np.linspace([0, 0, 0], [0.8, -0.1, 0.4], FRAMES)
R = Rotation.from_rotvec([0.1, 0.7, -0.05]).as_matrix()
T = np.array([0.2, 0.1, 4.0])


def camera(path_m: np.ndarray | None) -> VideoCamera:
    H = K @ TURNS @ np.linalg.inv(K)
    return VideoCamera("v1", SIZE, K, R, T, TURNS, np.ones(FRAMES), H, path_m)


def test_its_frames_project_as_it_does():
    points = np.random.default_rng(1).normal(0, 0.5, (FRAMES, 7, 3))
    for moving in (camera(PATH), camera(None)):
        frames = (moving.K_per_frame, moving.R_per_frame, moving.t_per_frame)
        pixels = [project(x, *of_frame) for x, *of_frame in zip(points, *frames, strict=True)]
        np.testing.assert_allclose(moving.project(points), pixels, atol=1e-8)
        some = np.array([0, 4])
        np.testing.assert_allclose(moving.project(points[some], some), np.array(pixels)[some])


def test_a_lens_is_drawn_and_belongs_to_its_focal_length():
    points, pinhole = np.random.default_rng(1).normal(0, 0.5, (7, 3)), camera(None)
    lens = Lens.of([-0.2, 0.05], intrinsics(400.0, SIZE))
    bent = replace(pinhole, lens=lens)
    np.testing.assert_allclose(bent.project(points), lens.distorted(pinhole.project(points)))
    assert bent.distortion[0] == pytest.approx(-0.2 * (450 / 400) ** 2)
    assert bent.distortion_at(intrinsics(400.0, SIZE)) == pytest.approx([-0.2, 0.05, 0, 0, 0])
    assert not pinhole.distortion.any()


def test_it_starts_in_its_first_place_and_walks_its_path():
    places = camera(PATH).centre_per_frame
    np.testing.assert_allclose(places[0], camera(None).centre)
    np.testing.assert_allclose(
        np.linalg.norm(places - places[0], axis=1), np.linalg.norm(PATH, axis=1)
    )
    assert not camera(PATH).is_static


def test_a_motion_relative_to_the_camera_is_seen_from_its_first_place():
    joints = np.random.default_rng(2).normal(0, 0.3, (FRAMES, 24, 3)) + (0, 0, 4)
    motion = VideoMotion(
        id="v1", frames=np.arange(FRAMES), theta=np.zeros((FRAMES, 72)), betas=np.zeros(10),
        trans=joints[:, 0], joints=joints, reprojection_px=np.zeros(FRAMES),
    )  # fmt: skip
    solved = Camera(id="v1", K=K, R=R, t=T, path_m=PATH)
    moved = relative_motions([motion], paths_of([solved]))[0]
    np.testing.assert_allclose(moved.joints, joints - PATH[:, None])
    assert relative_motions([motion], {}) == [motion]


def test_a_mirrored_path_is_that_of_the_mirror_image():
    solved = Camera(id="v1", K=K, R=R, t=T, path_m=PATH)
    np.testing.assert_allclose(mirrored_camera(solved).path_m, PATH * (-1, 1, 1))
    np.testing.assert_allclose(mirrored_camera(mirrored_camera(solved)).path_m, PATH)
