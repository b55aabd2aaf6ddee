"""The cost model finds what costs were made of; made actions are what they claim."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.cost import (
    DETECTION_S,
    DOLLARS_A_CORE_HOUR,
    FPS,
    MBIT_PER_S,
    TERMS,
    CostModel,
    fitted,
    models_of,
    of_actions,
    scaled,
)
from benchmarks.cost_action import SIZE, ActionSize, made_clip
from benchmarks.cost_stages import STAGES, CostTimer, StageCost, make_store, processor_seconds
from benchmarks.parallel import LineDisplay
from imocap_core.artifacts.store import cached_results
from imocap_core.pipeline.make_demo import demo_body

TRUTH = CostModel(dict(zip(TERMS, (1.5, 0.4, 0.03, 2e-4, 0.2, 5e-6), strict=True)))
SIZES = [(2, 100, 25), (2, 300, 18), (4, 150, 25), (8, 150, 33), (4, 600, 25), (16, 300, 25)]
SIZES += [(8, 1000, 25)]


def row(size: tuple[int, int, int], stage: str, seconds: float) -> StageCost:
    return StageCost(*size, stage, seconds, seconds, 100.0 + size[0] * size[1], 2.0 * seconds, 1.0)


def rows() -> list[StageCost]:
    return [
        row(size, stage, factor * TRUTH.at(size))
        for size in SIZES
        for stage, factor in (("sync", 1.0), ("smpl_ba", 3.0))
    ]


def test_a_model_finds_the_coefficients_and_an_unseen_size() -> None:
    model = fitted(SIZES, [TRUTH.at(size) for size in SIZES])
    assert model.coefficients == pytest.approx(TRUTH.coefficients, rel=1e-6)
    assert model.at((12, 700, 25)) == pytest.approx(TRUTH.at((12, 700, 25)))


def test_no_coefficient_is_negative() -> None:
    falling = [100.0 / (size[0] * size[1]) for size in SIZES]
    assert min(fitted(SIZES, falling).coefficients.values()) >= 0.0


def test_costs_of_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match="expected positive"):
        fitted(SIZES, [0.0] * len(SIZES))


def test_an_action_is_the_sum_of_its_stages_and_its_peak_the_largest() -> None:
    measured = rows()
    measured[0] = replace(measured[0], peak_mb=5000.0)
    cost = of_actions(measured)[SIZES[0]]
    assert cost.processor_s == pytest.approx(4 * TRUTH.at(SIZES[0]))
    assert cost.peak_mb == 5000.0
    assert models_of(rows()).at(SIZES[2]).stored_mb == pytest.approx(8 * TRUTH.at(SIZES[2]))


def test_many_actions_are_so_many_times_one() -> None:
    models, size = models_of(rows()), (8, 300, 25)
    cost = scaled(models, 1000, size)
    assert cost.detection_h == pytest.approx(1000 * 2400 * DETECTION_S / 3600)
    assert cost.stages_h == pytest.approx(1000 * models.at(size).processor_s / 3600)
    assert cost.core_dollars == pytest.approx(
        DOLLARS_A_CORE_HOUR * (cost.detection_h + cost.stages_h)
    )
    assert cost.films_gb == pytest.approx(2400 / FPS * MBIT_PER_S / 8)
    assert cost.hours(2) == pytest.approx(cost.hours(1) / 2)


def test_a_made_clip_has_its_frames_and_keypoints_in_the_picture() -> None:
    clip = made_clip(ActionSize(3, 24, "coco18"), 2, demo_body(7))
    assert clip.detections.xy_px.shape == (24, 18, 2)
    inside = ((clip.xy_px > 0) & (clip.xy_px < np.array(SIZE))).all(axis=-1)
    assert inside.mean() > 0.9
    assert np.all(np.diff(clip.motion.phase) > 0)


def test_a_timer_records_what_was_used_since_it_began() -> None:
    timer = CostTimer(LineDisplay(), ActionSize(2, 5))
    timer.begin()
    began = processor_seconds()
    while processor_seconds() < began + 0.1:
        pass
    timer.end("sync", 3_000_000)
    assert timer.rows[0].processor_s > 0.09
    assert timer.rows[0].stored_mb == 3.0
    assert timer.rows[0].keypoints == 25


def test_a_made_store_is_one_to_the_program(tmp_path: Path) -> None:
    make_store(tmp_path, 3)
    results = cached_results(tmp_path)
    assert len(results) == 3 * STAGES
    assert all(result.in_use for result in results)
