"""The tai chi clips: hands that open, point and close, and their simulated detections."""

import numpy as np
import pytest

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.hands.hand_skeleton import hand_skeleton
from imocap_core.io.readers.json_people import read_openpose, read_openpose_hands
from imocap_core.pipeline import make_demo as demo
from imocap_core.synthetic import taichi
from imocap_core.synthetic.yoga_clip import DemoClip

SEED, INDEX = 3, 2


@pytest.fixture(scope="module")
def clip() -> DemoClip:
    return taichi.make_taichi_clip(SEED, INDEX, taichi.taichi_body(SEED))


def test_the_form_has_hands_at_every_key_within_their_ranges() -> None:
    assert len(taichi.HANDS) == len(taichi.TAI_CHI)
    assert {name for pair in taichi.HANDS for name in pair} == set(taichi.HAND_POSES)
    skeleton = hand_skeleton(taichi.taichi_body(SEED))
    for pose in taichi.HAND_POSES.values():
        assert (np.deg2rad(pose) <= skeleton.upper.numpy() + 1e-9).all()
        assert (np.deg2rad(pose) >= skeleton.lower.numpy() - 1e-9).all()


def test_hands_hang_on_the_wrists_and_close(clip: DemoClip) -> None:
    wrists = clip.joints[:, [SMPL_JOINTS.index(f"{s}_wrist") for s in ("left", "right")]]
    assert np.abs(clip.hands.points_m[:, :, 0] - wrists).max() < 1e-6
    reach = np.linalg.norm(clip.hands.points_m[:, :, 12] - clip.hands.points_m[:, :, 0], axis=-1)
    assert (reach.max(axis=0) > 1.8 * reach.min(axis=0)).all()  # from open hands to fists


def test_the_planted_foot_stays_and_the_person_is_in_the_picture(clip: DemoClip) -> None:
    ball = clip.joints[:, SMPL_JOINTS.index("right_foot")]
    assert np.ptp(ball, axis=0).max() < 0.08
    assert (clip.xy_px > 0).all()
    assert (clip.xy_px < taichi.SIZE).all()


def test_the_same_seed_gives_the_same_hands(clip: DemoClip) -> None:
    again = taichi.make_taichi_clip(SEED, INDEX, taichi.taichi_body(SEED))
    assert np.array_equal(clip.hands.detections.xy_px, again.hands.detections.xy_px)


def test_readers_find_the_hands_with_the_performer(clip: DemoClip, tmp_path) -> None:
    demo.write_keypoints(tmp_path / "v3", "v3", clip)
    frames = np.arange(taichi.TAICHI_SPANS[INDEX].frames)
    assert len(read_openpose(tmp_path / "v3", "body25").frames) == len(frames)
    body = np.where(clip.detections.confidence[..., None] > 0, clip.detections.xy_px, np.nan)
    hands = read_openpose_hands(tmp_path / "v3", frames, body)
    expected = clip.hands.detections
    assert np.allclose(hands[1], expected.confidence, atol=1e-4)
    visible = expected.confidence > 0
    assert 0.6 < visible.mean() < 0.99
    assert np.allclose(hands[0][visible], expected.xy_px[visible], atol=1e-4)
