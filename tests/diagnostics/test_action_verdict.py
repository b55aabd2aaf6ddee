"""The verdict: three sentences at most, every finding with its place and its remedy."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from imocap_core.artifacts.schemas import (
    CycleTriple,
    EventCamera,
    EventCameras,
    Keypoints,
    LeftOutVideo,
    PredictedVideo,
    RefineSync,
    SyncTrust,
    Uncertainty,
    VideoKeypoints,
    Viewpoint,
)
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.diagnostics import contradictions, timing
from imocap_core.diagnostics.action_verdict import distrust, verdict_of, without_consequences
from imocap_core.diagnostics.bodies import feet_findings
from imocap_core.diagnostics.findings import (
    SENTENCES,
    Finding,
    Verdict,
    listed,
    read_verdict,
    verdict_document,
    verdict_text,
)
from imocap_core.diagnostics.same_take import said_first
from imocap_core.diagnostics.timing import DOUBTFUL_S, collapse_findings, event_sentence
from imocap_core.diagnostics.weak_joints import further_view, side_of
from imocap_core.sync.repetition import Repetitions
from tests.diagnostics.test_contradictions import performance
from tests.made_sync import trust_in
from tests.report.made import FPS, Made


def judged(made: Made, *, keypoints: Keypoints | None = None, **sync: Any) -> Verdict:
    """The verdict on the made scene with some fields of its synchronisation changed."""
    return verdict_of(
        keypoints or made.keypoints, made.camera_motion, with_sync(made, **sync), made.claimed
    )


def with_sync(made: Made, **sync: Any) -> RefineSync:
    """The made result with trust, and changed fields of its synchronisation."""
    trust = {"trust": trusted(made)} | sync
    return made.refined.model_copy(update={"sync": made.refined.sync.model_copy(update=trust)})


def trusted(made: Made, left_out_s: float = 0.01, score: float = 0.5) -> SyncTrust:
    """Phases as they are; round trips and left-out maps that agree within `left_out_s`."""
    phases = {i: frames / FPS for i, frames in zip(made.ids, made.frames, strict=True)}
    apart = {"left_out_frames": left_out_s * FPS, "left_out_s": left_out_s}
    trust = trust_in(phases, outlier_score=score, mirror_margin=0.2, **apart)
    trip = CycleTriple(videos=made.ids, frames=left_out_s * FPS, seconds=left_out_s, share=1.0)
    return trust.model_copy(update={"triples": [trip]})


def views(made: Made, azimuths: list[float], reductions: dict[float, float]) -> Uncertainty:
    """The claims with cameras at these azimuths and these benefits of one more."""
    videos = [
        v.model_copy(update={"azimuth_deg": a})
        for v, a in zip(made.claimed.videos, azimuths, strict=True)
    ]
    further = [Viewpoint(azimuth_deg=a, reduction=r) for a, r in reductions.items()]
    return made.claimed.model_copy(update={"videos": videos, "viewpoints": further})


def test_a_good_result_is_called_so(made: Made) -> None:
    verdict = judged(made)
    assert verdict.trusted
    assert verdict.level == "good"
    assert verdict.summary[0].startswith("3 videos are synchronised")
    assert "10 ms (0.3 frames)" in verdict.summary[0]
    assert "Nothing was found" in verdict.summary[1]
    assert verdict.disagreement_s == pytest.approx(0.01)


def test_a_video_that_cannot_be_used_is_named_first(made: Made) -> None:
    out = LeftOutVideo(id="v9", reason="v9.mp4: broken")
    spoiled = made.keypoints.videos[0].model_copy(update={"damaged": [(3, 7)]})
    videos = [spoiled, *made.keypoints.videos[1:]]
    verdict = judged(made, keypoints=Keypoints(videos=videos, left_out=[out]))
    assert not verdict.trusted
    assert verdict.findings[0].video == "v9"
    assert "v9.mp4: broken" in verdict.findings[0].sentence
    assert verdict.summary[0].startswith("3 of 4 videos are synchronised")
    assert any(f.place == "v1 frames 3-7" and f.serious for f in verdict.findings)


def predicted(made: Made, errors: Sequence[float], near: float = 0.95) -> Uncertainty:
    """The claims with such errors of the videos as predicted by the others."""
    given: dict[str, Any] = {"near_share": near, "monocular_error_share": 0.02, "frames": 9}
    pairs = zip(made.ids, errors, strict=True)
    rows = [PredictedVideo(id=i, error_share=error, **given) for i, error in pairs]
    return made.claimed.model_copy(update={"leave_one_out": rows})


@pytest.mark.parametrize(("error", "near"), [(0.03, 0.95), (0.06, 0.95), (0.03, 0.8)])
def test_times_by_which_the_pictures_are_predicted_are_right(
    made: Made, error: float, near: float
) -> None:
    trust, reference = trusted(made, left_out_s=2 * DOUBTFUL_S), made.ids[0]
    trust.videos[0] = trust.videos[0].model_copy(update={"left_out_s": np.nan})
    is_right = error <= contradictions.PREDICTED and near >= contradictions.PREDICTED_SHARE
    refined = with_sync(made, trust=trust)
    for but, of_first in (("", error), (f" but {reference}", 0.09)):
        claimed = predicted(made, (of_first, error, error), near)
        verdict = verdict_of(made.keypoints, made.camera_motion, refined, claimed)
        assert (f"each{but} is predicted" in verdict.summary[0]) == is_right
        assert verdict.summary[0].startswith("The timing is doubtful") != is_right
        assert verdict.level == ("good" if is_right else "doubt")


def test_of_videos_that_others_predict_only_the_rest_is_doubtful_in_time(made: Made) -> None:
    claimed = predicted(made, (0.03, 0.03, 0.09))
    refined = with_sync(made, trust=trusted(made, left_out_s=2 * DOUBTFUL_S))
    verdict = verdict_of(made.keypoints, made.camera_motion, refined, claimed)
    assert verdict.summary[0].startswith(f"The timing of {made.ids[2]} is doubtful: ")
    assert verdict.level == "doubt"


def repeating(made: Made, ratio: float, left_out_s: float = 0.01) -> SyncTrust:
    """The second video fits 1.1 s later, its squared distances so many times as large."""
    trust = trusted(made, left_out_s)
    shifted = {"repetition_s": 1.1, "repetition_ratio": ratio}
    videos = [v.model_copy(update=shifted if k == 1 else {}) for k, v in enumerate(trust.videos)]
    return trust.model_copy(update={"videos": videos})


@pytest.mark.parametrize(("left_out_s", "doubtful"), [(1.12, False), (0.6, True)])
def test_matches_that_are_a_repetition_apart_do_not_contradict_each_other(
    made: Made, left_out_s: float, doubtful: bool
) -> None:
    trust = repeating(made, 1.0, left_out_s)
    for k in (0, 2):
        trust.videos[k] = trust.videos[k].model_copy(update={"left_out_s": np.nan})
    verdict = judged(made, trust=trust)
    assert verdict.summary[0].startswith("The timing is doubtful") == doubtful
    assert ("may be matched 1.1 s off" in verdict.summary[0]) != doubtful
    assert ("contradicted" in verdict.summary[1]) == doubtful


def test_a_video_that_fits_a_repetition_later_as_well_is_named(made: Made) -> None:
    verdict = judged(made, trust=repeating(made, 1.05))
    name = made.ids[1]
    assert verdict.trusted
    assert f"the action repeats, and {name} may be matched 1.1 s off" in verdict.summary[0]
    assert verdict.level == "check"
    assert verdict.summary[1].startswith("No other fault was found")  # the first sentence warns
    (finding,) = (f for f in verdict.findings if "repeats" in f.text)
    assert finding.video == name
    assert "anchors:" in finding.remedy
    assert "repeats" not in judged(made, trust=repeating(made, 1.5)).summary[0]


@pytest.mark.parametrize(("score", "end", "named"), [(0.9, 30, 1), (0.6, 30, 0), (0.9, 20, 0)])
def test_more_repetitions_are_named(made: Made, monkeypatch: Any, score, end, named) -> None:
    cuts = iter([Repetitions(((0, 9),), 0.2, ""), Repetitions(((0, end),) * 3, score, "")])
    monkeypatch.setattr(timing, "find_picture_repetitions", lambda *_: next(cuts))
    findings = timing.count_findings(made.keypoints.videos[:2], made.camera_motion.videos, made.ids)
    expected = [("3 repetitions, fewer in v1", True)] * named
    assert [(f.brief, "`repetitions: true`" in f.remedy) for f in findings] == expected


@pytest.mark.parametrize("count", [1, 2])
def test_few_videos_are_not_called_checked(count: int) -> None:
    verdict = judged(Made(count))
    assert "nothing checks" in verdict.summary[0]
    assert verdict.disagreement_s is None


def test_a_video_left_out_is_named_with_the_way_back(made: Made) -> None:
    verdict = judged(made, excluded=["v3"], trust=trusted(made, score=1.4))
    assert verdict.summary[0].startswith("v1 and v2 are matched")
    assert "v3 (left out as another action)" in verdict.summary[1]
    assert "--set sync.outliers=report" in verdict.summary[2]
    assert "one more video" not in verdict.summary[2]


def test_a_video_whose_detections_fit_no_body_is_named(made: Made) -> None:
    verdict = judged(made, excluded=["v3"], notes=["v3 has detections that fit no body: out"])
    assert "v3 (left out: its detections fit no body)" in verdict.summary[1]
    assert "v3: use another clip instead" in verdict.summary[2]


def test_a_mirrored_video_is_named_with_the_way_back(made: Made) -> None:
    verdict = judged(made, mirrored=["v2"])
    assert "v2 (treated as mirrored)" in verdict.summary[1]
    assert "`mirrored: false` below `id: v2`" in verdict.summary[2]


def test_a_mirroring_that_the_user_declared_is_no_doubt(made: Made) -> None:
    notes = ["v2 is declared mirrored: treated as its mirror image"]
    findings = judged(made, mirrored=["v2"], notes=notes).findings
    assert not any(f.kind == "decision" for f in findings)


def test_what_was_left_out_is_no_missing_viewpoint(made: Made) -> None:
    claimed = views(made, [0.0, 10.0, 95.0], {0.0: 0.1, 90.0: 0.5, 180.0: 0.2})
    assert "the performer's left" in further_view(claimed, made.refined.sync)
    out = made.refined.sync.model_copy(update={"excluded": ["v3"]})
    assert "performer's left" not in further_view(claimed, out)
    flipped = made.refined.sync.model_copy(update={"mirrored": ["v3"]})
    assert "performer's left" not in further_view(claimed, flipped)
    unknown = views(made, [0.0, 10.0, np.nan], {0.0: 0.1, 90.0: 0.5})
    assert further_view(unknown, out) == ""


def test_a_side_is_named_only_where_one_stands_out(made: Made) -> None:
    even = views(made, [0.0] * 3, dict.fromkeys((0.0, 90.0, 180.0), 0.36))
    assert further_view(even, made.refined.sync) == (
        "one more video from any side would make the expected errors about 20% smaller"
    )
    one_side = views(made, [0.0] * 3, {0.0: 0.1, 180.0: 0.36})
    assert "from behind" in further_view(one_side, made.refined.sync)
    by_camera = one_side.model_copy(update={"azimuth_from": "camera"})
    behind = further_view(by_camera, made.refined.sync)
    assert "from behind as the reference camera sees it" in behind
    right = views(made, [0.0] * 3, {0.0: 0.1, 90.0: 0.36})  # the left hand of who faces the camera
    right = right.model_copy(update={"azimuth_from": "camera"})
    assert "from the right as the reference camera" in further_view(right, made.refined.sync)


def test_sides_are_named_as_the_performer_sees_them() -> None:
    sides = [side_of(a) for a in (0, 90, 180, 270, 359)]
    assert sides == ["in front", "left", "behind", "right", "in front"]


def test_warnings_of_the_detection_are_findings(made: Made) -> None:
    first = made.keypoints.videos[0]
    note = (
        "2 people followed; the performer is seen in 16 of 16 frames and scores 1.2 times the next "
        "(presence x size x motion); left and right of a limb put back in 9 frames; the "
        "picture of frames 16 to 20 is of another shot: left out"
    )
    gone = first.model_copy(
        update={"note": note, "fps": 10.0, "confidence": first.confidence * made_gap(16, 3, 9)}
    )
    keypoints = Keypoints(videos=[gone, *made.keypoints.videos[1:]])
    sentences = [f.sentence for f in judged(made, keypoints=keypoints).findings]
    assert any("v1: the picture of frames 16 to 20 is of another shot" in s for s in sentences)
    assert any("v1 frames 3-8: nobody is detected for 0.6 s" in s for s in sentences)
    assert any("swapped left and right of a limb 9 times" in s for s in sentences)
    assert any("another person" in s and "imocap people" in s for s in sentences)


def made_gap(frames: int, first: int, end: int) -> np.ndarray:
    """(T, 1) factors: 0 in a gap, 1 elsewhere."""
    inside = (np.arange(frames) >= first) & (np.arange(frames) < end)
    return np.where(inside, 0.0, 1.0)[:, None]


def test_a_body_beside_its_detections_is_named_with_its_frames(made: Made) -> None:
    off = np.where((np.arange(16) >= 3) & (np.arange(16) < 14), 30.0, 1.0)
    refined = with_motion(made, 1, reprojection_px=off)
    verdict = verdict_of(made.keypoints, None, refined, made.claimed)
    assert "v2 frames 5-15 (the body does not fit the picture)" in verdict.summary[1]


def with_motion(made: Made, video: int, **changed: np.ndarray) -> RefineSync:
    """The made result with changed fields of one video's motion."""
    refined = with_sync(made)
    videos = list(refined.motion.videos)
    videos[video] = videos[video].model_copy(update=changed)
    motion = refined.motion.model_copy(update={"videos": videos})
    return refined.model_copy(update={"motion": motion})


def test_a_body_unlike_all_others_is_named_with_its_frames() -> None:
    made = Made(3, frames=48)
    joints = made.final[1].joints.copy()
    middle = joints[10:30, :1]
    joints[10:30] = middle + (joints[10:30] - middle) @ np.diag([-1.0, 1.0, -1.0])
    verdict = verdict_of(made.keypoints, None, with_motion(made, 1, joints=joints), made.claimed)
    (finding,) = (f for f in verdict.findings if f.brief == "its body differs from the others")
    frames = made.keypoints.videos[1].frames
    assert (finding.video, finding.first_frame) == ("v2", frames[10])
    assert finding.last_frame == frames[29]
    assert f"v2 frames {frames[10]}-{frames[29]}" in verdict.summary[1]


def test_a_foot_that_leaps_in_depth_is_named_with_its_frames() -> None:
    made = Made(3, frames=48)
    motion, still = made.final[1], made.keypoints.videos[1]
    ankle = layout_names(still.layout).index("left_ankle")
    xy = still.xy_px.copy()
    xy[:, ankle] = xy[0, ankle]
    videos = [made.keypoints.videos[0], still.model_copy(update={"xy_px": xy})]
    videos.append(made.keypoints.videos[2])
    joints = motion.joints.copy()
    joints[:, SMPL_JOINTS.index("left_ankle")] = joints[0, SMPL_JOINTS.index("left_ankle")]
    joints[24:, SMPL_JOINTS.index("left_ankle"), 2] += 0.6
    refined = with_motion(made, 1, joints=joints)
    verdict = verdict_of(Keypoints(videos=videos), None, refined, made.claimed)
    (finding,) = (f for f in verdict.findings if f.kind == "feet" and f.video == "v2")
    leap = still.frames[24]
    assert finding.brief == "feet wrong in depth"
    assert leap - 5 <= finding.first_frame <= leap <= finding.last_frame <= leap + 5
    assert "m/s" in finding.sentence
    for kind in ("static", "translating"):
        camera = made.camera_motion.videos[1].model_copy(update={"motion": kind, "xy_first_px": xy})
        given = refined.motion.videos[1:2], {v.id: v for v in videos}, [camera]
        assert bool(feet_findings(*given)) == (kind == "static")


def test_one_cause_is_named_once(made: Made) -> None:
    whole = Finding("decision", "v1", "left out", "left out")
    part = Finding("feet", "v1", "slides", "slides", "", 3, 9)
    cause = Finding("time", "v2", "collapses", "collapses", "", 10, 20)
    inside, beside = (
        Finding("body", "v2", "differs", f"differs {a}", "", a, a + 10) for a in (12, 30)
    )
    assert without_consequences([whole, part, cause, inside, beside]) == [whole, cause, beside]
    assert distrust([whole, part, cause, inside]) == (
        "Do not trust v1 (left out) and v2 frames 10-20 (collapses)."
    )


def test_places_of_one_fault_are_named_together() -> None:
    slides = [Finding("feet", v, "slides", "slides", "", 3, 9) for v in ("v1", "v2")]
    up = Finding("up", "", "doubtful", "rolled", subject="which way is up")
    hand = Finding("hidden", "", "unseen", "no video shows it", subject="the left hand")
    assert distrust([up, *slides, hand]) == (
        "Do not trust which way is up (rolled), v1 frames 3-9 and v2 frames 3-9 (slides) and the "
        "left hand (no video shows it)."
    )


def collapsed(made: Made, frames: int, *first: int) -> list[Finding]:
    """Findings where the second video's time stops for so many frames."""
    sync, videos = with_sync(made).sync, {v.id: waving(v) for v in made.keypoints.videos}
    position = sync.maps[1].reference_frame.copy()
    for a in first:
        position[a : a + frames] = position[a]
    stopped = sync.maps[1].model_copy(update={"reference_frame": position})
    return collapse_findings(sync.model_copy(update={"maps": [sync.maps[0], stopped]}), videos)


def test_a_stopped_time_is_named_once_in_one_direction() -> None:
    made = Made(2, frames=90)
    (finding,) = collapsed(made, 30, 30)
    frames = made.keypoints.videos[1].frames
    assert (finding.first_frame, finding.last_frame) == (frames[30], frames[59])
    assert f"`forbidden: [{{video: v2, frames: [{frames[30]}, {frames[60]}]}}]`" in finding.remedy

    (finding,) = collapsed(made, 27, 2, 32, 62)
    assert finding.text.startswith("3 times it moves while its time in v1 stands still")
    assert finding.first_frame is None


def waving(video: VideoKeypoints) -> VideoKeypoints:
    """The video with limbs that move more."""
    xy = np.full_like(video.xy_px, np.nan)
    names = layout_names(video.layout)
    xy[:, [names.index(limb) for limb in contradictions.LIMBS]] = performance(frames=len(xy))
    return video.model_copy(update={"xy_px": xy})


def test_one_recording_twice_is_said_first(made: Made) -> None:
    longer = Made(2, frames=60)
    again = longer.keypoints.videos[0].model_copy(update={"id": "v2"})
    keypoints = Keypoints(videos=[longer.keypoints.videos[0], again])
    verdict = judged(longer, keypoints=keypoints)
    assert verdict.findings[0].kind == "same take"
    assert verdict.summary[0].startswith("v2 is the same recording as v1: 2 videos are one view")
    assert not any("Nothing was found" in sentence for sentence in verdict.summary)
    assert not any("v2 (the same recording" in sentence for sentence in verdict.summary)
    timing = "The timing is doubtful."
    assert said_first(timing, verdict.findings, 4) == (
        "v2 is the same recording as v1, so 4 videos are 3 views; the timing is doubtful."
    )
    assert not any(f.kind == "same take" for f in judged(longer).findings)


def test_a_verdict_comes_back_from_its_file(made: Made) -> None:
    for verdict in (judged(made), judged(made, excluded=["v3"])):
        assert read_verdict(verdict_text(verdict)) == verdict
        assert len(verdict.summary) <= SENTENCES
        assert str(verdict).splitlines() == list(verdict.summary)


@pytest.mark.parametrize(
    "change",
    [
        {"summary": "A sentence."},
        {"summary": ["A sentence.", 3]},
        {"summary": ["A sentence."] * 4},
        {"summary": ["\x1b]0;a title of the terminal\x07"]},
        {"findings": [{"kind": "time"}]},
        {"findings": [{"kind": "praise", "video": "v1", "text": "a", "brief": "a"}]},
        {"findings": [{"kind": "time", "video": "v1", "text": 3, "brief": "a"}]},
        {"findings": 3},
        {"disagreement_s": "much"},
    ],
)
def test_a_file_of_another_form_is_no_verdict(made: Made, change: dict[str, object]) -> None:
    document = verdict_document(judged(made))
    assert read_verdict(json.dumps(document)) == judged(made)
    with pytest.raises(ValueError, match="expected"):
        read_verdict(json.dumps(document | change))


@pytest.mark.parametrize("text", ["[]", "3", "{}", "[" * 100_000])
def test_other_json_is_no_verdict(text: str) -> None:
    with pytest.raises(ValueError, match="expected a verdict"):
        read_verdict(text)


def test_lists_read_as_sentences() -> None:
    assert [listed(list(w)) for w in ("", "a", "ab", "abc")] == ["", "a", "a and b", "a, b and c"]


def test_the_sentence_on_one_event_says_what_is_claimed() -> None:
    cameras = [
        EventCamera(id=i, distortion=0.0, offset_frames=0.0, rate=1.0, median_px=4.0,
                    focal_sd=0.08, rotation_sd_deg=sd, offset_sd_s=0.004)
        for i, sd in (("v1", 0.0), ("v2", 1.2), ("v3", 0.9))
    ]  # fmt: skip
    made = Made(3, frames=30)
    event = EventCameras(cameras=cameras, status="converged")
    refined = made.refined.model_copy(update={"event": event})
    verdict = verdict_of(made.keypoints, made.camera_motion, refined, made.claimed)
    assert verdict.summary[0] == (
        "3 videos of one event are synchronised to about 4 ms (0.1 frames), and their cameras are "
        "calibrated from the performer: directions to about 1.2 degrees; focal lengths to 8%."
    )
    undeclared = event.model_copy(update={"declared": False})
    assert event_sentence(event, 30.0, doubtful=True).startswith("The timing is doubtful: 3 videos")
    assert "3 videos look like one event (if not, event: false" in event_sentence(undeclared, 30.0)


@pytest.mark.parametrize("part", ["leg", "foot only", "unseen"])
def test_a_limb_detected_elsewhere_for_a_while_is_named(made: Made, part: str) -> None:
    v, frames = 1, slice(3, 9)
    video, camera = made.keypoints.videos[v], made.camera_motion.videos[v]
    names, motion = layout_names(video.layout), made.refined.motion
    xy, confidence = camera.xy_first_px.copy(), video.confidence.copy()
    joints = motion.videos[v].joints @ motion.cameras[v].K.T
    pixels = joints[..., :2] / joints[..., 2:]
    for name in SMPL_JOINTS:
        if name in names:  # the detector agrees with the body
            xy[:, names.index(name)] = pixels[:, SMPL_JOINTS.index(name)]
    confidence[:] = 0.9
    moved = ["left_big_toe"] if part == "foot only" else ["left_knee", "left_ankle"]
    for name in moved:
        xy[frames, names.index(name)] += np.ptp(pixels[:, :, 1])
        confidence[frames, names.index(name)] = 0.3 if part == "unseen" else 0.9
    number = video.frames
    findings = contradictions.contradicted_findings(
        motion,
        {
            w.id: w.model_copy(update={"confidence": confidence}) if w.id == video.id else w
            for w in made.keypoints.videos
        },
        [camera.model_copy(update={"xy_first_px": xy})],
    )
    if part != "leg":
        assert findings == []
        return
    assert [f.place for f in findings] == [f"{video.id} frames {number[3]}-{number[8]}"]
    assert findings[0].text.startswith("the left leg is detected elsewhere")
    assert findings[0].serious
