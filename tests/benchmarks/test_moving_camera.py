"""The films of moving cameras are what they say, and their tables count them."""

import numpy as np
import pytest

from benchmarks.synthetic.moving_yoga import every_frame, make_moving_clip, moving_pictures
from benchmarks.synthetic.walking_cameras import CameraWalk, walk_camera
from imocap_core.pipeline.make_demo import demo_body
from imocap_core.synthetic.cameras import CameraPlacement

PATH = np.tile([0.0, 0.0, 0.9], (60, 1))
VIEW = CameraPlacement(30.0, 4.5, 1.4, 1.0)


@pytest.mark.parametrize("metres", [-2.0, 0.5])
def test_a_camera_walks_as_far_as_it_is_said_to(metres):
    rng = np.random.default_rng(1)
    camera = walk_camera(VIEW, CameraWalk(metres, 0.3), PATH, 25.0, (320, 180), rng)
    steps = np.diff(camera.centres[:, :2], axis=0)
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(np.hypot(metres, 0.3), rel=0.05)
    assert np.linalg.norm(camera.centres[-1, :2]) == pytest.approx(4.2)
    there_and_back = walk_camera(
        VIEW, CameraWalk(metres, bend=1.0, bob=False), PATH, 25.0, (320, 180), rng
    )
    np.testing.assert_allclose(there_and_back.centres[0], there_and_back.centres[-1], atol=1e-9)


def test_a_tripod_stays_on_its_spot():
    rng = np.random.default_rng(2)
    camera = walk_camera(VIEW, CameraWalk(0.0, bob=False), PATH, 25.0, (320, 180), rng)
    assert np.ptp(camera.centres, axis=0).max() < 1e-9


def test_a_film_shows_the_performer_where_the_true_keypoints_are():
    """The picture with the performer differs from an empty one near the keypoints alone."""
    shaped = demo_body(3)
    clip = every_frame(make_moving_clip(3, 1, shaped, CameraWalk(1.0), (320, 180)), 40)
    frames = list(moving_pictures(clip, 3, 1, shaped))
    assert len(frames) == len(clip.xy_px)
    assert frames[0].shape == (180, 320, 3)
    apart = clip.camera.centres[-1] - clip.camera.centres[0]
    assert 0.5 < np.linalg.norm(apart) < 1.1
    assert ((clip.xy_px > 0) & (clip.xy_px < (320, 180))).all()
