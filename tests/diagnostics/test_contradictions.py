"""One recording given twice is noticed; another performance from the same viewpoint is not."""

import numpy as np
import pytest

from imocap_core.artifacts.schemas import PredictedVideo
from imocap_core.diagnostics.contradictions import LIMBS, TWINS, prediction_findings
from imocap_core.diagnostics.same_take import same_take

FPS = (30.0, 30.0)


def performance(deviation: float = 0.0, seed: int = 0, frames: int = 150) -> np.ndarray:
    """A waving figure 200 px tall; `deviation`: smooth, as a share of its size."""
    base, rng = np.random.default_rng(5), np.random.default_rng([9, seed])
    place = base.uniform(-60, 60, (len(LIMBS), 2)) * [1, 1.6] + [300, 200]
    time = np.arange(frames)[:, None, None] / 30.0
    rate, phase = base.uniform(1, 4, (2, len(LIMBS), 2))
    figure = place + 25 * np.sin(rate * time + phase) + 20 * time * [1, 0]
    slow, offset = rng.uniform(1, 4, (2, len(LIMBS), 2))
    return figure + deviation * 200 * np.sqrt(2) * np.sin(slow * time + offset)


def at_frames(xy_px: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """The figure at fractional frames."""
    low = np.minimum(frames.astype(int), len(xy_px) - 2)
    share = (frames - low)[:, None, None]
    return (1 - share) * xy_px[low] + share * xy_px[low + 1]


@pytest.mark.parametrize("rate", [0.125, 0.5, 1.0, 2.0])
def test_a_recording_played_at_another_rate_is_the_same_take(rate: float) -> None:
    take = performance()
    frames = np.arange(0, len(take) - 1, rate)
    again = same_take(at_frames(take, frames), take, FPS, TWINS)
    assert again.rate == pytest.approx(rate, rel=0.02)
    assert again.certain
    assert not again.mirrored


def test_crop_scale_and_small_noise_do_not_hide_it() -> None:
    take = performance()
    noise = np.random.default_rng(1).normal(size=take[20:90].shape)
    smaller = 0.4 * take[20:90] - [30, 50] + 0.1 * noise
    again = same_take(smaller, take, FPS, TWINS)
    assert again.rate == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(("sway_frames", "certain"), [(0.0, True), (4.0, False)])
def test_a_noisy_copy_is_certain_by_its_clock_and_nobody_else(sway_frames, certain):
    take = performance()
    frames = np.linspace(10, 130, 121)
    frames += sway_frames * np.sin(frames / 8)  # in the performer's time, not in a recorder's
    noise = np.random.default_rng(1).normal(size=(121, *take.shape[1:]))
    again = same_take(at_frames(take, frames) + 1.4 * noise, take, FPS, TWINS)  # 0.9 % of the size
    assert again.certain == certain


def test_a_mirrored_copy_is_the_same_take() -> None:
    take = performance()
    flipped = (take * [-1, 1] + [640, 0])[:, list(TWINS)]
    again = same_take(flipped, take, FPS, TWINS)
    assert again.mirrored


@pytest.mark.parametrize("seed", range(5))
def test_another_performance_from_the_same_viewpoint_is_not(seed):
    # 3 % of the size: trials of one action by one person differ by 4 % in the median
    assert same_take(performance(0.03, seed + 1), performance(), FPS, TWINS) is None


def test_where_nothing_moves_nothing_is_claimed() -> None:
    still = np.repeat(performance()[:1], 100, axis=0)
    assert same_take(still, still, FPS, TWINS) is None


def test_missing_frames_do_not_shift_time() -> None:
    take = performance()
    gap = take.copy()
    gap[40:60] = np.nan
    again = same_take(take[::2], gap, FPS, TWINS)
    assert again.rate == pytest.approx(2.0, rel=0.02)


NAN = float("nan")


def predicted(video: str, error: float, alone: float = 0.03) -> PredictedVideo:
    return PredictedVideo(
        id=video, error_share=error, near_share=0.3, monocular_error_share=alone, frames=40
    )


@pytest.mark.parametrize(
    ("error", "alone", "named"),
    [(0.04, 0.02, False), (0.25, 0.03, True), (0.25, 0.14, False), (NAN, 0.03, False),
     (0.25, NAN, True)],
)  # fmt: skip
def test_a_bad_prediction_is_named(error: float, alone: float, named: bool) -> None:
    findings = prediction_findings([predicted("v1", error, alone)])
    assert [f.video for f in findings] == (["v1"] if named else [])


def test_the_worst_is_named_first() -> None:
    findings = prediction_findings([predicted("a", 0.12), predicted("b", 0.3)])
    assert [f.video for f in findings] == ["b", "a"]
    assert all(f.serious for f in findings)
