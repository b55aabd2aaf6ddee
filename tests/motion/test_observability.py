"""What videos leave open is found: same sides, missing sides, joints that nobody sees."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.motion_posterior import MotionPosterior, motion_posterior
from imocap_core.motion.multiview import per_video
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.observability import (
    AZIMUTHS_DEG,
    ViewpointReport,
    angles_deg,
    near_pairs,
    performer_axes,
    seen_across,
    view_directions,
    viewpoint_report,
    weak_spans,
)
from imocap_core.motion.posterior_noise import Noise
from imocap_core.params import UncertaintyParams
from tests.motion.made import FRAMES, WEIGHTS, Made, result_at, scene, wide_prior
from tests.motion.test_smpl_ba import OPTIONS, in_own_axes

NOISE = Noise(UncertaintyParams(correlation_s=0.1, pose_persistence_s=0.1))
FPS = 30.0


def looked_at(
    turns_deg: list[float],
    unseen: dict[int, slice] | None = None,
    *,
    matched: int | None = None,
    frames: int = FRAMES,
) -> tuple[Made, Scene]:
    """Cameras at these turns about the performer; keypoints that no video sees for a while; videos
    from ``matched`` on correspond to nothing."""
    made = scene(frames, turns_deg, np.random.default_rng(5))
    observations = []
    for o in made.observations:
        confidence = o.confidence.copy()
        for keypoint, span in (unseen or {}).items():
            confidence[span, keypoint] = 0.0
        observations.append(replace(o, confidence=confidence))
    maps = [np.arange(float(frames)) for _ in turns_deg]
    for unmatched in maps[matched or len(maps) :]:
        unmatched[:] = np.nan
    trust = [np.isfinite(m).astype(float) for m in maps]
    timeline = make_timeline(maps, trust, frames)
    return made, Scene(made.body, wide_prior(), observations, timeline, trust, 0, WEIGHTS)


def posterior(made: Made, seen: Scene) -> tuple[MotionPosterior, ViewpointReport]:
    """At the truth."""
    result = result_at(in_own_axes(made), made.cameras())
    found = motion_posterior(seen, result, OPTIONS, NOISE)
    share = {"near_limit_deg": 20, "evidence_share": NOISE.evidence_share(FPS)}
    return found, viewpoint_report(seen, result, found, OPTIONS, **share)


def test_near_identical_views_are_named_and_a_camera_across_helps_less_where_one_is() -> None:
    without, with_it = (
        posterior(*looked_at([0.0, 8.0, *other], frames=10))[1] for other in ([], [90.0])
    )
    for left_open, across in ((without, False), (with_it, True)):
        assert [(p.a, p.b) for p in left_open.pairs] == [(0, 1)]
        assert left_open.pairs[0].angle_deg == pytest.approx(8, abs=0.5)
        assert left_open.across == [across]
    sides = [k for k, a in enumerate(AZIMUTHS_DEG) if a in (90, 270)]
    assert (with_it.reductions[sides] < 0.8 * without.reductions[sides]).all()


def test_a_missing_side_is_the_one_that_helps_most() -> None:
    made, seen = looked_at([0.0, 15.0, -15.0], frames=10)
    _, left_open = posterior(made, seen)
    helps = dict(zip(AZIMUTHS_DEG, left_open.reductions, strict=True))
    assert max(helps, key=lambda a: helps[a]) in (90, 270)
    assert helps[90] > 1.5 * helps[0]
    assert helps[270] > 1.5 * helps[180]
    assert all(0 < share < 1 for share in helps.values())
    assert left_open.by_performer
    off_front = (left_open.azimuths_deg + 180) % 360 - 180
    assert np.abs(off_front).max() < 30  # all three film the performer's front


def test_one_video_is_told_to_add_a_side() -> None:
    made, seen = looked_at([0.0])
    _, left_open = posterior(made, seen)
    assert left_open.pairs == []
    helps = dict(zip(AZIMUTHS_DEG, left_open.reductions, strict=True))
    assert max(helps, key=lambda a: helps[a]) in (90, 270)


def test_a_video_without_any_match_has_claims_but_no_place() -> None:
    made, seen = looked_at([0.0, 80.0, -70.0], matched=2)
    found, left_open = posterior(made, seen)
    assert left_open.pairs == []  # nor are views from different sides near each other
    assert all(np.isfinite(c).all() for c in found.covariances_m2)
    together, alone = (np.einsum("tjxx->", found.covariances_m2[v]) for v in (1, 2))
    assert alone > together
    assert np.isfinite(left_open.azimuths_deg).tolist() == [True, True, False]
    assert np.isfinite(left_open.reductions).all()


@pytest.mark.long
@patch.object(per_video, "LEAST_SPREAD_M", (0.01, 0.01))  # performances that differ
def test_a_joint_that_nobody_sees_for_a_while_is_ill_determined_then() -> None:
    made, all_seen = looked_at([0.0, 80.0])
    keypoint = made.body.model.points("body25").names.index("left_wrist")
    span = slice(6, 14)
    _, partly = looked_at([0.0, 80.0], {keypoint: span})
    before, after = (
        np.sqrt(np.einsum("tjxx->tj", posterior(made, seen)[0].covariances_m2[0]))
        for seen in (all_seen, partly)
    )
    left, right = SMPL_JOINTS.index("left_wrist"), SMPL_JOINTS.index("right_wrist")
    assert (after[span, left] > 1.3 * before[span, left]).all()
    assert after[:, right] == pytest.approx(before[:, right], rel=0.2)
    middle = slice(2, 17)  # both ends of a clip are less certain anyway
    named = weak_spans(after[middle][:, [left]], 1.3 * float(before[span, left].max()), FPS)
    assert [s.joint for s in named] == [0]
    assert 6 <= 2 + named[0].first <= 8
    assert 11 <= 2 + named[0].last <= 13


def test_spans_close_to_each_other_are_one_and_short_ones_none() -> None:
    sigma = np.ones((60, 2))
    sigma[10:20, 0] = sigma[23:30, 0] = 5.0
    sigma[50:52, 0] = 9.0
    sigma[40:50, 1] = 7.0
    sigma[5, 1] = np.nan
    found = weak_spans(sigma, 2.0, FPS)
    assert [(s.joint, s.first, s.last) for s in found] == [(1, 40, 49), (0, 10, 29)]
    assert found[0].sigma == pytest.approx(7)


def test_directions_are_those_of_the_cameras() -> None:
    made, seen = looked_at([0.0, 40.0])
    result = result_at(in_own_axes(made), made.cameras())
    angles = angles_deg(view_directions(seen, result))
    assert angles[0, 1] == pytest.approx(40, abs=1)
    assert angles[0, 0] == pytest.approx(0, abs=1e-3)
    assert np.isnan(angles_deg(np.full((2, 3, 3), np.nan))[0, 1])
    assert near_pairs(angles, 20) == []


def test_opposite_views_do_not_look_across_each_other() -> None:
    angles = np.array([[0.0, 5.0, 175.0], [5.0, 0.0, 180.0], [175.0, 180.0, 0.0]])
    assert not seen_across(angles, 0, 1, 30.0)
    angles[0, 2] = angles[2, 0] = 120.0
    assert seen_across(angles, 0, 1, 30.0)


def test_azimuths_count_from_the_performer_s_front_to_the_left() -> None:
    made, _ = looked_at([0.0])
    ahead = np.array([0.0, 0.0, 1.0])
    stage = performer_axes(made.body, made.state, made.R, ahead)
    joints = made.body.positions(made.body.joints, made.state)[0].numpy()
    left_hip, right_hip = (joints[:, SMPL_JOINTS.index(f"{s}_hip")] for s in ("left", "right"))
    towards_left = (left_hip - right_hip).mean(0)
    assert stage.azimuth_deg(-towards_left) == pytest.approx(90, abs=15)
    assert min(stage.azimuth_deg(ahead), 360 - stage.azimuth_deg(ahead)) < 15
    assert np.allclose(stage.outward(stage.azimuth_deg(ahead)) @ stage.up, 0)
