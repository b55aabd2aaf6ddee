"""What speaks against a result: collapsed time, outlying bodies, sliding feet."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.diagnostics.bodies import PlacedBody, outlying_bodies, slides
from imocap_core.diagnostics.timing import collapses
from imocap_core.sequences import runs
from tests.report.made import Made
from tests.verdict.test_same_take import performance

FPS = 30.0


def test_runs_are_maximal_and_long_enough() -> None:
    flags = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], dtype=bool)
    assert runs(flags, 2) == [(0, 1), (6, 8)]
    assert runs(flags, 2, gap=1) == [(0, 3), (6, 8)]
    assert runs(~flags | True, 1) == [(0, 8)]
    assert runs(flags & False, 1) == []


def test_a_moving_person_at_one_moment_is_a_collapse() -> None:
    position = np.arange(150.0)
    position[60:90] = 60.0
    (span,) = collapses(position, performance(), FPS)
    assert (span.first, span.last) == (60, 89)
    assert span.moment == 60.0


def test_standing_still_a_slow_replay_and_unmatched_frames_are_none() -> None:
    position = np.arange(150.0)
    position[60:90] = 60.0
    still = performance()
    still[60:90] = still[60]
    assert collapses(position, still, FPS) == []
    assert collapses(np.arange(150.0) / 8, performance(), FPS) == []
    unmatched = np.where((position >= 60) & (position < 90), np.nan, position)
    assert collapses(unmatched, performance(), FPS) == []


def bodies(made: Made) -> dict[str, PlacedBody]:
    """The made bodies in the world's axes: each as the first camera would see it."""
    return {
        v.id: PlacedBody(v.joints @ made.R[i] @ made.R[0].T, made.frames[i] / FPS, FPS)
        for i, v in enumerate(made.true)
    }


def test_equal_performances_have_no_outlying_body(made: Made) -> None:
    assert outlying_bodies(bodies(made)) == {name: [] for name in made.ids}


@pytest.mark.parametrize("turn", [np.diag([-1.0, 1.0, -1.0]), np.diag([1.0, -1.0, -1.0])])
def test_a_body_that_faces_away_or_lies_is_outlying_where_it_does(
    made: Made, turn: np.ndarray
) -> None:
    placed = bodies(made)
    joints = placed["v2"].joints.copy()
    joints[:12] = joints[:12] @ turn
    placed["v2"] = PlacedBody(joints, placed["v2"].phase_s, FPS)
    spans = outlying_bodies(placed)
    assert [(s.first, s.last) for s in spans["v2"]] == [(0, 11)]
    assert spans["v1"] == spans["v3"] == []


def test_a_foot_slides_when_it_moves_in_space_only() -> None:
    frames = 40
    ankle_m = np.tile([0.0, 0.9, 4.0], (frames, 1))
    ankle_px = np.tile([300.0, 400.0], (frames, 1))
    assert slides(ankle_m, ankle_px, 200.0, FPS) == []
    ankle_m[20:, 2] += 0.5
    (span,) = slides(ankle_m, ankle_px, 200.0, FPS)
    assert span.first <= 20 <= span.last
    assert span.last - span.first < 8
    assert span.speed_m_s > 1
    walking = ankle_px + np.arange(frames)[:, None] * [3.0, 0.0]
    assert slides(ankle_m, walking, 200.0, FPS) == []
    assert SMPL_JOINTS.index("left_ankle") == 7
