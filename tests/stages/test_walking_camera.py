"""The stage camera_motion on a film whose camera walks, with the extra and without it."""

from importlib.util import find_spec

import numpy as np
import pytest

from benchmarks.synthetic import moving_yoga
from imocap_core.adapters import camera_motion as moving_camera
from imocap_core.alignment import similarity
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.io.video import write_h264
from imocap_core.params import CameraMotionParams, Params
from imocap_core.pipeline.make_demo import demo_body
from tests.made_keypoints import made_keypoints
from tests.stages.test_camera_motion import run

SIZE = (400, 226)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """The folder of a film, its keypoints, and the clip."""
    folder, shaped = tmp_path_factory.mktemp("walk"), demo_body(5)
    clip = moving_yoga.every_frame(
        moving_yoga.make_moving_clip(5, 0, shaped, moving_yoga.CameraWalk(1.2), SIZE), 4
    )
    write_h264(folder / "v1.mp4", moving_yoga.moving_pictures(clip, 5, 0, shaped), clip.fps, crf=16)
    xy_px = clip.xy_px
    video = made_keypoints(
        np.arange(len(xy_px)), fps=clip.fps, size=SIZE, video="v1.mp4", xy_px=xy_px,
        confidence=np.ones(xy_px.shape[:2]),
        person_box_px=np.concatenate([xy_px.min(axis=1), xy_px.max(axis=1)], axis=1),
    )  # fmt: skip
    return folder, Keypoints(videos=[video]), clip


@pytest.mark.skipif(find_spec("pycolmap") is None, reason="needs the extra `moving` (pycolmap)")
def test_a_walk_has_its_path_and_focal_length(film):
    folder, keypoints, clip = film
    camera = run(folder, keypoints, Params())
    true = clip.camera.centres
    assert (camera.motion, camera.focal_source) == ("translating", "structure")
    assert camera.K[0, 0] == pytest.approx(clip.camera.K[0, 0], rel=0.03)
    fit = similarity(camera.path, true)
    placed = fit.scale * camera.path @ fit.R_target_from_source.T + fit.t_target
    assert np.linalg.norm(placed - true, axis=1).max() < 0.04
    assert "path was reconstructed" in camera.note


@pytest.mark.parametrize("wanted", [True, False])
def test_without_the_extra_or_its_use_a_walk_is_told_all_the_same(film, monkeypatch, wanted):
    folder, keypoints, _ = film
    monkeypatch.setattr(moving_camera, "colmap_installed", lambda: False)
    params = Params(camera_motion=CameraMotionParams(structure=wanted))
    camera = run(folder, keypoints, params)
    assert camera.motion == "translating"
    assert not len(camera.path)
    assert "parallax" in camera.note
    assert ("pip install 'imocap[moving]'" in camera.note) == wanted
