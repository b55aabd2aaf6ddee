"""The choreography and its performances, and the demo actions on disk; the tai chi clips' hands."""

from contextlib import nullcontext
from itertools import islice

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.body.model import rotations_from_pose
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.errors import WorkFailed
from imocap_core.executors.tasks import Serial
from imocap_core.hands.hand_skeleton import hand_skeleton
from imocap_core.io.readers.json_people import read_openpose, read_openpose_hands
from imocap_core.io.truth import read_truth
from imocap_core.io.video import probe
from imocap_core.pipeline import make_demo as demo
from imocap_core.pipeline.action import read_action
from imocap_core.synthetic import choreography, taichi
from imocap_core.synthetic.yoga import SUN_SALUTATION, local_rotations
from imocap_core.synthetic.yoga_clip import YOGA_SPANS, DemoClip, make_yoga_clip, pictures

INDEX = {name: i for i, name in enumerate(SMPL_JOINTS)}


def test_the_choreography_runs_from_mountain_to_mountain():
    times = [key.time_s for key in SUN_SALUTATION]
    assert times[0] == 0.0
    assert times[-1] == 6.0
    assert (np.diff(times) > 0.1).all()
    assert SUN_SALUTATION[0].name == SUN_SALUTATION[-1].name == "mountain"


@pytest.mark.parametrize("key", [k for k in SUN_SALUTATION if k.left == k.right], ids=str)
def test_a_pose_with_equal_legs_is_its_own_mirror_image(key):
    vectors = local_rotations(key).as_rotvec()
    np.testing.assert_allclose(
        vectors[list(mirror_indices(SMPL_JOINTS))] * [1, -1, -1], vectors, atol=1e-12
    )


def test_flat_soles_are_level():
    for key in SUN_SALUTATION:
        local = dict(zip(SMPL_JOINTS, local_rotations(key), strict=True))
        for side, leg in (("left", key.left), ("right", key.right)):
            if leg.flat:
                chain = [local[n] for n in ("pelvis", *(f"{side}_{j}" for j in ("hip", "knee")))]
                sole = chain[0] * chain[1] * chain[2] * local[f"{side}_ankle"]
                assert np.rad2deg(sole.magnitude()) == pytest.approx(abs(leg.ankle), abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_pace_is_monotone_non_linear_and_ends_where_it_should(seed):
    clip = choreography.PhaseSpan(frames=150, first=4.0, last=171.0, fps=30.0)
    phase = choreography.pace(clip, np.random.default_rng(seed))
    steps = np.diff(phase)
    assert phase.shape == (150,)
    assert phase[0] == 4.0
    assert phase[-1] == pytest.approx(171.0)
    assert (steps > 0.3).all()
    assert steps.max() < 3.0
    assert steps.max() / steps.min() > 1.3


def test_planting_puts_hands_and_feet_on_their_places(shaped):
    forward = choreography.contact_forward(shaped)
    rest = shaped.joints_rest.numpy()
    plan = choreography.contact_places(rest, float(shaped.vertices_rest[:, 1].min()))
    times = np.array([key.time_s for key in SUN_SALUTATION])
    targets = choreography.contact_targets(SUN_SALUTATION, plan, rest, times)
    guess = np.stack([local_rotations(key).as_matrix() for key in SUN_SALUTATION])
    hips = np.array([[0.0, *key.hips_m] for key in SUN_SALUTATION])
    rotations, pelvis = choreography.solve_contacts(forward, guess, hips, targets)
    xyz, _ = forward(rotations, pelvis)
    firm = targets.weight[..., 0] > 300
    assert firm.sum() > 60
    assert np.linalg.norm((xyz - targets.position)[firm], axis=-1).max() < 0.012
    turned = Rotation.from_matrix((np.swapaxes(guess, -1, -2) @ rotations).reshape(-1, 3, 3))
    assert np.rad2deg(turned.magnitude()).mean() < 8.0


def test_the_surface_touches_the_floor_and_does_not_sink_into_it(clips, shaped):
    for clip in clips:
        every = slice(None, None, 6)
        rotations = torch.as_tensor(clip.motion.R_local[every])
        vertices = shaped.pose(rotations, torch.as_tensor(clip.transl[every])).mesh().vertices
        lowest = vertices[..., 2].min(dim=1).values.numpy()
        assert lowest.min() > -0.045
        assert lowest.max() < 0.03
        assert abs(np.median(lowest)) < 0.02


def test_standing_feet_and_planted_hands_do_not_slide(clips):
    for clip in clips:
        phase = clip.motion.phase
        standing = (phase > 8) & (phase < 45)
        propped = (phase > 84) & (phase < 128)  # plank to downward dog
        for joint, in_contact in (("left_foot", standing), ("right_wrist", propped)):
            path = clip.joints[in_contact, INDEX[joint]]
            assert np.linalg.norm(path - path.mean(axis=0), axis=1).max() < 0.03


def test_motion_is_smooth(clips):
    for clip in clips:
        acceleration = np.diff(clip.joints, 2, axis=0) * clip.fps**2
        assert np.linalg.norm(acceleration, axis=-1).max() < 200.0  # m/s^2, a hand's swing


def test_performances_differ_but_show_the_same_action(clips):
    grid = np.arange(12.0, 164.0)
    centred = []
    for clip in clips:
        joints = clip.joints - clip.joints[:, :1]
        flat = joints.reshape(len(joints), -1).T
        phase = clip.motion.phase
        centred.append(np.stack([np.interp(grid, phase, row) for row in flat], axis=1))
    for a in range(4):
        for b in range(a):
            apart = (centred[a] - centred[b]).reshape(len(grid), -1, 3)
            assert 0.015 < np.linalg.norm(apart, axis=-1).mean() < 0.08


def test_clips_start_end_and_last_differently(clips):
    phases = [clip.motion.phase for clip in clips]
    for ends in ([p[0] for p in phases], [p[-1] for p in phases], [len(p) for p in phases]):
        assert len(set(ends)) == 4
    assert all(120 <= len(p) <= 200 for p in phases)


def test_a_seed_makes_one_take_and_another_seed_another(clips, shaped):
    again = make_yoga_clip(3, 1, shaped)
    other = make_yoga_clip(4, 1, shaped)
    assert (again.joints == clips[1].joints).all()
    assert (again.detections.xy_px == clips[1].detections.xy_px).all()
    assert np.abs(other.joints - clips[1].joints).max() > 0.02
    assert len(YOGA_SPANS) == 4


SEED = 3


@pytest.fixture(scope="module")
def first_pictures(clips, shaped):
    return [
        list(islice(pictures(clip, SEED, index, shaped), 3)) for index, clip in enumerate(clips)
    ]


def _joints_of_pose(true_video, model):
    """World joints by the truth's pose, shape and place."""
    R_local = rotations_from_pose(torch.from_numpy(true_video.theta))
    body = model.shape(torch.from_numpy(true_video.betas))
    return body.pose(R_local, torch.from_numpy(true_video.trans)).joints.numpy()


@pytest.fixture
def quick(clips, shaped, first_pictures, monkeypatch):
    """make_demo without spawned workers, with three pictures a video."""

    monkeypatch.setattr(demo, "worker_processes", lambda _: nullcontext(Serial()))
    monkeypatch.setattr(demo, "make_yoga_clip", lambda seed, index, body: clips[index])
    monkeypatch.setattr(demo, "demo_body", lambda seed: shaped)
    monkeypatch.setattr(demo, "pictures", lambda clip, seed, index, body: first_pictures[index])


@pytest.mark.long
def test_readers_find_what_the_clips_contain(quick, clips, shaped, tmp_path):
    messages: list[str] = []
    demo.make_demo("yoga", tmp_path / "yoga", SEED, messages.append)
    assert len(messages) == 4
    assert [p.name for p in tmp_path.iterdir()] == ["yoga"]  # no leftovers

    action = read_action(tmp_path / "yoga")
    assert [video.id for video in action.videos] == ["v1", "v2", "v3", "v4"]
    assert all(video.focal_px is None and video.initial is None for video in action.videos)
    used = {v.id: np.arange(len(t.joints)) for v, t in zip(action.videos, clips, strict=True)}
    truth = read_truth(tmp_path / "yoga" / str(action.truth), used)
    assert truth.phase_end == 180.0
    for video, clip in zip(action.videos, clips, strict=True):
        info = probe(action.folder / str(video.video))
        assert (info.size, info.fps) == (clip.size, clip.fps)
        detections = read_openpose(action.folder / str(video.keypoints), "body25")
        assert (detections.frames == np.arange(len(clip.joints))).all()
        true_video = truth.videos[video.id]
        np.testing.assert_array_equal(true_video.joints, clip.joints)
        np.testing.assert_array_equal(true_video.phase, clip.motion.phase)
        np.testing.assert_allclose(
            _joints_of_pose(true_video, shaped.model), clip.joints, rtol=0, atol=1e-9
        )
        np.testing.assert_array_equal(true_video.R, clip.camera.R_cam_from_world[0])
        for people, xy, confidence, false_person in zip(
            detections.people,
            clip.detections.xy_px,
            clip.detections.confidence,
            clip.false_people,
            strict=True,
        ):
            assert len(people) == (1 if false_person is None else 2)
            detected = confidence > 0
            gaps = [np.abs(person[detected, :2] - xy[detected]) for person in people]
            assert np.nanmin([np.max(gap) for gap in gaps]) < 1e-3


def test_the_same_seed_writes_the_same_bytes_and_replaces_what_was_there(quick, tmp_path):
    folder = tmp_path / "yoga"

    def contents() -> dict[str, bytes]:
        return {
            str(file.relative_to(folder)): file.read_bytes()
            for file in folder.rglob("*")
            if file.is_file()
        }

    demo.make_demo("yoga", folder, SEED)
    first = contents()
    (folder / "stale.txt").write_text("from an older run")
    demo.make_demo("yoga", folder, SEED)
    assert contents() == first
    assert len(first) > 600


def test_a_failing_run_leaves_nothing_behind(quick, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr(demo, "write_h264", broken)
    with pytest.raises(WorkFailed, match="disk full"):
        demo.make_demo("yoga", tmp_path / "yoga", SEED)
    assert list(tmp_path.iterdir()) == []


def test_unknown_demos_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"expected one of yoga, taichi, got 'tennis'"):
        demo.make_demo("tennis", tmp_path / "tennis", SEED)


CLIP = 2  # of the four


@pytest.fixture(scope="module")
def clip() -> DemoClip:
    return taichi.make_taichi_clip(SEED, CLIP, taichi.taichi_body(SEED))


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
    again = taichi.make_taichi_clip(SEED, CLIP, taichi.taichi_body(SEED))
    assert np.array_equal(clip.hands.detections.xy_px, again.hands.detections.xy_px)


def test_readers_find_the_hands_with_the_performer(clip: DemoClip, tmp_path) -> None:
    demo.write_keypoints(tmp_path / "v3", "v3", clip)
    frames = np.arange(taichi.TAICHI_SPANS[CLIP].frames)
    assert len(read_openpose(tmp_path / "v3", "body25").frames) == len(frames)
    body = np.where(clip.detections.confidence[..., None] > 0, clip.detections.xy_px, np.nan)
    hands = read_openpose_hands(tmp_path / "v3", frames, body)
    expected = clip.hands.detections
    assert np.allclose(hands[1], expected.confidence, atol=1e-4)
    visible = expected.confidence > 0
    assert 0.6 < visible.mean() < 0.99
    assert np.allclose(hands[0][visible], expected.xy_px[visible], atol=1e-4)
