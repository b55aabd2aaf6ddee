"""The benchmarks of the screening and of wrong starts: what is planted is what is counted."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks import screening
from benchmarks.actions.captured_videos import Choice
from benchmarks.rendered_action import is_rendered, trial_of
from benchmarks.screening_casts import mirrored_performance, occluded
from benchmarks.wrong_start import is_recovered, names_of
from benchmarks.wrong_start_cases import depth_reversed, facing_reversed
from imocap_core.artifacts.schemas import VideoMotion
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.errors import WrongUse
from imocap_core.rotations import exp, log
from imocap_core.synthetic.detector import Detections

GOOD = screening.SceneRow(
    scene="a", development=True, videos=4, asymmetric=True, clean_excluded=0, clean_flipped=0,
    stranger="v2", stranger_excluded="v2", mirrored="v3", mirrored_flipped="v3",
    mirrored_excluded="-", wrongly_treated=0, near_symmetric_flips=0,
)  # fmt: skip
BAD = replace(
    GOOD, development=False, clean_excluded=1, stranger_excluded="v1 v3", mirrored_flipped="-",
    wrongly_treated=3,
)  # fmt: skip


@pytest.mark.parametrize(("waving", "expected"), [([6], True), ([6, 11], False)])
def test_an_action_of_one_arm_is_asymmetric_and_of_both_is_not(waving, expected) -> None:
    joints = np.random.default_rng(0).normal(size=(1, 14, 3)).repeat(90, axis=0)
    joints = (joints + mirrored_performance(joints)) * [0.2, 0.5, 0.2]
    joints[:, waving, 1:] += np.sin(np.linspace(0, 9, 90))[:, None, None]
    film = SimpleNamespace(true_joints_m=joints, keypoints=SimpleNamespace(fps=15.0))
    assert screening.is_asymmetric(SimpleNamespace(films=[film] * 3)) == expected


def test_occlusion_only_takes_detections_away() -> None:
    detections = Detections(np.ones((90, 18, 2)), np.full((90, 18), 0.8))
    hidden = [occluded(detections, np.random.default_rng(seed)) for seed in range(20)]
    shares = [float((h.confidence == 0).mean()) for h in hidden]
    assert min(shares) == 0.0
    assert 0.0 < max(shares) < 0.2
    for film in hidden:
        visible = film.confidence > 0
        np.testing.assert_array_equal(film.xy_px[visible], 1.0)
        np.testing.assert_array_equal(film.xy_px[~visible], 0.0)


def test_strangers_are_mutual_and_of_another_repertoire() -> None:
    pairs = [
        (a, b) for a in screening.CLIPS for b in screening.CLIPS if screening.are_strangers(a, b)
    ]
    assert all(
        screening.are_strangers(b, a) and a.split("_")[0] != b.split("_")[0] for a, b in pairs
    )
    assert not any(a in screening.WALKS and b in screening.WALKS for a, b in pairs)
    assert {a for a, _ in pairs} == set(screening.CLIPS)


def test_counts_are_of_what_was_planted() -> None:
    rows = [GOOD, BAD]
    assert screening.genuine_treated(rows) == (3, 20)
    assert screening.clean_treated(rows) == (1, 8)
    assert screening.strangers_excluded(rows) == (1, 2)
    assert screening.mirrored_flipped(rows) == (1, 2)
    near = replace(BAD, asymmetric=False, near_symmetric_flips=1)
    assert screening.mirrored_flipped([near]) == (0, 0)
    assert screening.near_symmetric_flipped([GOOD, near]) == (1, 12)


FRAMES = 4


def motion() -> VideoMotion:
    """Some poses that face the camera, the root at the origin."""
    rng = np.random.default_rng(3)
    theta = rng.normal(0, 0.2, (FRAMES, 72))
    theta[:, :3] = [np.pi, 0.0, 0.0]
    return VideoMotion(
        id="v1",
        frames=np.arange(FRAMES),
        theta=theta,
        betas=np.zeros(10),
        trans=np.zeros((FRAMES, 3)),
        joints=joints_of(exp(torch.as_tensor(theta).reshape(-1, 24, 3))),
        reprojection_px=np.zeros(FRAMES),
    )


def joints_of(R_local: torch.Tensor) -> np.ndarray:
    """(T, 24, 3) about the root."""
    shaped = load_free_body().shape(torch.zeros(1, 10, dtype=torch.float64))
    joints = shaped.pose(R_local, torch.zeros(len(R_local), 3, dtype=torch.float64)).joints
    return (joints - joints[:, :1]).numpy()


@pytest.mark.parametrize("sides_swapped", [False, True])
def test_reversing_the_facing_twice_changes_nothing(sides_swapped: bool) -> None:
    first = motion()
    once = facing_reversed(first, sides_swapped=sides_swapped)
    again = first.model_copy(update={"theta": log(once).flatten(1).numpy()})
    twice = facing_reversed(again, sides_swapped=sides_swapped)
    np.testing.assert_allclose(joints_of(twice), first.joints, atol=1e-9)


def test_the_swap_of_sides_is_the_mirror_image_in_depth() -> None:
    reversed_m = joints_of(facing_reversed(motion(), sides_swapped=True))
    twins = list(mirror_indices(SMPL_JOINTS))
    expected = (motion().joints * np.array([1.0, 1.0, -1.0]))[:, twins]
    # the free body's left and right are alike within a few millimetres
    np.testing.assert_allclose(reversed_m, expected, atol=5e-3)


def test_depth_is_reversed_about_the_root_and_the_picture_stays() -> None:
    joints = motion().joints + np.array([0.0, 0.0, 4.0])
    reversed_m = depth_reversed(joints)
    np.testing.assert_array_equal(reversed_m[..., :2], joints[..., :2])
    np.testing.assert_allclose(reversed_m[..., 2] + joints[..., 2], 8.0, atol=1e-9)


@pytest.mark.parametrize(
    ("result_mm", "excluded", "recovered"),
    [(41.9, "", True), (42.1, "", False), (40.0, "v2", False), (30.0, "", True)],
)
def test_recovered_is_within_five_percent_with_every_view(result_mm, excluded, recovered):
    assert is_recovered(result_mm, 40.0, excluded, "") == recovered


def test_every_action_is_run_from_keypoints_and_rendered(tmp_path, monkeypatch):
    (tmp_path / "trials").mkdir()
    for name in ("one", "two"):
        np.savez(tmp_path / "trials" / f"{name}.npz")
    monkeypatch.setenv("IMOCAP_DATA", str(tmp_path))
    names = names_of(Path(), Choice("trials"))
    assert names == ["one", "two", "one-rendered", "two-rendered"]
    assert [is_rendered(name) for name in names] == [False, False, True, True]
    assert [trial_of(name) for name in names[2:]] == names[:2]
    assert names_of(Path(), Choice("trials", only=("two-rendered",))) == ["two-rendered"]
    with pytest.raises(WrongUse, match="--only nothing"):
        names_of(Path(), Choice("trials", only=("nothing",)))
