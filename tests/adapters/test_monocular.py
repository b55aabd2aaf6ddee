"""The fit of a video depends on that video alone, an action's result on its videos' fits; an
estimator's result becomes a start where the keypoints are; detectors are believed differently."""

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import torch

from benchmarks.lifter import LifterRow, markdown, write_table
from imocap_core.adapters.estimates import estimate_of
from imocap_core.adapters.hypotheses import unfit_videos
from imocap_core.adapters.monocular import (
    ANY,
    SingleVideo,
    fit_single_video,
    joined,
    lifted_joints,
    likeliest_first,
    pose_libraries,
    starts,
)
from imocap_core.adapters.observations import fit_of, fit_of_single_views, noise_share_of
from imocap_core.artifacts import codec
from imocap_core.artifacts.schemas import (
    AlternativeMotion,
    InitialSmpl,
    Keypoints,
    StartFit,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.body import load_free_body
from imocap_core.body.layouts import layout_names, layouts
from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.io.readers.keypoint_readers import FORMATS
from imocap_core.io.readers.smpl_estimators import JOINT_READERS, ROTATIONS
from imocap_core.metrics.position import pa_mpjpe_mm, root_relative
from imocap_core.motion.monocular.starts import make_library
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body
from imocap_core.params import FitParams, InitialSmplParams, Params
from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.format_names import DetectionFormat, InitialFormat, Layout
from imocap_core.pipeline.stage import Context
from imocap_core.rotations import exp
from tests.io import made_estimates
from tests.made_keypoints import made_keypoints
from tests.report.made import Made
from tests.stages.test_people import figure


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=2, frames=8)


def digests(made: Made, **changes: object) -> tuple[str, str]:
    """What the fit of the first video is made from, with changes of its keypoints."""
    video = made.keypoints.videos[0].model_copy(update=changes)
    single = SingleVideo.of(video, made.camera_motion.videos[0], None)
    return codec.pack(single.keypoints).digest, codec.pack(single.cameras).digest


@pytest.mark.parametrize(
    "changes",
    [{"id": "left"}, {"video": "elsewhere.mp4"}, {"note": "by hand"}, {"performer": "anna"}],
)
def test_names_and_places_do_not_matter(made: Made, changes: dict[str, object]) -> None:
    assert digests(made, **changes) == digests(made)


@pytest.mark.parametrize("field", ["fps", "xy_px", "initial_format"])
def test_what_is_seen_does(made: Made, field: str) -> None:
    video = made.keypoints.videos[0]
    changed = {"fps": 25.0, "xy_px": video.xy_px + 1.0, "initial_format": "smpl_npz"}
    assert digests(made, **{field: changed[field]}) != digests(made)


@pytest.mark.long
def test_a_short_video_is_fitted_with_its_alternatives_or_alone(made: Made) -> None:
    params, prior = Params(), load_pose_prior()
    options = replace(params.initial_smpl, starts=2, max_steps=2, library_poses=60, lifter="off")
    single = SingleVideo.of(made.keypoints.videos[1], made.camera_motion.videos[1], None)

    def fit(alone: bool) -> InitialSmpl:
        libraries = pose_libraries(prior, lambda: np.random.default_rng(7), options)
        return fit_single_video(single, prior, libraries, params.fit, options, alone=alone)

    alone, beside = fit(True), fit(False)
    assert alone.alternatives == []
    assert 1 <= len(beside.alternatives) <= options.hypotheses - 1
    np.testing.assert_array_equal(alone.videos[0].theta, beside.videos[0].theta)
    assert beside.source == {ANY: "monocular"}
    assert len(beside.grounds) == 1
    assert single.stride(options) == 3


def test_the_likeliest_motion_is_first_and_what_it_replaces_takes_its_name(made: Made) -> None:
    first, falling, upright = made.bent[0], made.bent[1], made.initial.videos[0]
    others = [
        AlternativeMotion(name="depth", excess_cost=4.0, motion=falling),
        AlternativeMotion(name="sides", excess_cost=-1.5, motion=upright),
    ]
    assert likeliest_first(first, others[:1], [3.0, 3.0]) == (first, others[:1])
    likeliest, rest = likeliest_first(first, others, [9.0, 9.5, 9.0])
    assert likeliest is upright
    assert [(a.name, a.excess_cost) for a in rest] == [("depth", 6.5), ("sides", 1.5)]
    assert likeliest_first(first, others, [1.0, 9.0, 9.0])[0] is first
    assert rest[1].motion is first


def test_an_actions_result_has_every_fit_under_its_name(made: Made) -> None:
    def fit(v: int) -> InitialSmpl:
        motion = made.bent[v].model_copy(update={"id": ANY})
        return InitialSmpl(
            model=made.initial.model,
            model_digest=made.initial.model_digest,
            videos=[motion],
            source={ANY: "monocular"},
            starts=[StartFit(video=ANY, name="start 1", cost=3.0 + v, chosen=True)],
            alternatives=[AlternativeMotion(name="depth", excess_cost=1.0 + v, motion=motion)],
            limb_errors={ANY: 0.02 + 0.1 * v},
        )

    result = joined([fit(0), fit(1)], ["v1", "v2"])
    assert result.videos == made.bent
    assert result.source == made.initial.source
    assert [(start.video, start.cost) for start in result.starts] == [("v1", 3.0), ("v2", 4.0)]
    assert [other.motion.id for other in result.alternatives] == ["v1", "v2"]
    three = joined([fit(0), fit(1), fit(0)], ["v1", "v2", "v3"])
    assert (unfit_videos(result), unfit_videos(three)) == ([], [1])  # two are left at least


FRAMES = 60


def seen(layout: str = "coco17") -> tuple[VideoKeypoints, VideoCameraMotion]:
    """A made person in a picture of 1280 x 720, missing for a while."""
    xy = figure(1, 0.4, 640, 420)[..., :2]
    xy[20:24] = np.nan
    trust = np.isfinite(xy).all(-1) * 0.9
    video = made_keypoints(np.arange(FRAMES), layout, size=(1280, 720), xy_px=xy, confidence=trust)
    eye = np.repeat(np.eye(3)[None], FRAMES, 0)
    camera = VideoCameraMotion(
        id="v1", K=np.array([[1280.0, 0, 640], [0, 1280.0, 360], [0, 0, 1]]),
        focal_source="assumed", motion="static", note="", residual_px=0.0, H_first_from_frame=eye,
        R_first_from_frame=eye, inliers=np.zeros(FRAMES, int), xy_first_px=xy,
        zoom=np.ones(FRAMES),
    )  # fmt: skip
    return video, camera


def test_the_starts_are_where_the_lifter_says_and_where_the_person_is_seen() -> None:
    video, camera = seen()
    lifted = lifted_joints(video, camera)
    body, prior = Body.of(load_free_body(), "coco17"), load_pose_prior()
    library = make_library(body, prior, np.random.default_rng(0), poses=800, directions=2)
    observation = Observation(video.xy_px, video.confidence, camera.K, 30.0, noise_share=0.01)
    options = InitialSmplParams(starts=1)
    found = starts(body, library, observation, None, lifted, lifted.joints[::-1].copy(), options)
    assert len(found) == 4  # the lifter's motion and its alternative, the detector's, the library's
    posed = body.model.shape(found[0].trans.new_zeros(1, 10)).pose(found[0].R_local, found[0].trans)
    pair = (
        root_relative(x, SMPL_JOINTS, EVAL_12)
        for x in (posed.keypoints(body.joints).numpy(), lifted.joints)
    )
    assert pa_mpjpe_mm(*pair) < 150
    points = posed.keypoints(body.keypoints).numpy() @ camera.K.T
    away = np.linalg.norm(points[..., :2] / points[..., 2:] - video.xy_px, axis=-1)
    assert np.nanmedian(away) < 0.15 * 420


def test_nobody_and_hands_alone_are_not_lifted() -> None:
    video, camera = seen()
    nobody = camera.model_copy(update={"xy_first_px": np.full_like(camera.xy_first_px, np.nan)})
    assert lifted_joints(video, nobody) is None
    assert lifted_joints(*seen("left_hand21")) is None


def test_the_table_has_a_row_an_action(tmp_path: Path) -> None:
    numbers = {"mpjpe_mm": 101.26, "mpjpe_scaled_mm": 99.0, "pa_mpjpe_mm": 71.0}
    rows = [LifterRow("trials", "generic", "walk", numbers, 70.0, 0.31)]
    text = write_table(rows, tmp_path / "lifter").read_text(encoding="utf-8")
    assert text == markdown(rows)
    assert "| trials | generic | walk | 101.3 | 99.0 | 71.0 | 70.0 | 0.31 |" in text


def test_the_answer_looks_like_the_truth() -> None:
    """A pose of the prior from its 2D alone: nearer than any unrelated pose (about 200 mm)."""
    video, camera = seen()
    lifted = lifted_joints(video, camera)
    assert 0.02 < float(lifted.sigma_m.mean()) < 0.5
    # in the picture, the lifted joints stand where the detections are
    for name in ("left_wrist", "right_wrist", "left_ankle", "right_ankle"):
        x = lifted.joints[:, SMPL_JOINTS.index(name), :2]
        x = x - lifted.joints[
            :, [SMPL_JOINTS.index("left_hip"), SMPL_JOINTS.index("right_hip")], :2
        ].mean(1)
        y = video.xy_px[:, NAMES.index(name)] - video.xy_px[:, [11, 12]].mean(1)
        known = np.isfinite(y).all(-1)
        scale = 1.7 / 420
        assert np.median(np.linalg.norm(x[known] - scale * y[known], axis=-1)) < 0.15


NAMES = layout_names("coco17")


def keypoints_of(*layouts: str) -> Keypoints:
    """One video of two empty frames for each layout."""
    return Keypoints(videos=[made_keypoints(np.arange(2), name, id=name) for name in layouts])


def test_a_detector_has_its_own_noise_and_others_the_usual() -> None:
    params = FitParams(noise_share=0.01, noise_share_of={"mediapipe33": 0.03})
    assert noise_share_of("mediapipe33", params) == 0.03
    assert noise_share_of("body25", params) == 0.01
    with pytest.raises(ValueError, match=r"noise_share_of: expected some of body25.*, got paws$"):
        noise_share_of("body25", FitParams(noise_share_of={"paws": 0.02}))


def test_mediapipe_is_believed_less_by_default() -> None:
    assert noise_share_of("mediapipe33", FitParams()) > noise_share_of("body25", FitParams())


def test_the_strongest_shape_prior_of_the_layouts_is_used() -> None:
    params = FitParams(shape_prior=10.0, shape_prior_of={"mediapipe33": 70.0})
    one = keypoints_of("body25")
    assert fit_of(one, params).shape_prior == 10.0
    assert fit_of(keypoints_of("body25", "mediapipe33"), params).shape_prior == 70.0
    with pytest.raises(ValueError, match=r"shape_prior_of: expected some of body25.*, got paws$"):
        fit_of(one, FitParams(shape_prior_of={"paws": 2.0}))


def test_a_single_view_without_joints_keeps_the_shape_near_the_mean() -> None:
    keypoints, params = keypoints_of("body25"), FitParams(shape_prior=10.0)
    assert fit_of_single_views(keypoints, params, False, 90.0).shape_prior == 90.0
    assert fit_of_single_views(keypoints, params, True, 90.0).shape_prior == 10.0
    assert fit_of_single_views(keypoints, params, False, 5.0).shape_prior == 10.0


WRITERS = {
    "hmr2": made_estimates.write_phalp,
    "wham": made_estimates.write_wham,
    "vibe": made_estimates.write_vibe,
    "hmmr": made_estimates.write_hmmr,
    "tram": made_estimates.write_tram,
    "sam3d_body": made_estimates.write_sam3d_body,
    "mediapipe_world": made_estimates.write_mediapipe,
}
PLACE_OF_KNEE = {"sam3d_body": (11, 70), "mediapipe_world": (25, 33)}
# Each frame's camera is turned a little further from the first one's.
TURNS = torch.arange(made_estimates.FRAMES)[:, None] * torch.tensor([0.0, 0.1, 0.05])
TURNED = exp(TURNS).double().numpy()


def video(kind: str, frames: int = made_estimates.FRAMES) -> VideoKeypoints:
    box = made_estimates.PERFORMER.box_px[np.minimum(np.arange(frames), made_estimates.FRAMES - 1)]
    return made_keypoints(
        np.arange(frames), size=made_estimates.SIZE, initial="given", initial_format=kind,
        confidence=np.ones((frames, 25)), person_box_px=box,
    )  # fmt: skip


def given(folder: Path, kind: str, path: Path, frames: int = made_estimates.FRAMES) -> Any:
    declared = {"id": "v1", "keypoints": "k", "fps": 30.0, "size": made_estimates.SIZE}
    declared |= {"initial": path.name, "initial_format": kind}
    context = Context(
        stage="initial_smpl", seed=0, reads=frozenset(("initial",)),
        progress=lambda share, what: None, report=folder,
        _action=Action(folder, "made", (Declaration(**declared),)),
    )  # fmt: skip
    return estimate_of(context, video(kind, frames), torch.as_tensor(TURNED))


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_arrives(kind: str, tmp_path: Path) -> None:
    found = given(tmp_path, kind, WRITERS[kind](tmp_path))
    if isinstance(found, torch.Tensor):
        expected = made_estimates.PERFORMER.R.copy()
        expected[:, 0] = TURNED @ expected[:, 0]
        np.testing.assert_allclose(found.numpy(), expected, atol=1e-5)
    else:
        known = np.isfinite(found).all(axis=(0, 2))
        assert known.sum() in (12, 13, 24)
        knee, place, count = SMPL_JOINTS.index("left_knee"), *PLACE_OF_KNEE[kind]
        expected = np.einsum(
            "tij,tj->ti",
            TURNED,
            made_estimates.joints_of(made_estimates.PERFORMER, count)[:, place],
        )
        np.testing.assert_allclose(found[:, knee], expected, atol=1e-9)


def test_the_projects_own_joints_are_in_the_first_cameras_axes(tmp_path: Path) -> None:
    joints = made_estimates.joints_of(made_estimates.PERFORMER, 8)
    np.savez(tmp_path / "joints.npz", joints=joints, joint_names=np.array(SMPL_JOINTS[:8]))
    found = given(tmp_path, "joints_npz", tmp_path / "joints.npz")
    np.testing.assert_array_equal(found[:, :8], joints)


def test_frames_without_an_estimate_lie_between_their_neighbours(tmp_path: Path) -> None:
    """Frame 2 is missing: half way from 1 to 3."""
    path = made_estimates.write_wham(tmp_path, frame_ids=np.array([0, 1, 20, 3, 4, 5]))
    found = given(tmp_path, "wham", path)
    ahead = found[1].transpose(-1, -2) @ found[2]
    torch.testing.assert_close(ahead, found[2].transpose(-1, -2) @ found[3], atol=1e-5, rtol=0)
    assert found.isfinite().all()


def test_what_action_yaml_may_name_is_read_and_nothing_else_is() -> None:
    assert set(get_args(InitialFormat)) == {"smpl_npz", *JOINT_READERS, *ROTATIONS}
    assert set(get_args(DetectionFormat)) == set(FORMATS)
    assert set(get_args(Layout)) <= set(layouts())


def test_the_body_is_placed_where_the_keypoints_are() -> None:
    """Rotations alone: depth and place come from the picture."""
    body = Body.of(load_free_body(), "body25")
    theta = 0.1 * np.random.default_rng(0).normal(size=(8, 24, 3))
    R_local = exp(torch.as_tensor(theta))
    R_local[:, 0] = exp(torch.tensor([np.pi, 0.0, 0.0], dtype=torch.float64)) @ R_local[:, 0]
    trans = torch.tensor([0.3, 0.1, 4.0], dtype=torch.float64).expand(8, 3)
    xyz = (
        body.model.shape(torch.zeros(1, 10).double()).pose(R_local, trans).keypoints(body.keypoints)
    )
    K = np.array([[600.0, 0, 320], [0, 600.0, 180], [0, 0, 1]])
    xy = (xyz / xyz[..., 2:]).numpy() @ K.T
    observation = Observation(xy[..., :2], np.ones(xy.shape[:2]), K, 30.0, noise_share=0.01)
    prior = load_pose_prior()
    library = make_library(body, prior, np.random.default_rng(0), poses=2, directions=2)
    (start,) = starts(body, library, observation, R_local, None, None, InitialSmplParams())
    assert torch.equal(start.R_local, R_local)
    assert float((start.trans - trans).norm(dim=-1).max()) < 0.25  # weak perspective, 4 m away
