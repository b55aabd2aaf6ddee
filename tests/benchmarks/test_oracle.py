"""The oracle: true correspondences and cameras, the same fitter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks.scoring.oracle import fit_with_cameras, true_cameras, true_sync
from imocap_core.artifacts.schemas import SyncMap
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
from imocap_core.io.truth import Truth, VideoTruth
from tests.motion.made import mpjpe_mm, scene
from tests.motion.test_smpl_ba import FRAMES, OPTIONS, in_own_axes, made, whole  # noqa: F401


def summary(reference: str = "b") -> SyncSummary:
    maps = [SyncMap(id=i, reference_frame=np.zeros(n), confidence=np.ones(n)) for i, n in LENGTHS]
    return SyncSummary(
        reference=reference,
        ids=[i for i, _ in LENGTHS],
        lengths=[n for _, n in LENGTHS],
        maps=maps,
        method="softmap",
        centrality=np.ones(2),
        status="",
    )


LENGTHS = [("a", 4), ("b", 3)]
SWING = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])


def known_truth() -> Truth:
    def video(phase: list[float], R: np.ndarray, t: list[float]) -> VideoTruth:
        return VideoTruth(None, (), np.eye(3), R, np.array(t), np.array(phase))

    a = video([0.0, 1.0, 2.0, 9.0], SWING, [0.0, 0.0, 4.0])
    return Truth({"a": a, "b": video([0.0, 2.0, 4.0], np.eye(3), [1.0, 0.0, 3.0])}, 4.0)


def test_the_oracle_s_frames_are_where_phases_are_equal() -> None:
    wrong = summary().model_copy(update={"excluded": ["a"], "mirrored": ["a"]})
    sync = true_sync(wrong, known_truth())
    assert (sync.excluded, sync.mirrored) == ([], [])
    assert sync.maps[0].reference_frame[:3].tolist() == [0.0, 0.5, 1.0]
    assert np.isnan(sync.maps[0].reference_frame[3])
    assert sync.maps[0].confidence.tolist() == [1, 1, 1, 0]
    assert sync.maps[1].reference_frame.tolist() == [0, 1, 2]


def test_the_oracle_s_cameras_see_a_world_point_where_the_true_ones_do() -> None:
    truth = known_truth()
    cameras = true_cameras(true_sync(summary(), truth), truth)
    point = np.array([0.3, -0.2, 0.5])
    in_reference = point + [1.0, 0.0, 3.0]
    assert torch.equal(cameras.R[1], torch.eye(3, dtype=torch.float64))
    in_camera = cameras.R[0].numpy() @ in_reference + cameras.t[0].numpy()
    assert in_camera == pytest.approx(SWING @ point + [0.0, 0.0, 4.0])


def test_the_oracle_s_fit_leaves_the_cameras_alone(made) -> None:  # noqa: F811
    scene, true = whole(made), in_own_axes(made)
    cameras = made.cameras()
    start = replace(true, trans=true.trans + 0.05)
    motion = fit_with_cameras(scene, start, cameras, replace(OPTIONS, max_steps=3))
    assert torch.equal(motion.cameras.R, cameras.R)
    assert torch.equal(motion.cameras.t, cameras.t)
    assert mpjpe_mm(made.body, motion.state, true) < 10


def test_the_oracle_of_one_video_is_its_monocular_fit(made) -> None:  # noqa: F811
    true = in_own_axes(made)
    alone = replace(whole(made), observations=made.observations[:1])
    cameras = made.cameras(1)
    start = true.rows(torch.tensor([0]))
    assert fit_with_cameras(alone, start, cameras, OPTIONS).state is start


def test_true_cameras_tell_how_large_somebody_is() -> None:
    """Cameras 8 % farther apart and farther away see the same of a body 8 % larger."""
    seen = scene(FRAMES, [0.0, 90.0, 180.0, -90.0], np.random.default_rng(5))
    given, cameras, truth = whole(seen), seen.cameras(), in_own_axes(seen)
    given = replace(given, fit=replace(given.fit, size_prior=1e5))
    apart = replace(cameras, t=1.08 * cameras.t)
    start = replace(truth, trans=1.08 * truth.trans)
    found = fit_with_cameras(given, start, apart, OPTIONS)
    joints = seen.body.model.shape(found.state.betas[:1]).joints_rest[0]
    limbs = [(1, 4), (4, 7), (2, 5), (5, 8), (16, 18), (18, 20), (17, 19), (19, 21)]
    mean = seen.body.model.joints_template
    grown = [float((joints[a] - joints[b]).norm() / (mean[a] - mean[b]).norm()) for a, b in limbs]
    assert np.mean(grown) == pytest.approx(1.08, abs=0.02)
