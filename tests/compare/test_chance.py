"""Differences between two sets of performances: what chance explains, and what it does not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imocap_core.compare.compare import describe, pair_angles, pair_on_one_axis, performances_of
from imocap_core.compare.parts import LIKELY, Chance, chance_of, pair_findings
from tests.pipeline.made_result import made_result

N, ANGLES = 40, ("knee", "elbow", "hip")


def performances(count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Smooth curves of one kind: a mean, and deviations of 6 degrees that last."""
    t = np.linspace(0, np.pi, N)
    waves = np.stack([np.ones(N), np.cos(t), np.sin(t)])
    return {a: 60 * np.sin(t) + rng.normal(0, 6, (count, 3)) @ waves for a in ANGLES}


def test_sets_of_one_kind_differ_by_more_than_chance_in_one_of_twenty() -> None:
    rng = np.random.default_rng(0)
    least = [
        min(chance_of(performances(5, rng), performances(5, rng), rng).p.values())
        for _ in range(200)
    ]
    assert 0.01 <= np.mean(np.array(least) <= LIKELY) <= 0.08


def test_an_angle_that_differs_is_found_and_the_others_are_not() -> None:
    rng = np.random.default_rng(1)
    first, second = performances(6, rng), performances(6, rng)
    second["elbow"] = second["elbow"] + 25
    chance = chance_of(first, second, rng)
    assert chance.p["elbow"] <= 0.01
    assert min(chance.p["knee"], chance.p["hip"]) > LIKELY


def test_the_probability_does_not_depend_on_which_set_is_first_nor_on_unseen_moments() -> None:
    rng = np.random.default_rng(2)
    first, second = performances(4, rng), performances(5, rng)
    there, back = chance_of(first, second, rng), chance_of(second, first, rng)
    assert there.p == pytest.approx(back.p)
    cut = {a: np.where(np.arange(N) < N - 5, x, np.nan) for a, x in first.items()}
    shorter = [{a: x[:, : N - 5] for a, x in of.items()} for of in (first, second)]
    assert chance_of(cut, second, rng).p == pytest.approx(chance_of(*shorter, rng).p)


@pytest.mark.parametrize(("ours", "theirs", "least"), [(4, 4, 2 / 70), (3, 4, 1 / 35), (3, 3, 0.1)])
def test_the_least_probability_is_that_of_one_division(ours, theirs, least):
    rng = np.random.default_rng(3)
    chance = chance_of(performances(ours, rng), performances(theirs, rng), rng)
    assert chance.least == pytest.approx(least)
    assert min(chance.p.values()) >= least - 1e-12
    assert chance.telling == (least <= LIKELY)


def test_one_against_one_tells_nothing() -> None:
    rng = np.random.default_rng(4)
    chance = chance_of(performances(1, rng), performances(1, rng), rng)
    assert set(chance.p.values()) == {1.0}
    assert not chance.telling


def test_a_difference_that_chance_or_the_expected_error_explains_says_so(tmp_path: Path) -> None:
    first = describe(performances_of(made_result(tmp_path).result()))
    pair = pair_on_one_axis(first, first)
    angles = pair_angles(pair)
    moved = {n: replace(c, mean_deg=c.mean_deg + 20) for n, c in angles[1].mean.items()}
    angles = angles[0], replace(angles[1], mean=moved)

    def sentences(p: float, error: float) -> set[str]:
        errors = {n: np.full((2, len(first.instances.phase_s)), error) for n in moved}
        told = replace(first, performances=replace(first.performances, error_deg=errors))
        found = replace(pair, first=told, second=told)
        chance = Chance(dict.fromkeys(moved, p), 0.01)
        return {f.sentence.rpartition(" s, ")[2] for f in pair_findings(found, angles, chance)}

    assert sentences(0.3, 1.0) == {"which chance explains (p = 0.30)"}
    assert sentences(0.02, 8.0) == {"within twice the expected error (± 11°)"}
    assert sentences(0.02, 1.0) == {"more than chance explains (p = 0.02)"}
