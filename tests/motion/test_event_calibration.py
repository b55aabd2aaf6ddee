"""Cameras calibrated from a made event: the truth is recovered, the fast path has a slow twin."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation

from imocap_core.motion import event_calibration
from imocap_core.motion.event_calibration import calibrate, derivatives, project, reduced
from imocap_core.motion.event_clock import clock_of
from imocap_core.motion.event_rig import CAMERA, OFFSET, RATE, CameraRig
from tests.motion.event.made_event import disturbed, made_problem, true_rig


def camera_errors_deg(rig: CameraRig, truth: CameraRig) -> np.ndarray:
    turned = Rotation.from_matrix(rig.R @ truth.R.swapaxes(1, 2)).magnitude()
    return np.degrees(turned)[1:]


def test_exact_keypoints_give_the_true_cameras() -> None:
    truth, rng = true_rig(), np.random.default_rng(0)
    problem = made_problem(truth, rng)
    solved = calibrate(problem, disturbed(truth, rng))
    assert camera_errors_deg(solved.rig, truth).max() < 0.5
    assert np.abs(solved.rig.offset - truth.offset).max() < 0.1
    assert solved.rig.focal_px == pytest.approx(truth.focal_px, rel=0.03)
    assert (solved.rig.distortion == 0).all()


def test_errors_are_those_that_are_claimed() -> None:
    truth, rng = true_rig(), np.random.default_rng(1)
    problem = made_problem(truth, rng, noise_px=4.0, bias_share=0.01)
    solved = calibrate(problem, disturbed(truth, rng))
    off = np.stack([np.log(solved.rig.focal_px / truth.focal_px), solved.rig.offset - truth.offset])
    normalised = (off / np.maximum(solved.sd[:, [6, 8]].T, 1e-9))[:, 1:]
    assert 0.2 < np.sqrt((normalised**2).mean()) < 2.5
    assert camera_errors_deg(solved.rig, truth).max() < 3.0


@pytest.mark.long
def test_biases_of_the_detector_are_told_from_the_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, rng = true_rig(), np.random.default_rng(2)
    problem = made_problem(truth, rng, noise_px=1.0, bias_share=0.01)
    start = disturbed(truth, rng)
    with_biases = calibrate(problem, start).rig
    monkeypatch.setattr(event_calibration, "BIAS_SHARE", 1e-5)
    blamed = calibrate(problem, start).rig
    assert (
        camera_errors_deg(with_biases, truth).mean() < 0.8 * camera_errors_deg(blamed, truth).mean()
    )


def test_bent_lenses_are_found_where_they_are_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_calibration, "DISTORTION_SPREAD", 0.3)
    truth, rng = true_rig(distortion=-0.3), np.random.default_rng(3)
    problem = made_problem(truth, rng, noise_px=1.0)
    solved = calibrate(problem, disturbed(truth, rng))
    certain = solved.rig.distortion[solved.rig.distortion != 0]
    assert len(certain) >= 2  # one that is not certain counts as straight
    assert certain == pytest.approx(-0.3, abs=0.15)
    assert camera_errors_deg(solved.rig, truth).max() < 1.5


def test_a_known_focal_length_stays_keypoints_may_be_missing_and_videos_short() -> None:
    truth, rng = true_rig(), np.random.default_rng(5)
    problem = made_problem(truth, rng, noise_px=1.0)
    hidden = problem.videos[1].xy_px.copy()
    hidden[:, 3] = np.nan
    videos = list(problem.videos)
    videos[1] = replace(videos[1], xy_px=hidden)
    short = videos[2]
    videos[2] = type(short)(short.xy_px[:19], short.weight[:19], short.size_px[:19])
    start, known = disturbed(truth, rng), np.array([0.0, 0.15, 0.15, 0.15])
    start.K[0] = truth.K[0]
    solved = calibrate(replace(problem, videos=videos, focal_log_sd=known), start)
    assert camera_errors_deg(solved.rig, truth).max() < 1.5
    assert solved.rig.focal_px[0] == truth.focal_px[0]
    assert solved.sd[0, 6] == 0


def test_derivatives_are_finite_differences() -> None:
    truth, rng = true_rig(distortion=-0.1), np.random.default_rng(6)
    problem = made_problem(truth, rng, noise_px=0.0)
    rig = replace(disturbed(truth, rng), distortion=np.full(4, -0.05))
    rig = replace(rig, points=rig.points[8:9])
    problem = replace(problem, moments=problem.moments[8:9])
    slopes = derivatives(rig, problem.samples(rig), project(rig, problem.samples(rig)),
                         problem.moments)  # fmt: skip
    for v in range(4):

        def residual(step: np.ndarray, v: int = v) -> float:
            globals_ = np.zeros(CAMERA * 4 + rig.bias.size + len(problem.bones))
            globals_[CAMERA * v : CAMERA * (v + 1)] = step
            moved = rig.moved(globals_, np.zeros_like(rig.points))
            return float(project(moved, problem.samples(moved)).error_px[0, 4, v, 0])

        numeric = approx_fprime(np.zeros(CAMERA), residual, 1e-6)
        analytic = slopes.camera[0, 4, v, 0, :CAMERA]
        assert analytic[:OFFSET] == pytest.approx(numeric[:OFFSET], rel=1e-3, abs=1e-2)
        # the slope of the regression, whose weights move with the moment
        assert analytic[OFFSET] == pytest.approx(numeric[OFFSET], rel=0.15, abs=1.0)
        assert analytic[RATE] == pytest.approx(8 * analytic[OFFSET])


def test_eliminating_the_points_gives_the_step_of_the_whole_system() -> None:
    truth, rng = true_rig(), np.random.default_rng(7)
    problem = made_problem(truth, rng, noise_px=1.0)
    problem = replace(problem, moments=problem.moments[8:11])
    rig = disturbed(truth, rng)
    rig = replace(rig, points=rig.points[8:11])
    system = reduced(problem, rig, 1e-3)
    globals_, points = system.step(1e-3)
    lowered = problem.cost(rig.moved(0.01 * globals_, 0.01 * points))
    expected = 0.02 * float(np.dot(full_gradient(problem, rig), np.r_[globals_, points.ravel()]))
    assert lowered - problem.cost(rig) == pytest.approx(expected, rel=0.05)
    assert expected < 0


def full_gradient(problem, rig: CameraRig) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Half the gradient of the cost by all unknowns, by differences."""
    count = CAMERA * 4 + rig.bias.size + len(problem.bones)

    def cost(step: np.ndarray) -> float:
        moved = rig.moved(step[:count], step[count:].reshape(rig.points.shape))
        return problem.cost(moved) / 2

    steps = np.eye(count + rig.points.size) * 1e-6
    return np.array([(cost(s) - cost(-s)) / 2e-6 for s in steps])


def test_the_size_of_the_world_is_that_of_the_bones() -> None:
    truth = true_rig()
    larger = truth.with_lengths_of(1.2 * truth.lengths)
    assert larger.lengths == pytest.approx(1.2 * truth.lengths)
    assert larger.centre_m == pytest.approx(1.2 * truth.centre_m)
    problem = made_problem(truth, np.random.default_rng(9))
    errors = [project(rig, problem.samples(rig)).error_px for rig in (truth, larger)]
    assert errors[0] == pytest.approx(errors[1], abs=1e-6)


def test_the_offset_is_what_most_matches_agree_on() -> None:
    reference = np.arange(100.0)
    other = np.arange(100.0) + 7.3 + 0.3 * np.sin(np.arange(100))
    other[60:] += 25.0  # a repetition later
    clock = clock_of([reference, other], [np.ones(100), np.ones(100)], [30.0, 30.0], 0)
    assert clock.offset == pytest.approx([0.0, -7.3], abs=0.1)
    assert clock.agreement == pytest.approx([1.0, 0.6])


def test_frame_rates_that_differ() -> None:
    seconds = np.arange(50) / 24.0 + 0.5
    clock = clock_of([np.arange(90.0), 30 * seconds], [np.ones(90), np.ones(50)], [30.0, 24.0], 0)
    assert clock.rate == pytest.approx([1.0, 0.8])
    assert clock.offset[1] == pytest.approx(-12.0, abs=0.01)
    lines = clock.reference_frames(1, 50, 89)
    inside = 30 * seconds <= 89.5
    assert lines[inside] == pytest.approx(np.minimum(30 * seconds[inside], 89.0))
    assert np.isnan(lines[~inside]).all()


def test_sound_decides_where_it_tells() -> None:
    maps = [np.arange(60.0), np.arange(60.0) + 4, np.arange(60.0) + 2]
    begun = np.array([10.0, 10.2, np.nan])
    clock = clock_of(maps, [np.ones(60)] * 3, [30.0] * 3, 0, begun)
    assert clock.offset == pytest.approx([0.0, -6.0, -2.0])
    assert clock.agreement == pytest.approx([1.0, 1.0, 1.0])


def test_a_video_without_matches_has_no_offset() -> None:
    clock = clock_of([np.arange(10.0), np.full(10, np.nan)], [np.ones(10)] * 2, [30.0] * 2, 0)
    assert np.isnan(clock.offset[1])
    assert clock.agreement[1] == 0
