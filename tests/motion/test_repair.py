"""Left and right that a detector exchanged for a moment are put right by the other videos."""

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.conventions import mirror_indices
from imocap_core.motion.multiview.repair import with_sides_of_others
from imocap_core.motion.multiview.scene import Cameras, Scene
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.motion.multiview.timeline import Timeline
from imocap_core.motion.state import MotionState
from tests.motion.made import FRAMES, Made, mpjpe_mm
from tests.motion.test_smpl_ba import OPTIONS, disturbed, in_own_axes, whole

VIDEO = 0  # filmed from in front, where left and right lie far apart
STRETCH = np.arange(FRAMES) // 8 == 1  # frames 8 to 15
PARTS = {"legs": ("hip", "knee", "ankle", "foot", "toe", "heel"), "body": ("",)}


def confused(scene: Scene, part: str = "body", frames: np.ndarray = STRETCH) -> Scene:
    """The scene whose detector exchanged the sides of one video, or of its legs, for a while."""
    observations, names = list(scene.observations), scene.body.keypoints.names
    twins = mirror_indices(names)
    legs = [any(p in name for p in PARTS[part]) for name in names]
    order = np.where(legs, twins, np.arange(len(names)))
    o = observations[VIDEO]
    xy_px, confidence = o.xy_px.copy(), o.confidence.copy()
    xy_px[frames], confidence[frames] = o.xy_px[frames][:, order], o.confidence[frames][:, order]
    observations[VIDEO] = replace(o, xy_px=xy_px, confidence=confidence)
    return replace(scene, observations=observations)


def same_observations(a: Scene, b: Scene) -> None:
    for one, other in zip(a.observations, b.observations, strict=True):
        np.testing.assert_array_equal(one.xy_px, other.xy_px)
        np.testing.assert_array_equal(one.confidence, other.confidence)


@pytest.mark.parametrize("part", PARTS)
def test_the_exchanged_stretch_is_put_right_and_nothing_else(made: Made, part: str) -> None:
    motion, plain = disturbed(in_own_axes(made), 0.03), whole(made)
    given = confused(plain, part)
    assert (given.observations[VIDEO].xy_px != plain.observations[VIDEO].xy_px).any()
    same_observations(with_sides_of_others(given, motion, made.cameras()), plain)


def test_what_lasts_is_another_facing(made: Made) -> None:
    motion = disturbed(in_own_axes(made), 0.03)
    given = confused(whole(made), frames=np.ones(FRAMES, dtype=bool))
    same_observations(with_sides_of_others(given, motion, made.cameras()), given)


def test_of_two_videos_neither_tells_whose_legs_are_exchanged(made: Made) -> None:
    """Exact poses: those of the one other video would speak for exchanged legs."""
    motion, scene, cameras = in_own_axes(made), confused(whole(made), "legs"), made.cameras()
    parts = ("to_reference", "from_reference", "confidence")
    two = replace(
        scene,
        observations=scene.observations[:2],
        confidences=scene.confidences[:2],
        timeline=Timeline(*(getattr(scene.timeline, part)[:2] for part in parts)),
    )
    first = Cameras(cameras.R[:2], cameras.t[:2], cameras.K[:2])
    both = MotionState.of(motion.R_local[:2], motion.trans[:2], motion.betas[:2], motion.valid[:2])
    same_observations(with_sides_of_others(two, both, first), two)


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
def test_smpl_ba_with_exchanged_sides_ends_like_the_undisturbed_one(made: Made, part: str) -> None:
    true = in_own_axes(made)
    start = disturbed(true, 0.03)
    good = solve_jointly(whole(made), start, OPTIONS)
    hit = solve_jointly(confused(whole(made), part), start, OPTIONS)
    error_mm = mpjpe_mm(made.body, good.state, true)
    assert mpjpe_mm(made.body, hit.state, true) < 1.05 * error_mm + 0.5
