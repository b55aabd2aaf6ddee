"""Posteriors against dense inverses, numeric derivatives and made truth; the model's error; what
videos leave open is named."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.gauss_newton import linearise
from imocap_core.motion.motion_posterior import (
    CommonEvidence,
    CommonPosterior,
    MotionPosterior,
    PerVideoFit,
    PosteriorPiece,
    common_evidence,
    common_posterior,
    motion_posterior,
    nearest_reference,
    per_video_fits,
    per_video_posterior,
    with_common_motion,
)
from imocap_core.motion.multiview import per_video
from imocap_core.motion.multiview.per_video import per_video_terms
from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.normal import NormalEquations
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
from imocap_core.motion.posterior_noise import (
    LASTING_FACTOR,
    PLACE_SD_M,
    Noise,
    claimed_covariance_m2,
    claimed_rotation_sd,
    claimed_rotations_deg2,
    joint_jacobian,
    vector_covariance,
)
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms.base import Tempered
from imocap_core.params import UncertaintyParams
from imocap_core.rotations import log
from tests.motion.made import (
    FRAMES,
    TURNS_DEG,
    WEIGHTS,
    Made,
    mpjpe_mm,
    result_at,
    scene,
    wide_prior,
)
from tests.motion.test_smpl_ba import OPTIONS, disturbed, in_own_axes, whole

# Made noise is independent from frame to frame.
WHITE = Noise(UncertaintyParams(correlation_s=1 / 30, pose_persistence_s=1 / 30))


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(FRAMES, TURNS_DEG, np.random.default_rng(5), noise_px=3.0)


@pytest.fixture(scope="module")
def given(made: Made) -> tuple[Scene, JointMotion]:
    """A scene and its result."""
    all_ = whole(made)
    return all_, solve_jointly(all_, disturbed(in_own_axes(made), 0.05), OPTIONS)


def few(made: Made, frames: int) -> tuple[Scene, MotionState]:
    """The first frames of the reference alone."""
    o = replace(
        made.observations[0],
        xy_px=made.observations[0].xy_px[:frames],
        confidence=made.observations[0].confidence[:frames],
    )
    state = in_own_axes(made).of_motion(0, frames)
    return replace(whole(made), observations=[o]), state


def posterior_of(fit: PerVideoFit) -> tuple[PosteriorPiece, Tensor]:
    """Of all its frames, which are one piece, and the information about the shape."""
    (piece,), schur = per_video_posterior(fit, lambda piece: piece)
    return piece, schur


def dense(normal: NormalEquations) -> Tensor:
    """The whole normal matrix of one motion: frames first, then globals."""
    _, frames, n, m = normal.border.shape
    H = torch.zeros(frames * n + m, frames * n + m, dtype=torch.float64)
    for step, blocks in enumerate((normal.diagonal, normal.next1, normal.next2)):
        for t in range(frames - step):
            a, b = slice(t * n, t * n + n), slice((t + step) * n, (t + step + 1) * n)
            H[a, b] = blocks[0, t]
            H[b, a] = blocks[0, t].T
    side = normal.border[0].reshape(-1, m)
    H[: frames * n, frames * n :], H[frames * n :, : frames * n] = side, side.T
    H[frames * n :, frames * n :] = normal.corner[0]
    return H


def test_joint_covariances_are_those_of_the_dense_inverse(made: Made) -> None:
    frames = 4
    one, state = few(made, frames)
    honest = WHITE.scene(one, 1)
    own, schur = posterior_of(per_video_fits(honest, state, None, OPTIONS, WHITE)[0])
    by_frame, by_shape = joint_jacobian(made.body, state)
    claim = vector_covariance(by_frame, by_shape, own.given_shape, own.response)
    found = claim.covariance(torch.linalg.inv(schur))
    inverse = torch.linalg.inv(dense(linearise(per_video_terms(honest, state.trans), state)))
    for t in range(frames):
        at = [*range(t * FRAME_UNKNOWNS, (t + 1) * FRAME_UNKNOWNS), *range(-10, 0)]
        C = inverse[at][:, at]
        rows = torch.cat([by_frame[t], by_shape[t]], -1)
        expected = rows @ C @ rows.mT
        torch.testing.assert_close(found[t], expected, rtol=0.0, atol=1e-5 * float(expected.max()))


def test_the_gain_is_what_a_displaced_common_motion_does(given: tuple[Scene, JointMotion]) -> None:
    all_, result = given
    evidence = common_evidence(all_, result, OPTIONS)
    own, _ = posterior_of(
        per_video_fits(WHITE.scene(all_, 3), result.state, evidence, OPTIONS, WHITE)[1]
    )
    size = torch.linalg.eigvals(own.gain).abs()
    assert float(size.max()) < 1.3  # follows, never overshoots by much
    elbow = own.gain[FRAMES // 2, 3 * 18 : 3 * 18 + 3, 3 * 18 : 3 * 18 + 3]
    assert 0.05 < float(elbow.trace()) / 3 < 1.0
    still, _ = posterior_of(
        per_video_fits(WHITE.scene(all_, 3), result.state, None, OPTIONS, WHITE)[1]
    )
    assert float(still.gain.abs().max()) == 0.0
    drop = torch.linalg.eigvalsh(still.given_shape - own.given_shape)
    assert float(drop.min()) > -1e-8  # to know the common motion never hurts


def test_the_gain_follows_the_whole_of_the_coupling(given: tuple[Scene, JointMotion]) -> None:
    """A persistent displacement of the common motion pulls every frame by the coupling's matrix, by
    which the rotations of a limb's joints belong together."""
    all_, result = given
    evidence = common_evidence(all_, result, OPTIONS)
    fit = per_video_fits(WHITE.scene(all_, 3), result.state, evidence, OPTIONS, WHITE)[1]
    own, _ = posterior_of(fit)
    frames = fit.state.valid.shape[1] * FRAME_UNKNOWNS
    H = dense(linearise(fit.terms, fit.state))[:frames, :frames]
    pull = linearise(fit.couplings, fit.state).diagonal[0]
    expected = torch.linalg.solve(H, pull.flatten(0, 1)).unflatten(0, (-1, FRAME_UNKNOWNS))
    torch.testing.assert_close(own.gain, expected, rtol=0.0, atol=1e-6)
    elbow, shoulder = slice(3 * 18, 3 * 18 + 3), slice(3 * 16, 3 * 16 + 3)
    assert float(pull[:, elbow, shoulder].abs().max()) > 0.1 * float(pull[:, elbow, elbow].max())


def test_the_covariance_in_camera_axes_is_the_numeric_derivative(given):
    all_, result = given
    evidence = common_evidence(all_, result, OPTIONS)
    posterior = common_posterior(WHITE.scene(all_, 1), evidence, WHITE)
    motion, v, step = posterior.evidence.motion, 2, 1e-6
    size = motion.unknown_globals
    for k in range(10, size):
        one_hot = torch.zeros(size, dtype=torch.float64)
        one_hot[k] = 1.0
        lone: CommonPosterior = replace(
            posterior,
            given_globals=torch.zeros_like(posterior.given_globals),
            response=torch.zeros_like(posterior.response),
            globals_=one_hot[:, None] * one_hot,
        )
        moved = motion.retract(
            torch.zeros(1, FRAMES, FRAME_UNKNOWNS, dtype=torch.float64), step * one_hot[None]
        )
        before, after = (_in_camera(m, posterior.free.index(v)) for m in (motion, moved))
        turn = log(before[0].mT @ after[0]) / step
        shift = (after[1] - before[1]) / step
        column = torch.cat([turn, shift], -1)
        seen = lone.in_camera_axes(v)
        rows = [0, 1, 2, 72, 73, 74]
        expected = column[:, :, None] * column[:, None]
        assert torch.allclose(seen[:, rows][:, :, rows], expected, atol=1e-4)


def _in_camera(motion: MotionState, camera: int) -> tuple[Tensor, Tensor]:
    """Root orientation (N, 3, 3) and path (N, 3) in a free camera's axes."""
    R, t = motion.camera_R[0, camera], motion.camera_t[0, camera]
    return R @ motion.R_local[0, :, 0], motion.trans[0] @ R.T + t


def evidence_at_truth(made: Made) -> CommonEvidence:
    """The evidence for the true motions' mean, its spread estimated."""
    result = result_at(in_own_axes(made), made.cameras())
    return common_evidence(whole(made), with_common_motion(whole(made), result, OPTIONS), OPTIONS)


def test_without_a_common_motion_one_is_fitted(made: Made) -> None:
    evidence = evidence_at_truth(made)
    assert mpjpe_mm(made.body, evidence.motion, made.state) < 25.0


def test_the_common_motion_s_covariance_is_the_dense_inverse_s(made: Made) -> None:
    posterior = common_posterior(WHITE.scene(whole(made), 1), evidence_at_truth(made), WHITE)
    motion = posterior.evidence.motion
    inverse = torch.linalg.inv(dense(linearise(posterior.terms, motion)))
    expected = torch.stack(
        [
            inverse[t * FRAME_UNKNOWNS :, t * FRAME_UNKNOWNS :][:FRAME_UNKNOWNS, :FRAME_UNKNOWNS]
            for t in range(FRAMES)
        ]
    )
    found = posterior.in_camera_axes(0)  # the reference: the world's axes
    scale = expected.diagonal(dim1=-2, dim2=-1).sqrt()
    error = (found - expected).abs() / (scale[:, :, None] * scale[:, None])
    assert float(error.max()) < 1e-3


def test_claims_are_honest_on_a_made_scene(made: Made, given: tuple[Scene, JointMotion]) -> None:
    all_, result = given
    found = motion_posterior(all_, result, OPTIONS, WHITE)
    joints, true = (
        made.body.positions(made.body.joints, s).numpy() for s in (result.state, in_own_axes(made))
    )
    joints, true = (x - x[:, :, 1:3].mean(2, keepdims=True) for x in (joints, true))
    sigma = np.sqrt(np.einsum("vtjxx->vtj", np.stack(found.covariances_m2)))
    seen = [4, 5, 7, 8, 16, 17, 18, 19, 20, 21]  # knees, ankles, arms
    ratio = np.linalg.norm(joints - true, axis=-1)[..., seen] / sigma[..., seen]
    assert 0.4 < float(np.sqrt((ratio**2).mean())) < 2.0


@pytest.mark.long
def test_persistent_errors_count_less(given: tuple[Scene, JointMotion]) -> None:
    all_, result = given
    slow = Noise(replace(WHITE.params, correlation_s=0.3))
    pairs = [
        motion_posterior(all_, result, OPTIONS, noise).covariances_m2[0] for noise in (WHITE, slow)
    ]
    narrow, wide = (np.einsum("tjxx->", x) for x in pairs)
    assert 1.3 < wide / narrow < 9.0


def test_a_tempered_term_is_its_share(made: Made) -> None:
    one, state = few(made, 3)
    term = per_video_terms(one, state.trans)[0]
    whole_, part = (linearise([t], state) for t in (term, Tempered(term, 0.25)))
    assert torch.allclose(part.diagonal, 0.25 * whole_.diagonal)
    assert torch.allclose(part.border, 0.25 * whole_.border)
    assert torch.allclose(Tempered(term, 0.25).cost(state), 0.25 * term.cost(state))


def test_frames_without_a_match_take_their_neighbours_place() -> None:
    at = nearest_reference(np.array([np.nan, 2.2, np.nan, 6.6, np.nan]), 7)
    assert at.tolist() == [2, 2, 4, 6, 6]
    assert nearest_reference(np.full(3, np.nan), 7).tolist() == [0, 0, 0]


def posterior() -> np.ndarray:
    roots = np.random.default_rng(0).normal(0, 0.02, (3, 24, 3, 3))
    return np.asarray(roots @ roots.swapaxes(-1, -2))


def claims(posterior_m2: np.ndarray, one_motion: bool) -> np.ndarray:
    return claimed_covariance_m2(posterior_m2, one_motion=one_motion, lasting_m=0.0)


def test_claims_of_performances_are_never_below_the_posterior() -> None:
    given = posterior()
    assert np.linalg.eigvalsh(claims(given, one_motion=False) - given).min() > -1e-12


def test_no_joint_of_one_motion_is_surer_than_its_place_in_the_body() -> None:
    claimed = claims(np.zeros((3, 24, 3, 3)), one_motion=True)
    np.testing.assert_allclose(claimed, np.broadcast_to(PLACE_SD_M**2 * np.eye(3), claimed.shape))


@pytest.mark.parametrize("one_motion", [False, True])
def test_lasting_errors_of_a_detector_are_left_of_one_motion_and_of_several(one_motion):
    given, left = posterior(), (LASTING_FACTOR * 0.01) ** 2 * np.eye(3)
    for claim, least in ((claimed_covariance_m2, left), (claimed_rotations_deg2, np.eye(3))):
        more, usual = (claim(given, one_motion=one_motion, lasting_m=x) for x in (0.01, 0.0))
        assert np.linalg.eigvalsh(more - usual - least).min() > -1e-12


def test_one_motion_is_claimed_with_smaller_errors_where_these_are_large() -> None:
    one, several = (claims(100 * posterior(), one_motion=x) for x in (True, False))
    assert np.linalg.eigvalsh(several).max() > np.linalg.eigvalsh(one).max()


@pytest.mark.parametrize("one_motion", [False, True])
def test_claims_turn_with_the_axes(one_motion: bool) -> None:
    given, turn = posterior(), Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
    turned = claims(turn @ given @ turn.T, one_motion)
    np.testing.assert_allclose(turned, turn @ claims(given, one_motion) @ turn.T, atol=1e-15)


def test_a_camera_that_is_unknown_stays_unknown() -> None:
    assert np.isnan(claimed_rotation_sd(np.nan))
    assert claimed_rotation_sd(0.02) == pytest.approx(2 * claimed_rotation_sd(0.01))
    assert claimed_rotation_sd(0.01) >= 0.01


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


def posterior_at_truth(made: Made, seen: Scene) -> tuple[MotionPosterior, ViewpointReport]:
    """At the truth."""
    result = result_at(in_own_axes(made), made.cameras())
    found = motion_posterior(seen, result, OPTIONS, NOISE)
    share = {"evidence_share": NOISE.evidence_share(FPS)}
    return found, viewpoint_report(seen, result, found, **share)


def test_near_identical_views_are_named_and_a_camera_across_helps_less_where_one_is() -> None:
    without, with_it = (
        posterior_at_truth(*looked_at([0.0, 8.0, *other], frames=10))[1] for other in ([], [90.0])
    )
    for left_open, across in ((without, False), (with_it, True)):
        assert [(p.a, p.b) for p in left_open.pairs] == [(0, 1)]
        assert left_open.pairs[0].angle_deg == pytest.approx(8, abs=0.5)
        assert left_open.across == [across]
    sides = [k for k, a in enumerate(AZIMUTHS_DEG) if a in (90, 270)]
    assert (with_it.reductions[sides] < 0.8 * without.reductions[sides]).all()


def test_a_missing_side_is_the_one_that_helps_most() -> None:
    made, seen = looked_at([0.0, 15.0, -15.0], frames=10)
    _, left_open = posterior_at_truth(made, seen)
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
    _, left_open = posterior_at_truth(made, seen)
    assert left_open.pairs == []
    helps = dict(zip(AZIMUTHS_DEG, left_open.reductions, strict=True))
    assert max(helps, key=lambda a: helps[a]) in (90, 270)


def test_a_video_without_any_match_has_claims_but_no_place() -> None:
    made, seen = looked_at([0.0, 80.0, -70.0], matched=2)
    found, left_open = posterior_at_truth(made, seen)
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
        np.sqrt(np.einsum("tjxx->tj", posterior_at_truth(made, seen)[0].covariances_m2[0]))
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
