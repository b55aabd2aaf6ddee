"""What speaks against a result: collapsed time, outlying bodies, sliding feet, unseen limbs."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.artifacts.schemas import GroundPlane, Keypoints, LeftOutVideo, SmplBa
from imocap_core.body.layouts import layout_names
from imocap_core.camera.gravity import sole_heights_m
from imocap_core.camera.ground_plane import Ground
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.diagnostics.action_verdict import verdict_of
from imocap_core.diagnostics.bodies import (
    OFF_FLOOR_MM,
    ROLLED_DEG,
    TILT_SD_DEG,
    PlacedBody,
    floor_findings,
    floor_misses_mm,
    leap_findings,
    outlying_bodies,
    slides,
    speed_findings,
    two_bodies,
    up_findings,
)
from imocap_core.diagnostics.contradictions import behind_findings, behind_trunk_m
from imocap_core.diagnostics.detection_findings import (
    hidden_findings,
    left_out_findings,
    sight_lines,
    widest_angle_deg,
)
from imocap_core.diagnostics.timing import collapses
from imocap_core.rotations import exp
from imocap_core.sequences import runs
from tests.diagnostics.test_action_verdict import predicted, with_sync
from tests.diagnostics.test_contradictions import performance
from tests.report.made import FPS, Made


def test_runs_are_maximal_and_long_enough() -> None:
    flags = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], dtype=bool)
    assert runs(flags, 2) == [(0, 1), (6, 8)]
    assert runs(flags, 2, gap=1) == [(0, 3), (6, 8)]
    assert runs(~flags | True, 1) == [(0, 8)]
    assert runs(flags & False, 1) == []


def test_standing_still_a_slow_replay_and_unmatched_frames_are_none() -> None:
    position = np.arange(150.0)
    position[60:90] = 60.0
    still = performance()
    still[60:90] = still[60]
    assert collapses(position, still, FPS) == []
    assert collapses(np.arange(150.0) / 8, performance(), FPS) == []
    unmatched = np.where((position >= 60) & (position < 90), np.nan, position)
    assert collapses(unmatched, performance(), FPS) == []


def test_collapsed_time_is_found_where_some_frames_show_nobody() -> None:
    position, xy_px = np.arange(150.0), performance()
    position[60:100], xy_px[55:70] = 60.0, np.nan
    (span,) = collapses(position, xy_px, FPS)
    assert (span.first, span.last) == (60, 99)
    assert collapses(position, np.full_like(xy_px, np.nan), FPS) == []


def bodies(made: Made) -> dict[str, PlacedBody]:
    """The made bodies in the world's axes: each as the first camera would see it."""
    return {
        v.id: PlacedBody(v.joints @ made.R[i] @ made.R[0].T, made.frames[i] / FPS, FPS)
        for i, v in enumerate(made.true)
    }


def test_equal_performances_have_no_outlying_body(made: Made) -> None:
    assert outlying_bodies(bodies(made)) == {name: [] for name in made.ids}


@pytest.mark.parametrize("turn", [np.diag([-1.0, 1.0, -1.0]), np.diag([1.0, -1.0, -1.0])])
def test_a_body_that_faces_away_or_lies_is_outlying_where_it_does(made, turn):
    placed = bodies(made)
    joints = placed["v2"].joints.copy()
    joints[:12] = joints[:12] @ turn
    placed["v2"] = PlacedBody(joints, placed["v2"].phase_s, FPS)
    spans = outlying_bodies(placed)
    assert [(s.first, s.last) for s in spans["v2"]] == [(0, 11)]
    assert spans["v1"] == spans["v3"] == []


def test_a_foot_slides_when_it_moves_in_space_only() -> None:
    frames = 40
    ankle_m = np.tile([0.0, 0.9, 4.0], (frames, 1))
    ankle_px = np.tile([300.0, 400.0], (frames, 1))
    assert slides(ankle_m, ankle_px, 200.0, FPS) == []
    ankle_m[20:, 2] += 0.5
    (span,) = slides(ankle_m, ankle_px, 200.0, FPS)
    assert span.first <= 20 <= span.last
    assert span.last - span.first < 8
    assert span.value > 1
    walking = ankle_px + np.arange(frames)[:, None] * [3.0, 0.0]
    assert slides(ankle_m, walking, 200.0, FPS) == []
    assert SMPL_JOINTS.index("left_ankle") == 7


A, B = np.array([0.03, -0.03, 0.02, -0.02]), np.array([-0.03, 0.04, -0.03, 0.02])


def errors(bodies, *, noise=0.005, sides=0.005, seed=0):
    """Relative limb errors (M, 4, 2) of videos of some bodies."""
    rng = np.random.default_rng(seed)
    proportions = np.array(bodies) + noise * rng.standard_normal((len(bodies), 4))
    return proportions[..., None] + sides * rng.standard_normal((len(bodies), 4, 2))


@pytest.mark.parametrize("seed", range(5))
def test_two_clear_groups(seed):
    groups = two_bodies(errors([A, B, A, B, B], seed=seed))
    assert groups[0] == groups[2] != groups[1]
    assert groups[1] == groups[3] == groups[4]


def test_size_alone_says_nothing():
    """A camera's distance is as unknown as the person's size."""
    assert two_bodies(errors([A, A + 0.2, A + 0.2, A])) is None


@pytest.mark.parametrize(
    "unclear",
    [
        errors([A, A, A, A]),
        errors([A, B, A, B], noise=0.06, seed=1),
        errors([A, B, A, B], sides=0.08),
        errors([A, A, A, B]),  # one video may be fitted badly
        errors([A, B]),
        errors([0.3 * A, 0.3 * B, 0.3 * A, 0.3 * B]),
    ],
)
def test_what_is_unclear_is_no_proposal(unclear):
    assert two_bodies(unclear) is None


def test_limbs_that_are_seldom_across_do_not_count():
    measured = errors([A, B, A, B])
    measured[0, 3] = np.nan
    assert two_bodies(measured) is not None
    measured[1, 2] = np.nan
    assert two_bodies(measured) is None


def standing(made: Made, roll_deg: float = 0.0, sunk_mm: float = 0.0, sd: float = 2.0) -> SmplBa:
    """The made motion on a floor; up leans so far to the first picture's right."""
    motion, roll = made.refined.motion, np.radians(roll_deg)
    level = Ground(np.array([0.0, -1.0, 0.0]), np.zeros(3), sd, 5.0)
    soles = np.median([sole_heights_m(v.joints, level).min() for v in motion.videos])
    plane = GroundPlane(
        up=np.array([np.sin(roll), -np.cos(roll), 0.0]),
        origin=level.up * (soles + sunk_mm / 1000),
        tilt_sd_deg=sd,
        height_sd_mm=5.0,
    )
    R = [camera.model_copy(update={"R": np.eye(3)}) for camera in motion.cameras]
    return motion.model_copy(update={"ground": plane, "cameras": R})


@pytest.mark.parametrize("roll", [-80.0, ROLLED_DEG - 1, ROLLED_DEG + 1])
def test_a_rolled_camera_makes_up_doubtful(roll: float) -> None:
    made = Made(2)
    motion, sync = standing(made, roll_deg=roll), made.refined.sync
    findings = up_findings(motion, sync, made.camera_motion.videos)
    assert [f.kind for f in findings] == (["up"] if abs(roll) > ROLLED_DEG else [])
    assert all(f"rolled by {abs(roll):.0f} degrees" in f.brief for f in findings)
    level = Rotation.from_euler("z", -roll, degrees=True).as_matrix()  # beside it, as it looks
    cameras = [motion.cameras[0], motion.cameras[1].model_copy(update={"R": level})]
    motion = motion.model_copy(update={"cameras": cameras})
    assert not up_findings(motion, sync, made.camera_motion.videos)


def test_an_uncertain_up_is_doubtful() -> None:
    made = Made(2)
    cameras, sync = made.camera_motion.videos, made.refined.sync
    assert not up_findings(standing(made, sd=TILT_SD_DEG - 1), sync, cameras)
    (finding,) = up_findings(standing(made, sd=TILT_SD_DEG + 1), sync, cameras)
    assert "uncertain" in finding.brief


@pytest.mark.parametrize(
    ("sunk_mm", "brief"),
    [(OFF_FLOOR_MM / 2, None), (300.0, "soles below the floor"), (-300.0, "soles above the floor")],
)
def test_soles_off_the_floor_are_named(sunk_mm: float, brief: str | None) -> None:
    made = Made(1)
    motion, cameras = standing(made, sunk_mm=sunk_mm), made.camera_motion.videos
    findings = floor_findings(motion, made.refined.sync, cameras)
    assert [f.brief for f in findings] == ([] if brief is None else [brief])
    lost = [c.model_copy(update={"motion": "translating"}) for c in cameras]
    assert not floor_findings(motion, made.refined.sync, lost)


def test_who_sits_is_not_above_the_floor() -> None:
    joints = np.zeros((9, 24, 3)) + [0.0, -0.6, 3.0]
    floor = Ground(np.array([0.0, -1.0, 0.0]), np.zeros(3), 2.0, 5.0)
    assert floor_misses_mm(joints, floor)[1] > OFF_FLOOR_MM
    joints[:, [SMPL_JOINTS.index(f"{side}_hip") for side in ("left", "right")], 1] = -0.1
    assert floor_misses_mm(joints, floor)[1] < OFF_FLOOR_MM


def test_only_what_nobody_does_is_too_fast() -> None:
    made = Made(1, frames=30)
    videos = {v.id: v for v in made.keypoints.videos}
    for speed, named in ((25.0, False), (60.0, True)):
        joints = made.final[0].joints.copy()
        joints[15:, SMPL_JOINTS.index("left_wrist"), 0] += speed * 2 / FPS
        findings = speed_findings([made.final[0].model_copy(update={"joints": joints})], videos)
        assert bool(findings) == named
        assert all(f.first_frame <= 15 <= f.last_frame for f in findings)


@pytest.mark.parametrize(
    ("way", "frames", "named"),
    [((0, 0, 0.5), 1, True), ((0.3, 0, 0.4), 1, False), ((0, 0, 1.5), 5, False)],
    ids=["in depth", "across the picture", "a punch"],
)
def test_a_limb_that_is_in_another_depth_at_once_jumps(way, frames: int, named: bool) -> None:
    motion = Made(1, frames=30).final[0]
    joints = np.repeat(motion.joints[:1], 30, axis=0)
    share = np.clip((np.arange(30) - 10) / frames, 0, 1)[:, None]
    joints[:, SMPL_JOINTS.index("left_wrist")] += share * way
    findings = leap_findings([motion.model_copy(update={"joints": joints})])
    assert [f.brief for f in findings] == ["left arm jumps in depth"] * named
    assert all((f.first_frame, f.last_frame) == (10, 11) for f in findings)


def facing_body(wrist: tuple[float, float, float]) -> np.ndarray:
    """(1, 24, 3) a trunk that faces a camera 3 m away, and a wrist."""
    joints = np.zeros((1, 24, 3)) + [0.0, 0.0, 3.0]
    for side, x in (("left", 0.2), ("right", -0.2)):
        joints[0, SMPL_JOINTS.index(f"{side}_shoulder")] = x, -0.5, 3.0
        joints[0, SMPL_JOINTS.index(f"{side}_hip")] = x / 2, 0.0, 3.0
    joints[0, SMPL_JOINTS.index("left_wrist")] = wrist
    return joints


@pytest.mark.parametrize(
    ("wrist", "behind"), [((0, -0.3, 3.3), 0.3), ((0, -0.3, 2.7), 0.0), ((0.5, -0.3, 3.3), 0.0)]
)
def test_a_wrist_is_hidden_behind_the_trunk_only(wrist, behind):
    depth = behind_trunk_m(facing_body(wrist), SMPL_JOINTS.index("left_wrist"))
    assert depth[0] == pytest.approx(behind, abs=0.01)


@pytest.mark.parametrize(
    ("layout", "confidence", "named"),
    [("blazepose33", 0.9, True), ("blazepose33", 0.4, False), ("body25", 0.9, False)],
)
def test_an_arm_seen_clearly_is_not_behind_the_trunk(layout, confidence, named):
    made = Made(1)
    video = made.keypoints.videos[0].model_copy(update={"layout": layout})
    names = layout_names(layout)
    seen = np.zeros((len(video.frames), len(names)))
    seen[:, names.index("left_wrist")] = confidence
    joints = np.repeat(facing_body((0, -0.3, 3.3)), len(video.frames), axis=0)
    body = made.final[0].model_copy(update={"joints": joints})
    motion = made.refined.motion.model_copy(update={"videos": [body]})
    findings = behind_findings(motion, {video.id: video.model_copy(update={"confidence": seen})})
    assert [f.brief for f in findings] == (["left arm wrong in depth"] if named else [])


def seen_across(made: Made, angle_deg: float) -> SmplBa:
    """The made motion, the second and third camera turned so far about the performer."""
    motion = made.refined.motion
    turned = exp(torch.tensor([0.0, np.radians(angle_deg), 0.0], dtype=torch.float64)).numpy()
    R = [np.eye(3), turned, turned]
    cameras = [c.model_copy(update={"R": r}) for c, r in zip(motion.cameras, R, strict=True)]
    ahead = [v.model_copy(update={"joints": v.joints * [0, 0, 1]}) for v in motion.videos]
    return motion.model_copy(update={"cameras": cameras, "videos": ahead})


@pytest.mark.parametrize("angle", [0.0, 10.0, 70.0, 90.0, 110.0, 175.0, 180.0])
def test_cameras_that_face_each_other_look_along_one_line(angle: float) -> None:
    made = Made(3)
    lines = sight_lines(seen_across(made, angle), made.ids)
    assert widest_angle_deg(lines) == pytest.approx(min(angle, 180 - angle), abs=1e-5)


@pytest.mark.parametrize(("angle", "differ"), [(19, 0.01), (21, 0.01), (40, 0.06), (46, 0.06)])
def test_videos_from_one_side_are_never_called_faultless(angle: float, differ: float) -> None:
    made = Made(3)
    refined = with_sync(made).model_copy(update={"motion": seen_across(made, angle)})
    verdict = verdict_of(made.keypoints, None, refined, predicted(made, [differ] * 3))
    one_side = angle in (19, 40)
    assert ("depth is a guess" in verdict.summary[0]) == one_side
    assert any(f.kind == "view" for f in verdict.findings) == one_side
    if one_side:
        assert not verdict.trusted
        assert "Nothing was found" not in str(verdict)


def hiding(made: Made, joint: str, frames: slice, videos: tuple[int, ...]) -> Keypoints:
    """The keypoints of longer videos, a joint guessed in some frames of some videos."""
    out = list(made.keypoints.videos)
    for v in videos:
        confidence = np.where(out[v].confidence > 0, 0.9, 0.0)
        confidence[frames, layout_names(out[v].layout).index(joint)] = 0.05
        out[v] = out[v].model_copy(update={"confidence": confidence})
    return Keypoints(videos=out)


def test_a_limb_is_hidden_where_no_video_shows_it() -> None:
    made = Made(2, frames=60)
    sync = with_sync(made).sync
    shown = {v.id: v for v in hiding(made, "left_wrist", slice(10, 40), (0,)).videos}
    assert hidden_findings(sync, shown) == []
    hidden = {v.id: v for v in hiding(made, "left_wrist", slice(10, 40), (0, 1)).videos}
    (finding,) = hidden_findings(sync, hidden)
    assert finding.subject.startswith("the left hand in v1 frames 1")
    assert finding.serious
    briefly = {v.id: v for v in hiding(made, "left_wrist", slice(10, 20), (0, 1)).videos}
    assert hidden_findings(sync, briefly) == []


def test_hands_hidden_at_the_same_time_are_one_finding() -> None:
    made = Made(1, frames=60)
    left = hiding(made, "left_wrist", slice(0, 60), (0,)).videos[0]
    names = layout_names(left.layout)
    confidence = left.confidence.copy()
    confidence[2:, names.index("right_wrist")] = 0.1
    both = left.model_copy(update={"confidence": confidence})
    (finding,) = hidden_findings(with_sync(made).sync, {both.id: both})
    assert finding.subject == "both hands"
    nobody = both.model_copy(update={"confidence": np.zeros_like(confidence)})
    assert hidden_findings(with_sync(made).sync, {nobody.id: nobody}) == []


def test_a_video_left_out_is_named_with_its_fault() -> None:
    faulty = LeftOutVideo(id="v2", reason="frames: expected at most [0, 9], got [50, 60]")
    (finding,) = left_out_findings(Made(2).keypoints.model_copy(update={"left_out": [faulty]}))
    assert finding.brief == "left out: frames: expected at most [0, 9], got [50, 60]"
