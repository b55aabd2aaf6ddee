"""Errors over all pairs of videos: zero for the truth, and the same from whichever reference."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.stability.pair_errors import camera_pair_errors_deg, sync_pair_errors_frames
from imocap_core.artifacts.schemas import Camera, Keypoints, SyncMap, SyncSummary, VideoKeypoints
from imocap_core.io.truth import Truth, VideoTruth

OFFSETS = {"v1": 0.0, "v2": 3.0, "v3": -2.0}  # the phase of each video's first frame
FRAMES = 40


def truth(turns: dict[str, Rotation] | None = None) -> Truth:
    videos = {
        name: VideoTruth(
            joints=None,
            joint_names=(),
            phase=np.arange(FRAMES) + offset,
            K=None,
            R=None if turns is None else turns[name].as_matrix(),
            t=None,
        )
        for name, offset in OFFSETS.items()
    }
    return Truth(videos=videos, phase_end=float(FRAMES))


def keypoints() -> Keypoints:
    return Keypoints.model_construct(
        videos=[
            VideoKeypoints.model_construct(id=name, frames=np.arange(FRAMES)) for name in OFFSETS
        ]
    )


def sync(reference: str, errors: dict[str, float]) -> SyncSummary:
    """True maps but for a constant error of each video's place on the common axis."""
    frames = np.arange(float(FRAMES))
    shift = {name: OFFSETS[name] + errors[name] for name in OFFSETS}
    maps = [
        SyncMap(id=i, reference_frame=frames + s - shift[reference], confidence=np.ones(FRAMES))
        for i, s in shift.items()
    ]
    return SyncSummary.model_construct(
        reference=reference, ids=list(OFFSETS), lengths=[FRAMES] * 3, maps=maps,
        excluded=[], mirrored=[],
    )  # fmt: skip


def cameras(turns: dict[str, Rotation]) -> list[Camera]:
    return [Camera.model_construct(id=name, R=turn.as_matrix()) for name, turn in turns.items()]


def random_turns(seed: int) -> dict[str, Rotation]:
    rng = np.random.default_rng(seed)
    return {name: Rotation.random(random_state=rng) for name in OFFSETS}


@pytest.mark.parametrize("reference", list(OFFSETS))
def test_sync_errors_of_pairs_do_not_depend_on_the_reference(reference: str) -> None:
    errors = {"v1": 0.0, "v2": 0.4, "v3": -0.2}
    pairs = sync_pair_errors_frames(list(OFFSETS), sync(reference, errors), keypoints(), truth())
    assert sorted(pairs) == pytest.approx([0.2, 0.2, 0.4, 0.4, 0.6, 0.6])
    exact = sync(reference, dict.fromkeys(OFFSETS, 0.0))
    assert sync_pair_errors_frames(list(OFFSETS), exact, keypoints(), truth()) == pytest.approx(
        [0.0] * 6
    )


def test_camera_errors_of_pairs_do_not_depend_on_the_world() -> None:
    true = random_turns(1)
    world = Rotation.random(random_state=np.random.default_rng(2))
    wrong = {**true, "v2": Rotation.from_rotvec([0.0, 0.0, 0.1]) * true["v2"]}
    turned = {name: turn * world for name, turn in wrong.items()}
    expected = np.degrees([0.1, 0.0, 0.1])  # of v1 and v2, v1 and v3, v2 and v3
    for estimate in (wrong, turned):
        pairs = camera_pair_errors_deg(cameras(estimate), truth(true))
        np.testing.assert_allclose(pairs, expected, atol=1e-6)
