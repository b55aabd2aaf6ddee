"""The joint motion's problem on a made scene, mirrored and excluded videos, and the way back."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core import rotations
from imocap_core.adapters.event import as_one_event
from imocap_core.adapters.hypotheses import choose_alternatives, chosen_motions
from imocap_core.adapters.joint import JointProblem, problem_of, shows_one_motion
from imocap_core.adapters.participants import (
    Participants,
    known_mirrors,
    mirrored_camera,
    mirrored_detections,
    mirrored_keypoints,
    mirrored_motion,
    participants_of,
)
from imocap_core.adapters.synchronisation import summary_of
from imocap_core.artifacts.schemas import (
    AlternativeMotion,
    Camera,
    EventCameras,
    Keypoints,
    SmplBa,
    SyncMap,
    SyncTrust,
)
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.multiview.alternation import Alternation, LoopRound
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
    for joints, video in zip(of.filmed_joints(motion), stored.videos, strict=True):
        np.testing.assert_allclose(joints, video.joints, atol=1e-12)


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


@pytest.fixture(scope="module")
def four() -> Made:
    return Made(count=4, frames=24)


def participants(four: Made, **decided: list[str]) -> Participants:
    sync = four.sync.model_copy(update=decided)
    return participants_of(four.keypoints, four.camera_motion, four.initial, sync, four.model)


def test_a_file_that_is_shown_in_a_mirror_is_mirrored_unless_declared(four: Made) -> None:
    first, *others = four.keypoints.videos
    shown = first.model_copy(update={"mirrored": True})
    keypoints = four.keypoints.model_copy(update={"videos": [shown, *others]})
    nothing = {video.id: None for video in keypoints.videos}
    assert known_mirrors(nothing, keypoints) == [True, None, None, None]
    declared = {**nothing, first.id: False, others[0].id: True}
    assert known_mirrors(declared, keypoints) == [False, True, None, None]


def test_without_anything_to_do_nothing_is_done(four: Made) -> None:
    work = participants(four)
    assert work.keypoints.videos == four.keypoints.videos
    assert work.initial.videos == four.initial.videos
    assert work.as_filmed(four.single) is four.single


def test_a_reflected_motion_is_the_reflection_of_its_joints(four: Made) -> None:
    motion = four.true[1]
    turned = mirrored_motion(motion, four.model)
    posed = four.model.shape(torch.as_tensor(turned.betas)).pose(
        rotations.exp(torch.as_tensor(turned.theta.reshape(-1, 24, 3))),
        torch.as_tensor(turned.trans),
    )
    assert np.abs(posed.joints.numpy() - turned.joints).max() < 0.004  # the body is nearly even
    left, right = (SMPL_JOINTS.index(f"{side}_wrist") for side in ("left", "right"))
    np.testing.assert_array_equal(turned.joints[:, left, 0], -motion.joints[:, right, 0])
    back = mirrored_motion(turned, four.model)
    np.testing.assert_allclose(back.theta, motion.theta, atol=1e-12)
    np.testing.assert_allclose(back.trans, motion.trans, atol=1e-12)


def test_reflected_detections_are_where_the_reflected_joints_are(four: Made) -> None:
    video, camera = four.keypoints.videos[0], four.camera_motion.videos[0]
    turned = mirrored_keypoints(video, K)
    back = mirrored_keypoints(turned, K)
    np.testing.assert_allclose(back.xy_px, video.xy_px, atol=1e-9)
    np.testing.assert_allclose(back.person_box_px, video.person_box_px, atol=1e-9)
    assert (turned.person_box_px[:, 0] <= turned.person_box_px[:, 2]).all()
    warped = mirrored_detections(camera, video.layout)
    np.testing.assert_array_equal(warped.xy_first_px, turned.xy_px)


def test_a_reflected_camera_films_the_reflected_world() -> None:
    R = rotations.exp(torch.tensor([0.3, -0.5, 0.2], dtype=torch.float64)).numpy()
    camera = Camera(id="a", K=K, R=R, t=np.array([0.1, 0.2, 3.0]))
    turned = mirrored_camera(camera)
    point, S = np.array([0.4, -0.3, 1.0]), np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(np.linalg.det(turned.R), 1.0)
    np.testing.assert_allclose(turned.R @ (S * point) + turned.t, S * (R @ point + camera.t))


def test_excluded_videos_stay_out_and_keep_their_monocular_motion(four: Made) -> None:
    work = participants(four, excluded=["v2"])
    assert [v.id for v in work.keypoints.videos] == ["v1", "v3", "v4"]
    assert work.sync(four.sync).ids == ["v1", "v3", "v4"]
    part = four.single.model_copy(
        update={
            "videos": [v for v in four.single.videos if v.id != "v2"],
            "cameras": [c for c in four.single.cameras if c.id != "v2"],
        }
    )
    whole = work.as_filmed(part)
    assert [v.id for v in whole.videos] == [c.id for c in whole.cameras] == four.ids
    np.testing.assert_array_equal(whole.videos[1].theta, four.initial.videos[1].theta)
    np.testing.assert_array_equal(whole.cameras[1].R, np.eye(3))


def test_cameras_come_back_into_the_world_of_the_joint_motion(four: Made) -> None:
    work = participants(four, mirrored=["v2"], excluded=["v4"])
    solved = four.single.model_copy(
        update={"videos": four.single.videos[:3], "cameras": four.single.cameras[:3]}
    )
    back = work.cameras(work.as_filmed(solved).cameras)
    assert [c.id for c in back] == ["v1", "v2", "v3"]
    for camera, before in zip(back, solved.cameras, strict=True):
        np.testing.assert_allclose(camera.R, before.R, atol=1e-12)
        np.testing.assert_allclose(camera.t, before.t, atol=1e-12)


def test_joints_and_covariances_come_back_as_filmed(four: Made) -> None:
    work = participants(four, mirrored=["v2"], excluded=["v4"])
    solved = [v.joints for v in work.initial.videos]
    for joints, filmed in zip(work.filmed_joints(solved), four.initial.videos, strict=True):
        np.testing.assert_allclose(joints, filmed.joints, atol=1e-12)
    spread = np.random.default_rng(0).normal(size=(5, 24, 3, 3))
    assert work.filmed_covariance("v1", spread) is spread
    turned = work.filmed_covariance("v2", spread)
    np.testing.assert_array_equal(work.filmed_covariance("v2", turned), spread)
    left, right = (SMPL_JOINTS.index(f"{side}_wrist") for side in ("left", "right"))
    S = np.diag([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(turned[:, left], S @ spread[:, right] @ S)


@pytest.mark.long
def test_one_offset_one_path_and_one_motion_make_one_event(made: Made) -> None:
    of = problem(made)
    motion, line = solved(of), np.arange(float(len(made.frames[0])))
    places = [SyncMap(id=i, reference_frame=line, confidence=0 * line + 1) for i in made.ids]

    def event(path_m: float, rate: float, misfit: float) -> EventCameras | None:
        second = places[1].model_copy(update={"reference_frame": rate * line})
        sync = made.sync.model_copy(update={"maps": [places[0], second, places[2]]})
        spread = DeviationSpread(np.zeros((3, len(line), 12)), np.full((3, 6), path_m))
        first = LoopRound(summary_of(sync), replace(motion, spread=spread), misfit, 0.0)
        return as_one_event(of, made.keypoints, Alternation([first], 0, sync, ""), print)[1]

    assert getattr(event(0.005, 1.0, 10.0), "declared", None) is False
    assert event(0.02, 1.0, 10.0) is event(0.005, 0.5, 10.0) is event(0.005, 1.0, 0.01) is None
