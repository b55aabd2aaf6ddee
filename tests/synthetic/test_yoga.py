"""The choreography and its performances: timing, contact, variation."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.synthetic import choreography
from imocap_core.synthetic.yoga import SUN_SALUTATION, local_rotations
from imocap_core.synthetic.yoga_clip import YOGA_SPANS, make_yoga_clip

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
