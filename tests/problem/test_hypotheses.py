"""Alternatives travel with the artifacts: a choice names them, and later stages start from them."""

from __future__ import annotations

import numpy as np

from imocap_core.adapters.hypotheses import choose_alternatives, chosen_motions
from imocap_core.adapters.joint import problem_of
from imocap_core.artifacts.schemas import AlternativeMotion
from imocap_core.params import FitParams, MotionParams
from tests.report.made import Made


def test_a_choice_replaces_the_motions_it_names_and_no_other() -> None:
    made = Made(count=3, frames=6)
    other = AlternativeMotion(name="depth", excess_cost=3.0, motion=made.true[1])
    initial = made.initial.model_copy(update={"alternatives": [other]})
    motions = chosen_motions(initial, {"v2": "depth"})
    assert motions == [made.bent[0], made.true[1], made.bent[2]]
    assert chosen_motions(initial, {}) == made.bent

    sync = made.sync.model_copy(update={"alternatives": {"v2": "depth"}})
    problem = problem_of(
        made.keypoints, made.camera_motion, initial, sync, FitParams(), MotionParams()
    )
    start = problem.start.trans[1, :6].numpy()
    np.testing.assert_allclose(start, made.true[1].trans)


def test_without_alternatives_nothing_is_chosen_or_said() -> None:
    made = Made(count=2, frames=6)
    chosen = choose_alternatives(made.initial, made.keypoints, [None, None])
    assert chosen.names == {}
    assert chosen.notes == []
