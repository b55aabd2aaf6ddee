"""What no video shows is named: depth along one line of sight, and hidden limbs."""

import numpy as np
import pytest

from imocap_core.artifacts.schemas import Keypoints, LeftOutVideo, SmplBa
from imocap_core.body.layouts import layout_names
from imocap_core.diagnostics.action_verdict import verdict_of
from imocap_core.diagnostics.detection_findings import (
    ONE_LINE_DEG,
    hidden_findings,
    left_out_findings,
    sight_lines,
    widest_angle_deg,
)
from imocap_core.rotations import exp
from tests.diagnostics.test_action_verdict import with_sync
from tests.report.made import Made

torch = pytest.importorskip("torch")


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


@pytest.mark.parametrize("angle", [ONE_LINE_DEG - 1, ONE_LINE_DEG + 1])
def test_videos_from_one_side_are_never_called_faultless(angle: float) -> None:
    made = Made(3)
    refined = with_sync(made).model_copy(update={"motion": seen_across(made, angle)})
    verdict = verdict_of(made.keypoints, None, refined, made.claimed)
    one_side = angle < ONE_LINE_DEG
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
