"""The joint motion's problem on a made scene, and the way back to artifacts."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.adapters.hypotheses import choose_alternatives, chosen_motions
from imocap_core.adapters.joint import JointProblem, problem_of, shows_one_motion
from imocap_core.adapters.participants import (
    mirrored_detections,
    mirrored_keypoints,
    mirrored_motion,
)
from imocap_core.artifacts.schemas import AlternativeMotion, Keypoints, SmplBa, SyncMap, SyncTrust
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.multiview.repair import LEGS
from imocap_core.motion.multiview.scene import DeviationSpread, JointMotion
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.params import FitParams, MotionParams, Params
from tests.made_sync import trust_in
from tests.report.made import K, Made

FEW_STEPS = MotionParams(rounds=1, max_steps=2)  # the laws here hold wherever a solve stops


def problem(made: Made, **decided: list[str] | SyncTrust) -> JointProblem:
    """Frame to frame correspondences, NaN after the reference's end."""
    maps = [
        SyncMap(
            id=i,
            reference_frame=np.where(f <= made.frames[0][-1], f.astype(float), np.nan),
            confidence=(f <= made.frames[0][-1]).astype(float),
        )
        for i, f in zip(made.ids, made.frames, strict=True)
    ]
    sync = made.sync.model_copy(update={"maps": maps, **decided})
    given = (made.keypoints, made.camera_motion, made.initial, sync)
    return problem_of(*given, FitParams(), FEW_STEPS)


def trusted(made: Made, confidence: float | None) -> SyncTrust:
    """Every video's phases, and how sure they are; all have as many frames."""
    phases = {
        i: f / made.keypoints.videos[0].fps for i, f in zip(made.ids, made.frames, strict=True)
    }
    of_phase = None if confidence is None else np.full(len(made.frames[0]), confidence)
    return trust_in(phases, phase_confidence=of_phase)


def test_frames_that_the_reference_does_not_show_have_places_beyond_it(made: Made) -> None:
    assert list(problem(made).scene.beyond) == []
    assert list(problem(made, trust=trusted(made, None)).scene.beyond) == []
    given = problem(made, trust=trusted(made, 0.6), excluded=[made.ids[1]])
    assert len(given.scene.beyond) == 2
    for k, v in enumerate((0, 2)):
        frames, beyond = made.frames[v], given.scene.beyond[k]
        outside = frames > made.frames[0][-1]
        np.testing.assert_allclose(beyond.position[outside], frames[outside])
        np.testing.assert_array_equal(beyond.confidence, 0.6 * outside)
        assert np.isnan(beyond.position[~outside]).all()


def solved(of: JointProblem) -> JointMotion:
    return solve_jointly(of.scene, of.start, of.options)


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=3, frames=12)


@pytest.fixture(scope="module")
def plain(made: Made) -> tuple[JointProblem, JointMotion]:
    of = problem(made)
    return of, solved(of)


@pytest.fixture(scope="module")
def straight(plain: tuple[JointProblem, JointMotion]) -> SmplBa:
    of, motion = plain
    return of.result(motion)


@pytest.mark.long
def test_a_mirrored_video_is_recovered_as_unmirrored(made: Made, straight: SmplBa) -> None:
    flipped, v = Made(count=3, frames=12), 2
    flipped.keypoints.videos[v] = mirrored_keypoints(made.keypoints.videos[v], K)
    flipped.camera_motion.videos[v] = mirrored_detections(made.camera_motion.videos[v], "body25")
    flipped.initial.videos[v] = mirrored_motion(made.initial.videos[v], made.model)
    of = problem(flipped, mirrored=[made.ids[v]])
    result = of.result(solved(of)).videos
    expected = [m.joints for m in straight.videos]
    expected[v] = mirrored_motion(straight.videos[v], made.model).joints
    for motion, joints in zip(result, expected, strict=True):
        assert float(np.linalg.norm(motion.joints - joints, axis=-1).mean()) < 0.003
    # and it stays the mirror image that was filmed
    across = result[v].joints[:, SMPL_JOINTS.index("left_hip")] - straight.videos[v].joints[:, 1]
    assert np.linalg.norm(across, axis=-1).mean() > 0.05


def test_a_stored_result_comes_back_as_it_was_solved(made: Made, straight: SmplBa) -> None:
    of = problem(made, mirrored=["v2"])
    motion = of.solution(straight)
    stored = of.result(motion)
    back = of.solution(stored)
    for name in ("R_local", "trans", "betas"):
        for one, other in ((motion.state, back.state), (motion.common, back.common)):
            torch.testing.assert_close(getattr(one, name), getattr(other, name), atol=1e-9, rtol=0)
    for name in ("R", "t", "K"):
        here, there = getattr(motion.cameras, name), getattr(back.cameras, name)
        torch.testing.assert_close(here, there, atol=1e-12, rtol=0)
    np.testing.assert_array_equal(motion.spread.offset_sd, back.spread.offset_sd)
    np.testing.assert_array_equal(motion.spread.keypoints_m, back.spread.keypoints_m)
    assert (back.misfit, back.costs, back.status) == (motion.misfit, motion.costs, motion.status)
    np.testing.assert_array_equal(back.swapped, motion.swapped)
    for joints, video in zip(of.filmed_joints(motion), stored.videos, strict=True):
        np.testing.assert_allclose(joints, video.joints, atol=1e-12)


def test_the_sides_that_a_solve_put_right_are_stored_and_kept(plain):
    of, motion = plain
    swapped = [np.zeros(len(o.xy_px), int) for o in of.scene.observations]
    swapped[1][3:7] = LEGS
    motion = replace(motion, swapped=tuple(swapped))
    back = of.solution(of.result(motion))
    np.testing.assert_array_equal(back.swapped, swapped)
    for states, after in zip(swapped, of.scene_of(back).observations, strict=True):
        np.testing.assert_array_equal(after.swapped_states, states)


def test_the_common_motion_is_stored_with_its_spread(made: Made, straight: SmplBa) -> None:
    common = straight.common
    assert common.ids == made.ids
    assert len(common.theta) == len(made.frames[0])
    assert common.rigid_offset_sd.shape == (3, 6)
    assert common.keypoint_sd_m.shape[:2] == (3, len(common.theta))
    assert (common.rigid_offset_sd > 0).all()
    assert (common.keypoint_sd_m >= 0).all()


def test_a_single_video_has_no_common_motion() -> None:
    of = problem(Made(count=1, frames=8))
    assert of.result(solved(of)).common is None


@pytest.mark.parametrize(("spread_m", "is_one"), [(0.004, True), (0.03, False)])
def test_videos_that_hardly_differ_show_one_motion(plain, spread_m, *, is_one):
    _, before = plain
    alike = DeviationSpread(
        np.full_like(before.spread.keypoints_m, spread_m), np.full((3, 6), spread_m)
    )
    assert shows_one_motion(replace(before, spread=alike)) == is_one
    assert not shows_one_motion(replace(before, spread=None))


def test_the_body_has_the_keypoints_of_the_remaining_videos() -> None:
    made, params = Made(3), Params()
    *rest, last = made.keypoints.videos
    other = last.model_copy(
        update={
            "layout": "coco17",
            "xy_px": last.xy_px[:, :17],
            "confidence": last.confidence[:, :17],
        }
    )
    sync = made.sync.model_copy(update={"excluded": ["v3"]})
    problem = problem_of(
        Keypoints(videos=[*rest, other]), made.camera_motion, made.initial, sync, params.fit,
        params.motion,
    )  # fmt: skip
    body, state = problem.scene.body, problem.solution(made.single).state
    projected = body.positions(body.keypoints, state)
    assert {o.xy_px.shape[1] for o in problem.scene.observations} == {projected.shape[2]}
    assert torch.isfinite(projected[:, 0]).all()


def test_a_choice_replaces_the_motions_it_names_and_no_other() -> None:
    made = Made(count=3, frames=6)
    other = AlternativeMotion(name="depth", excess_cost=3.0, motion=made.true[1])
    initial = made.initial.model_copy(update={"alternatives": [other]})
    motions = chosen_motions(initial, {"v2": "depth"})
    assert motions == [made.bent[0], made.true[1], made.bent[2]]
    assert chosen_motions(initial, {}) == made.bent

    sync = made.sync.model_copy(update={"alternatives": {"v2": "depth"}})
    problem = problem_of(
        made.keypoints, made.camera_motion, initial, sync, FitParams(), MotionParams()
    )
    start = problem.start.trans[1, :6].numpy()
    np.testing.assert_allclose(start, made.true[1].trans)


def test_without_alternatives_nothing_is_chosen_or_said() -> None:
    made = Made(count=2, frames=6)
    chosen = choose_alternatives(made.initial, made.keypoints, [None, None])
    assert chosen.names == {}
    assert chosen.notes == []
