"""The loop's time axis is that of the video which the first joint motion makes the reference, and
its videos are those that this motion says."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from imocap_core.adapters.joint import JointProblem, is_one_motion, problem_of
from imocap_core.adapters.loop_sync import (
    LoopBeginning,
    LoopSync,
    decided_again,
    with_first_repetitions,
    with_independent_confidence,
)
from imocap_core.adapters.participants import mirrored_keypoints
from imocap_core.adapters.synchronisation import evidence_of, summary_of
from imocap_core.artifacts.schemas import Keypoints, Sync, SyncMap, SyncSummary, SyncTrust
from imocap_core.motion.multiview.alternation import Alternation, LoopRound
from imocap_core.motion.multiview.scene import DeviationSpread, JointMotion
from imocap_core.motion.state import mirrored_joints
from imocap_core.params import Params, SyncParams
from imocap_core.params.motion_params import MotionParams, RefineParams
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.sync import Hints
from imocap_core.sync import screened as screening_of
from imocap_core.sync.screening.screening import Screening, corrected, sentences
from stages import refine_sync
from tests.made_sync import stored_matrix, trust_in
from tests.report.made import K, Made

FRAMES = 50
QUICK = Params(
    sync=SyncParams(consensus_rounds=1),
    motion=MotionParams(rounds=1, max_steps=3),
    refine=RefineParams(max_rounds=1),
)


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
        made.keypoints, made.camera_motion, made.initial, QUICK.sync, Hints(), np.ones(3),
        by_pictures=True, event=False, sound_start_s=None, declared=[None] * 3,
        rng=lambda: np.random.default_rng(0),
    )  # fmt: skip


def begun(made: Made) -> tuple[LoopBeginning, Sync | None, JointProblem, JointMotion]:
    first = summary_of(made.sync)
    params = Params()
    given = (made.keypoints, made.camera_motion, made.initial, first, params.fit, params.motion)
    problem = problem_of(*given)
    motion = problem.solution(made.single)

    def never(sync: SyncSummary) -> tuple[JointProblem, JointMotion]:
        raise AssertionError("the videos are the same")

    loop_sync = loop_sync_of(made)
    begin = LoopRound(first, motion, 1.0, 0.0)
    beginning, sync = loop_sync.beginning(problem, begin, never)
    after = loop_sync.of_motion(beginning, beginning.single_pass.motion)
    assert after.reference == beginning.single_pass.sync.reference
    return beginning, sync, problem, motion


@pytest.mark.parametrize("chosen", [0, pytest.param(1, marks=pytest.mark.long)])
def test_the_axis_stays_on_the_same_video_and_where_single_motions_tell_another_cycle(
    made, choose, monkeypatch, chosen
):
    choose(chosen)
    again = LoopSync._of_monocular_motions

    def a_cycle_off(loop: LoopSync, *given: Any) -> Sync:
        *same, last = again(loop, *given).maps
        last = last.model_copy(update={"reference_frame": last.reference_frame + 10})
        return again(loop, *given).model_copy(update={"maps": [*same, last]})

    monkeypatch.setattr(LoopSync, "_of_monocular_motions", a_cycle_off)
    beginning, sync, problem, motion = begun(made)
    assert not beginning.moved
    assert beginning.problem is problem
    assert beginning.single_pass.motion is motion
    assert sync.reference == "v1"


def test_the_axis_moves_with_the_first_correspondences_and_the_cameras(made, choose):
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


def inputs_of(made: Made, first: Sync) -> Inputs:
    given = (made.keypoints, made.camera_motion, made.initial, first, made.single, made.again)
    return Inputs("refine_sync", {}, {type(x): x for x in given})


@pytest.mark.long
def test_the_stage_ends_on_the_new_axis_and_its_round_0_is_the_single_pass(
    made, choose, monkeypatch, tmp_path
):
    choose(2)
    monkeypatch.setattr(refine_sync, "with_ground", lambda motion, *_: motion)
    result = refine_sync.run(context(tmp_path), inputs_of(made, made.sync), QUICK)
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


@pytest.mark.long
def test_a_beginning_on_the_new_axis_that_stays_best_has_a_common_motion(
    made, choose, monkeypatch, tmp_path
):
    choose(2)
    monkeypatch.setattr(refine_sync, "with_ground", lambda motion, *_: motion)
    monkeypatch.setattr(
        refine_sync,
        "alternate",
        lambda begin, steps, **_: Alternation([begin], 0, steps.first_sync(), ""),
    )
    result = refine_sync.run(context(tmp_path), inputs_of(made, made.sync), QUICK)
    assert (result.best, result.motion.reference) == (1, "v3")
    assert result.motion.common is not None


@pytest.mark.long
def test_the_stage_solves_again_with_a_video_that_was_left_out(made, monkeypatch, tmp_path):
    monkeypatch.setattr(refine_sync, "with_ground", lambda motion, *_: motion)
    notes = ["v3 seems to show another action"]
    first = made.sync.model_copy(update={"excluded": ["v3"], "notes": notes})
    result = refine_sync.run(context(tmp_path), inputs_of(made, first), QUICK)
    assert result.rounds[0].sync.excluded == ["v3"]
    assert result.sync.excluded == []
    v3 = next(m for m in result.sync.maps if m.id == "v3")
    assert np.isfinite(v3.reference_frame).sum() > FRAMES - 6
    assert any(note.startswith("v3 at first seemed to show another") for note in result.sync.notes)
    R = {camera.id: camera.R for camera in result.motion.cameras}
    off = R["v3"] @ R["v1"].T @ (made.R[2] @ made.R[0].T).T
    assert np.degrees(np.arccos(np.clip((np.trace(off) - 1) / 2, -1, 1))) < 5


def spread(deviation_m: float, path_m: float) -> DeviationSpread:
    return DeviationSpread(np.full((2, 4, 3), deviation_m), np.full((2, 6), path_m))


def sync(frames: list[float], confidence: list[float]) -> Sync:
    identity = SyncMap(id="a", reference_frame=np.arange(4.0), confidence=np.ones(4))
    other = SyncMap(id="b", reference_frame=np.array(frames), confidence=np.array(confidence))
    return Sync(
        reference="a", ids=["a", "b"], lengths=[4, 4], maps=[identity, other], method="softmap",
        centrality=np.ones(2), status="made", **stored_matrix(np.eye(8), ["a", "b"], [4, 4]),
    )  # fmt: skip


FIRST = sync([0.0, np.nan, 2.0, 3.0], [0.5, 0.0, 0.7, 0.9])
LOOP = sync([0.0, 1.0, 2.0, 3.0], [0.9, 0.9, 0.4, 0.95])


@pytest.mark.parametrize(("deviation_m", "path_m"), [(0.03, 0.005), (0.003, 0.05)])
def test_of_differing_performances_the_less_sure_one_counts(deviation_m, path_m):
    result = with_independent_confidence(LOOP, FIRST, spread(deviation_m, path_m))
    np.testing.assert_allclose(result.maps[1].confidence, [0.5, 0.6, 0.4, 0.9])
    np.testing.assert_array_equal(result.maps[0].confidence, np.ones(4))
    np.testing.assert_array_equal(result.maps[1].reference_frame, LOOP.maps[1].reference_frame)


def test_of_one_motion_and_of_one_video_the_loop_s_own_counts() -> None:
    one = spread(0.003, 0.005)
    assert is_one_motion(one.keypoints_m, one.offset_sd)
    assert with_independent_confidence(LOOP, FIRST, spread(0.003, 0.005)) == LOOP
    assert with_independent_confidence(LOOP, FIRST, None) == LOOP


def test_a_video_without_any_match_before_is_not_sure() -> None:
    nowhere = sync([np.nan] * 4, [0.0] * 4)
    result = with_independent_confidence(LOOP, nowhere, spread(0.03, 0.05))
    np.testing.assert_array_equal(result.maps[1].confidence, np.zeros(4))


def test_nor_is_it_surer_of_what_the_reference_does_not_show() -> None:
    def with_phases(of: Sync, confidence: list[float] | None) -> Sync:
        given = with_repetition(of, 1.0)
        of_phase = None if confidence is None else np.array(confidence)
        videos = [v.model_copy(update={"phase_confidence": of_phase}) for v in given.trust.videos]
        return given.model_copy(update={"trust": SyncTrust(videos=videos, triples=[])})

    loop = with_phases(LOOP, [0.9, 0.2, 0.9, 0.9])
    first = with_phases(FIRST, [0.4, 0.4, 0.0, 1.0])
    result = with_independent_confidence(loop, first, spread(0.03, 0.05))
    np.testing.assert_allclose(result.trust.videos[1].phase_confidence, [0.4, 0.2, 0.0, 0.9])
    assert with_independent_confidence(loop, first, None) == loop
    unknown = with_independent_confidence(loop, with_phases(FIRST, None), spread(0.03, 0.05))
    assert unknown.trust == loop.trust


def with_repetition(of: Sync, ratio: float) -> Sync:
    """The second video fits 1.1 s later, its squared distances so many times as large."""
    first, second = trust_in({i: np.arange(4.0) for i in of.ids}).videos
    second = second.model_copy(update={"repetition_s": 1.1, "repetition_ratio": ratio})
    return of.model_copy(update={"trust": SyncTrust(videos=[first, second], triples=[])})


def test_what_repeats_the_monocular_motions_tell() -> None:
    before, after = with_repetition(FIRST, 1.05), with_repetition(LOOP, 1.5)
    result = with_first_repetitions(after, before)
    assert result.trust.videos[1].repetition_ratio == 1.05
    assert np.isnan(result.trust.videos[0].repetition_ratio)
    elsewhere = before.model_copy(update={"reference": "b"})
    assert with_first_repetitions(after, elsewhere) == after
    assert with_first_repetitions(LOOP, before) == LOOP


@pytest.fixture(scope="module")
def screened() -> Made:
    return Made(count=4, frames=FRAMES)


def first_of(screened: Made, **decided: list[str]) -> SyncSummary:
    first = SyncSummary.model_validate(
        {n: getattr(screened.sync, n) for n in SyncSummary.model_fields}
    )
    return first.model_copy(update=decided)


def again(
    screened: Made,
    first: SyncSummary,
    joints: list[np.ndarray] | None = None,
    keypoints: Keypoints | None = None,
    declared: list[bool | None] | None = None,
) -> SyncSummary | None:
    joints = joints or [motion.joints for motion in screened.true]
    evidence = evidence_of(joints, keypoints or screened.keypoints)
    evidence = replace(evidence, mirrored=declared or [None] * 4, rates=np.ones(4))
    return decided_again(first, screening_of(evidence, SyncParams()))


def test_nothing_changes_where_the_first_screening_was_right(screened: Made) -> None:
    assert again(screened, first_of(screened)) is None


def test_a_video_that_the_joint_motion_explains_takes_part_again(screened: Made) -> None:
    notes = [
        "v1 stands still",
        "v3 seems to show another action: the other videos explain each other and not it",
        "v4 seems to show another action: the other videos explain each other and not it",
        "only two videos are left, and with two it cannot be decided",
    ]
    decided = again(screened, first_of(screened, excluded=["v3", "v4"], notes=notes))
    assert decided.excluded == []
    assert [note.split(" ", 1)[0] for note in decided.notes] == ["v1", "v3", "v4"]
    assert all(note.endswith("explains it: it takes part") for note in decided.notes[1:])


def test_a_video_of_another_action_is_left_out(screened: Made) -> None:
    stranger = screened.keypoints.videos[3]
    rng = np.random.default_rng(2)
    away = gaussian_filter1d(rng.normal(0, 400.0, stranger.xy_px.shape), 6.0, axis=0)
    xy_px = stranger.xy_px + away - away.mean(axis=(0, 1))
    videos = [*screened.keypoints.videos[:3], stranger.model_copy(update={"xy_px": xy_px})]
    decided = again(screened, first_of(screened), keypoints=Keypoints(videos=videos))
    assert decided.excluded == ["v4"]
    assert decided.notes[-1].startswith("v4 seems to show another action")
    assert (
        again(screened, first_of(screened, excluded=["v4"]), keypoints=Keypoints(videos=videos))
        is None
    )


def test_a_mirrored_video_is_found_and_a_declared_one_left_alone(screened: Made) -> None:
    videos = list(screened.keypoints.videos)
    videos[2] = mirrored_keypoints(videos[2], K)
    joints = [motion.joints for motion in screened.true]
    joints[2] = mirrored_joints(joints[2])
    decided = again(screened, first_of(screened), joints, Keypoints(videos=videos))
    assert (decided.mirrored, decided.excluded) == (["v3"], [])
    assert "better reflected: treated as its mirror image" in decided.notes[-1]
    straight = again(screened, first_of(screened, mirrored=["v3"]))
    assert straight.mirrored == []
    assert straight.notes[-1].startswith("v3 at first seemed to be mirrored")
    assert (
        again(screened, first_of(screened, mirrored=["v3"]), declared=[None, None, True, None])
        is None
    )


def test_sentences_of_what_stays_decided_stay() -> None:
    margin, names = np.array([-0.5, 0.4, -0.5, -0.5]), ["v1", "v2", "v3", "v4"]
    screening = Screening((2,), (1,), (2,), (1,), np.array([0.1, 0.2, 1.4, 0.3]), margin, (3,))
    left_out, mirrored, undecided = sentences(screening, names)
    before, nothing = [left_out, mirrored, undecided, "v2 stands still"], list[str]()

    def after(changed: str, second: list[str]) -> list[str]:
        return corrected(before, second, changed=[changed], returned=nothing, straight=nothing)

    assert after("v3", nothing) == [mirrored, undecided, "v2 stands still"]
    assert after("v2", nothing) == [left_out, undecided, "v2 stands still"]
    assert after("v4", [left_out, "v4 seems to show another action: it does"]) == [
        left_out, mirrored, "v2 stands still", "v4 seems to show another action: it does",
    ]  # fmt: skip
