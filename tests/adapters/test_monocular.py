"""The fit of a video depends on that video alone, and an action's result on its videos' fits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.lifter import LifterRow, markdown, write_table
from imocap_core.adapters.monocular import (
    ANY,
    SingleVideo,
    fit_single_video,
    joined,
    least_cost,
    lifted_joints,
    pose_libraries,
    starts,
    with_sides,
)
from imocap_core.artifacts import codec
from imocap_core.artifacts.schemas import (
    AlternativeMotion,
    InitialSmpl,
    StartFit,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.body import load_free_body
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import EVAL_12, SMPL_JOINTS, mirror_indices
from imocap_core.metrics.position import pa_mpjpe_mm, root_relative
from imocap_core.motion.monocular.starts import make_library
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body
from imocap_core.params import InitialSmplParams, Params
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
    stride = single.stride(options)
    assert stride == 3
    costs = [start.cost for start in beside.starts]
    assert least_cost(beside.starts, single.frames, stride) == min(costs) / 3


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
        )

    result = joined([fit(0), fit(1)], ["v1", "v2"])
    assert result.videos == made.bent
    assert result.source == made.initial.source
    assert [(start.video, start.cost) for start in result.starts] == [("v1", 3.0), ("v2", 4.0)]
    assert [other.motion.id for other in result.alternatives] == ["v1", "v2"]


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


SWAPPED_FRAMES, FIRST, END, REACH = 20, 8, 15, 2
NAMES = layout_names("coco17")


def observation() -> Observation:
    rng = np.random.default_rng(4)
    return Observation(
        xy_px=rng.normal(200.0, 50.0, (SWAPPED_FRAMES, len(NAMES), 2)),
        confidence=rng.uniform(0.3, 1.0, (SWAPPED_FRAMES, len(NAMES))),
        K=np.diag([500.0, 500.0, 1.0]),
        fps=30.0,
        noise_share=0.01,
    )


def test_the_stretch_is_swapped_and_its_ends_count_nothing() -> None:
    given, states = observation(), np.zeros(SWAPPED_FRAMES, dtype=int)
    states[FIRST:END] = 3  # above the hips and the legs
    swapped = with_sides(given, states, NAMES, REACH)
    twins = list(mirror_indices(NAMES))
    inside = np.arange(FIRST, END)
    np.testing.assert_array_equal(swapped.xy_px[inside], given.xy_px[inside][:, twins])
    np.testing.assert_array_equal(
        np.delete(swapped.xy_px, inside, 0), np.delete(given.xy_px, inside, 0)
    )
    near = [*range(FIRST - REACH, FIRST + REACH), *range(END - REACH, END + REACH)]
    assert (swapped.confidence[near] == 0).all()
    middle = slice(FIRST + REACH, END - REACH)
    np.testing.assert_array_equal(swapped.confidence[middle], given.confidence[middle][:, twins])


def test_nothing_swapped_changes_nothing() -> None:
    given = observation()
    same = with_sides(given, np.zeros(SWAPPED_FRAMES, dtype=int), NAMES, REACH)
    np.testing.assert_array_equal(same.xy_px, given.xy_px)
    np.testing.assert_array_equal(same.confidence, given.confidence)
