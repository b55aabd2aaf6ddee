"""A second look: where it is asked for, what of it is taken, and where that goes."""

import numpy as np
import pytest

from imocap_core.adapters.redetection import (
    ContradictedVideo,
    SecondLook,
    contradicted_videos,
    redetected,
    with_redetected,
)
from imocap_core.artifacts.schemas import (
    CorrectedMarks,
    Keypoints,
    Redetect,
    RedetectedVideo,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.body.layouts import layout_names
from imocap_core.motion.multiview.repair import SURE
from tests.adapters.test_joint import problem
from tests.report.made import Made

NAMES = layout_names("blazepose33")
WRIST, TIPS = NAMES.index("left_wrist"), [NAMES.index(f"left_{t}") for t in ("pinky", "index")]
LIMBS = [k for k, n in enumerate(NAMES) if n.split("_")[-1] in ("elbow", "wrist", "knee", "ankle")]
ROW, LIMIT = 2, 10.0


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=3)


def detected(made: Made) -> tuple[VideoKeypoints, VideoCameraMotion]:
    """A video of 33 points, apart from each other, whose camera moved by a few pixels."""
    grid = np.stack(np.meshgrid(np.arange(11), np.arange(3)), axis=-1).reshape(33, 2) * 25.0 + 20.0
    frames = made.keypoints.videos[0].frames
    xy_px = np.tile(grid, (len(frames), 1, 1))
    video = made.keypoints.videos[0].model_copy(
        update={
            "layout": "blazepose33",
            "xy_px": xy_px,
            "confidence": np.full(xy_px.shape[:2], 0.4),
            "corrected": CorrectedMarks(xy_px=xy_px + 1.0),
        }
    )
    H = np.tile(np.eye(3), (len(frames), 1, 1))
    H[:, 0, 2] = 5.0
    camera = made.camera_motion.videos[0].model_copy(
        update={"H_first_from_frame": H, "xy_first_px": xy_px + (5.0, 0.0)}
    )
    return video, camera


def asked(video: VideoKeypoints, *, is_lost: bool = False, away: float = 60.0) -> ContradictedVideo:
    """One frame: the others have the left wrist so far to the right of where it was detected."""
    expected = video.xy_px[[ROW]].copy()
    expected[0, WRIST, 0] += away
    wrong = np.zeros((1, 33), dtype=bool)
    wrong[0, WRIST] = not is_lost
    limit = np.full((1, 33), LIMIT)
    return ContradictedVideo("v1", np.array([ROW]), expected, limit, wrong, np.array([is_lost]))


def seen(*wrists: np.ndarray, body: np.ndarray | None = None, presence: float = 0.9) -> SecondLook:
    limbs = {kind: np.zeros((0, 2)) for kind in ("elbow", "knee", "ankle")}
    places = np.array(wrists).reshape(-1, 2)
    return SecondLook(
        limbs | {"wrist": places}, np.zeros((33, 3)) if body is None else body, presence
    )


def test_a_joint_moves_to_the_place_nearest_to_the_expected_one(made: Made) -> None:
    video, camera = detected(made)
    question = asked(video)
    expected = question.expected_px[0, WRIST]
    result = redetected(
        question, [seen(expected + 8.0, expected + (4.0, 0.0), expected - 30.0)], video, camera
    )
    assert (result.looked_at.tolist(), result.contradicted) == ([ROW], 1)
    at = dict(zip(result.point.tolist(), range(len(result.point)), strict=True))
    assert set(result.frame.tolist()) == {ROW}
    np.testing.assert_allclose(result.xy_px[at[WRIST]], expected + (4.0, 0.0))
    np.testing.assert_allclose(result.xy_first_px[at[WRIST]], expected + (9.0, 0.0))
    assert result.confidence[at[WRIST]] == SURE
    assert [result.confidence[at[tip]] for tip in TIPS] == [0.0, 0.0]
    assert len(at) == 4  # the thumb, too


@pytest.mark.parametrize(("place", "away"), [(LIMIT + 1.0, 60.0), (8.0, 15.0)])
def test_what_lies_too_far_or_hardly_nearer_is_not_taken(made, place, away):
    video, camera = detected(made)
    question = asked(video, away=away)
    answer = seen(question.expected_px[0, WRIST] + (place, 0.0))
    result = redetected(question, [answer], video, camera)
    assert (len(result.frame), result.contradicted) == (0, 1)
    assert len(redetected(question, [seen()], video, camera).frame) == 0


@pytest.mark.parametrize(
    ("shift", "presence", "is_taken"), [(3.0, 0.9, True), (3.0, 0.4, False), (40.0, 0.9, False)]
)
def test_somebody_who_was_lost_is_taken_whole_where_they_are_expected(
    made, shift, presence, *, is_taken
):
    video, camera = detected(made)
    question = asked(video, is_lost=True, away=0.0)
    body = np.column_stack([question.expected_px[0] + shift, np.full(33, 0.6)])
    result = redetected(question, [seen(body=body, presence=presence)], video, camera)
    assert len(result.frame) == (33 if is_taken else 0)
    if is_taken:
        np.testing.assert_allclose(result.xy_px, body[:, :2])
        np.testing.assert_allclose(result.confidence, 0.6)


def test_what_was_taken_stands_in_the_place_of_what_was_detected(made: Made) -> None:
    video, camera = detected(made)
    new = RedetectedVideo(
        id="v1", looked_at=np.array([ROW]), contradicted=1,
        frame=np.array([ROW]), point=np.array([WRIST]),
        xy_px=np.array([[9.0, 8.0]]), xy_first_px=np.array([[14.0, 8.0]]),
        confidence=np.array([0.55]),
    )  # fmt: skip
    keypoints = Keypoints(videos=[video, *made.keypoints.videos[1:]])
    cameras = made.camera_motion.model_copy(
        update={"videos": [camera, *made.camera_motion.videos[1:]]}
    )
    given, warped = with_redetected(keypoints, cameras, Redetect(videos=[new], note=""))
    changed = np.zeros(video.confidence.shape, dtype=bool)
    changed[ROW, WRIST] = True
    after, moving = given.videos[0], warped.videos[0]
    for before, values, wanted in (
        (video.xy_px, after.xy_px, [9.0, 8.0]),
        (video.marks_px, after.marks_px, [9.0, 8.0]),
        (camera.xy_first_px, moving.xy_first_px, [14.0, 8.0]),
        (video.confidence, after.confidence, 0.55),
    ):
        np.testing.assert_array_equal(values[ROW, WRIST], wanted)
        np.testing.assert_array_equal(values[~changed], before[~changed])
    assert given.videos[1:] == keypoints.videos[1:]
    assert with_redetected(keypoints, cameras, Redetect(videos=[], note="none"))[0] is keypoints


def hit(made: Made, video: int, rows: slice, confidence: float = 0.4) -> Made:
    """The scene with the left wrist of one video detected a third of the picture away."""
    column = layout_names("body25").index("left_wrist")
    given = made.keypoints.videos[video]
    xy_px = given.xy_px.copy()
    xy_px[rows, column] += (80.0, 0.0)
    doubtful = given.confidence.copy()
    doubtful[rows, column] = confidence
    changed = Made(count=3)
    videos, cameras = list(made.keypoints.videos), list(made.camera_motion.videos)
    videos[video] = given.model_copy(update={"xy_px": xy_px, "confidence": doubtful})
    cameras[video] = cameras[video].model_copy(update={"xy_first_px": xy_px})
    changed.keypoints = Keypoints(videos=videos)
    changed.camera_motion = made.camera_motion.model_copy(update={"videos": cameras})
    return changed


def test_frames_with_a_contradicted_limb_are_asked_for(made: Made) -> None:
    wrong = hit(made, 1, slice(4, 7))
    joint = problem(wrong)
    motion = joint.solution(made.single)
    (question,) = contradicted_videos(joint, motion, made.ids)
    wrist = layout_names("body25").index("left_wrist")
    assert (question.id, question.rows.tolist()) == ("v2", [4, 5, 6])
    assert np.argwhere(question.is_contradicted).tolist() == [[n, wrist] for n in range(3)]
    detected_px = made.keypoints.videos[1].xy_px[4:7]  # where it had not been moved
    away = np.linalg.norm(question.expected_px - detected_px, axis=-1)
    assert np.median(away) < 5.0
    assert contradicted_videos(joint, motion, ["v1", "v3"]) == []
    assert contradicted_videos(problem(made), motion, made.ids) == []
    sure = problem(hit(made, 1, slice(4, 7), confidence=0.8))
    assert contradicted_videos(sure, motion, made.ids) == []


def test_nobody_is_asked_for_in_a_mirrored_video(made: Made) -> None:
    wrong = hit(made, 1, slice(4, 7))
    mirrored = problem(wrong, mirrored=["v2"])
    motion = mirrored.solution(made.single)
    assert "v2" not in [one.id for one in contradicted_videos(mirrored, motion, made.ids)]


def test_frames_in_which_nobody_was_detected_are_asked_for(made: Made) -> None:
    given = made.keypoints.videos[2]
    xy_px, confidence = given.xy_px.copy(), given.confidence.copy()
    xy_px[3], confidence[3] = np.nan, 0.0
    changed = Made(count=3)
    videos, cameras = list(made.keypoints.videos), list(made.camera_motion.videos)
    videos[2] = given.model_copy(update={"xy_px": xy_px, "confidence": confidence})
    cameras[2] = cameras[2].model_copy(update={"xy_first_px": xy_px})
    changed.keypoints = Keypoints(videos=videos)
    changed.camera_motion = made.camera_motion.model_copy(update={"videos": cameras})
    joint = problem(changed)
    (question,) = contradicted_videos(joint, joint.solution(made.single), made.ids)
    assert (question.id, question.rows.tolist(), question.is_lost.tolist()) == ("v3", [3], [True])
