"""The loop's time axis is that of the video which the first joint motion makes the reference, and
its videos are those that this motion says."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from imocap_core.adapters.joint import JointProblem, problem_of
from imocap_core.adapters.loop_sync import LoopBeginning, LoopSync
from imocap_core.adapters.synchronisation import summary_of
from imocap_core.artifacts.schemas import Sync, SyncSummary
from imocap_core.motion.multiview.alternation import LoopRound
from imocap_core.motion.multiview.scene import JointMotion
from imocap_core.params import Params
from imocap_core.params.motion_params import RefineParams
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.sync import Hints
from stages import refine_sync
from tests.report.made import Made

FRAMES = 50


@pytest.fixture(scope="module")
def made() -> Made:
    made = Made(count=3, frames=FRAMES)
    exact = [
        m.model_copy(update={"reference_frame": np.where((f < FRAMES), f.astype(float), np.nan)})
        for m, f in zip(made.sync.maps, made.frames, strict=True)
    ]
    made.sync = made.sync.model_copy(update={"maps": exact})
    return made


@pytest.fixture
def choose(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes a video, by number, the one that is central and covers the others."""
    where = "imocap_core.sync.joint_synchronisation.chosen_reference"

    def to_choose(video: int) -> None:
        monkeypatch.setattr(where, lambda *_: video)

    return to_choose


def loop_sync_of(made: Made) -> LoopSync:
    """Without hints; all videos at normal speed."""
    return LoopSync(
        made.keypoints, made.camera_motion, made.initial, Params().sync, Hints(), np.ones(3),
        by_pictures=True, event=False, sound_start_s=None, declared=[None] * 3,
        rng=lambda: np.random.default_rng(0),
    )  # fmt: skip


def problem_with(made: Made, first: SyncSummary) -> JointProblem:
    params = Params()
    given = (made.keypoints, made.camera_motion, made.initial, first, params.fit, params.motion)
    return problem_of(*given)


def begun(made: Made) -> tuple[LoopBeginning, Sync | None, JointProblem, JointMotion]:
    first = summary_of(made.sync)
    problem = problem_with(made, first)
    motion = problem.solution(made.single)

    def never(sync: SyncSummary) -> tuple[JointProblem, JointMotion]:
        raise AssertionError("the videos are the same")

    loop_sync = loop_sync_of(made)
    begin = LoopRound(first, motion, 1.0, 0.0)
    beginning, sync = loop_sync.beginning(problem, begin, never)
    after = loop_sync.of_motion(beginning, beginning.single_pass.motion)
    assert after.reference == beginning.single_pass.sync.reference
    return beginning, sync, problem, motion


def test_the_axis_stays_where_the_joint_motion_chooses_the_same_video(
    made: Made, choose: Any
) -> None:
    choose(0)
    beginning, sync, problem, motion = begun(made)
    assert not beginning.moved
    assert beginning.problem is problem
    assert beginning.single_pass.motion is motion
    assert sync is not None
    assert sync.reference == "v1"


def test_the_axis_moves_with_the_first_correspondences_and_the_cameras(
    made: Made, choose: Any
) -> None:
    choose(1)
    beginning, sync, _, motion = begun(made)
    assert beginning.moved
    assert sync is None  # on the old axis no longer, on the new one not yet
    first, cameras = beginning.single_pass.sync, beginning.single_pass.motion.cameras
    assert first.reference == "v2"
    assert beginning.problem.scene.reference == 1
    for v, sync_map in enumerate(first.maps):
        apart = sync_map.reference_frame - (made.frames[v] - 2)  # v2 starts two frames late
        assert np.isfinite(apart).sum() > FRAMES - 5
        assert np.nanmedian(np.abs(apart)) < 0.5
    np.testing.assert_allclose(cameras.R[1], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(cameras.t[1], np.zeros(3), atol=1e-12)
    # A place before the third camera is the same before the second one, by old and new cameras.
    x = np.array([0.3, -0.2, 2.0])
    for R, t in ((c.R.numpy(), c.t.numpy()) for c in (cameras, motion.cameras)):
        world = R[2].T @ (x - t[2])
        seen = R[1] @ world + t[1]
        np.testing.assert_allclose(seen, made.R[1] @ made.R[2].T @ x, atol=1e-9)


def context(folder: Path) -> Context:
    """Of the stage, without any hints."""
    made_up = SimpleNamespace(
        event=lambda: False, hints=lambda: ((), ()), action_file=lambda: folder, device="cpu",
        progress=lambda *_: None, rng=lambda: np.random.default_rng(0),
        mirrored=lambda: dict.fromkeys(("v1", "v2", "v3")),
    )  # fmt: skip
    return cast(Context, made_up)


def test_the_stage_ends_on_the_new_axis_and_its_round_0_is_the_single_pass(
    made: Made, choose: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    choose(2)
    monkeypatch.setattr(refine_sync, "with_ground", lambda motion, *_: motion)
    inputs = Inputs(
        "refine_sync",
        {},
        {
            type(x): x
            for x in (
                *(made.keypoints, made.camera_motion, made.initial, made.sync, made.single),
                made.again,
            )
        },
    )
    params = Params(refine=RefineParams(max_rounds=1))
    result = refine_sync.run(context(tmp_path), inputs, params)
    assert (result.rounds[0].sync.reference, result.rounds[0].motion.reference) == ("v1", "v1")
    assert len(result.rounds) == 2  # the new axis is solved on, though nothing moves
    assert result.rounds[1].sync_change_frames < 0.5
    assert result.best == 1
    assert (result.sync.reference, result.motion.reference) == ("v3", "v3")
    assert [i.id for i in result.motion.videos] == made.ids
    own = result.motion.cameras[2]
    np.testing.assert_allclose(own.R, np.eye(3), atol=1e-9)
    v1 = next(m for m in result.sync.maps if m.id == "v1")
    np.testing.assert_allclose(np.nanmean(v1.reference_frame - (made.frames[0] - 4)), 0, atol=0.3)


def test_the_stage_solves_again_with_a_video_that_was_left_out(
    made: Made, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(refine_sync, "with_ground", lambda motion, *_: motion)
    notes = ["v3 seems to show another action"]
    first = made.sync.model_copy(update={"excluded": ["v3"], "notes": notes})
    given = (made.keypoints, made.camera_motion, made.initial, first, made.single, made.again)
    inputs = Inputs("refine_sync", {}, {type(x): x for x in given})
    params = Params(refine=RefineParams(max_rounds=1))
    result = refine_sync.run(context(tmp_path), inputs, params)
    assert result.rounds[0].sync.excluded == ["v3"]
    assert result.sync.excluded == []
    v3 = next(m for m in result.sync.maps if m.id == "v3")
    assert np.isfinite(v3.reference_frame).sum() > FRAMES - 6
    assert any(note.startswith("v3 at first seemed to show another") for note in result.sync.notes)
    R = {camera.id: camera.R for camera in result.motion.cameras}
    off = R["v3"] @ R["v1"].T @ (made.R[2] @ made.R[0].T).T
    assert np.degrees(np.arccos(np.clip((np.trace(off) - 1) / 2, -1, 1))) < 5
