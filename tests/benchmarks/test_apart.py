"""Performers on paths of their own: where each stands, from what all cameras see."""

from __future__ import annotations

import numpy as np
import pytest

from stages.benchmarks.apart import as_if_together, common_and_own, pixels_of

VIDEOS, FRAMES, JOINTS = 3, 25, 12


def looking(azimuth_deg: float) -> np.ndarray:
    a = np.radians(azimuth_deg)
    return np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])


def scene(apart_m: float, noise_px: float = 1.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    R = np.stack([looking(a) for a in (0, 70, 150)])
    K = np.tile(np.array([[1000.0, 0, 500], [0, 1000, 500], [0, 0, 1]]), (VIDEOS, 1, 1))
    body = rng.normal(0, 0.4, (FRAMES, JOINTS, 3))
    points = np.einsum("mij,nkj->mnki", R, body) + [0, 0, 5.0]
    moment = np.linspace(0, 3, FRAMES)[:, None]
    own = apart_m * np.sin(moment + rng.uniform(0, 6, (VIDEOS, 1, 3)))  # in the world
    in_camera = np.einsum("mij,mnj->mni", R, own)
    xy = np.stack([pixels_of(points[v] + in_camera[v][:, None], K[v]) for v in range(VIDEOS)])
    xy += rng.normal(0, noise_px, xy.shape)
    weight = np.full((VIDEOS, FRAMES, JOINTS), 1.0)
    return {"points": points, "R": R, "xy": xy, "weight": weight, "K": K, "own": own}


def solve(made: dict[str, np.ndarray], start_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = ("points", "R", "xy", "weight", "K")
    return common_and_own(*(made[name] for name in order), start_m, 4.0)


def test_everybody_s_place_is_found_though_paths_part() -> None:
    made = scene(0.4)
    rough = np.einsum("mij,mnj->mni", made["R"], made["own"] + 0.1)
    common, shift = solve(made, rough)
    place = common + np.einsum("mji,mnj->mni", made["R"], shift)
    assert np.linalg.norm(place - made["own"], axis=-1).mean() < 0.02
    together = [
        as_if_together(made["points"][v], made["xy"][v], made["K"][v],
                       shift[v] + common @ made["R"][v].T)
        for v in range(VIDEOS)
    ]  # fmt: skip
    here = np.stack([pixels_of(made["points"][v], made["K"][v]) for v in range(VIDEOS)])
    assert np.abs(np.stack(together) - here).mean() < 1.5


def test_one_motion_seen_by_all_leaves_hardly_a_shift_and_corrects_a_wrong_path() -> None:
    made = scene(0.0)
    made["points"] = (
        made["points"] + np.einsum("mij,j->mi", made["R"], [0.2, 0, 0.1])[:, None, None]
    )
    common, shift = solve(made, np.zeros((VIDEOS, FRAMES, 3)))
    assert np.abs(common + [0.2, 0, 0.1]).max() < 0.02
    assert np.abs(shift).max() < 0.01


def test_a_video_that_shows_nothing_has_no_shift_and_no_say() -> None:
    made = scene(0.3)
    made["weight"][2] = 0
    made["xy"][2] = 1e4
    start = np.einsum("mij,mnj->mni", made["R"], made["own"])
    common, shift = solve(made, start)
    assert shift[2] == pytest.approx(np.zeros((FRAMES, 3)))
    place = common + np.einsum("mji,mnj->mni", made["R"], shift)
    assert np.linalg.norm(place - made["own"], axis=-1)[:2].mean() < 0.03


def test_outliers_of_the_detector_are_left_out() -> None:
    made = scene(0.4)
    made["xy"][:, :, 0] += 80
    start = np.einsum("mij,mnj->mni", made["R"], made["own"])
    common, shift = solve(made, start)
    place = common + np.einsum("mji,mnj->mni", made["R"], shift)
    assert np.linalg.norm(place - made["own"], axis=-1).mean() < 0.02
