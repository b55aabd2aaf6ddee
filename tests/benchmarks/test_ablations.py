"""The ablations: variants as data, what they share, what their differences say."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import ablation_variants, ablations
from benchmarks.ablation_variants import VARIANTS, VariantRun, chosen_variants
from benchmarks.actions.captured_videos import Choice
from benchmarks.scoring import LAST, SINGLE, ActionScore, Cost
from benchmarks.tables import PA, SCALED, SYNC
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.graph import read_pipeline, settings
from imocap_core.pipeline.source import PROJECT
from imocap_core.workspace import Workspace
from tests.benchmarks.test_tcc import swinging_video

BY_NAME = {variant.name: variant for variant in VARIANTS}


def made_score(variant: str, action: str, value: float) -> ActionScore:
    numbers = {BY_NAME[variant].result: {SCALED: value, PA: value / 2, SYNC: value / 100}}
    stages = (*SINGLE, "redetect", LAST)
    return ActionScore(action, 4, 300, numbers, dict.fromkeys(stages, Cost(10.0, 1.0)), variant)


def scores_of(**values: list[float]) -> ablations.VariantScores:
    return {
        name: {f"a{k}": made_score(name, f"a{k}", v) for k, v in enumerate(row)}
        for name, row in values.items()
    }


# --- variants


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: v.name)
def test_every_switch_is_a_parameter_of_the_pipeline(variant) -> None:  # type: ignore[no-untyped-def]
    pipeline = read_pipeline(PROJECT / "pipeline.yaml")
    chosen = settings(pipeline, {}, Path("action.yaml"), list(variant.run.sets))
    assert chosen.seed == pipeline.seed


def test_variants_are_chosen_by_name_and_by_what_the_data_allow() -> None:
    assert [v.name for v in chosen_variants("trials", ("tcc", "default"))] == ["default", "tcc"]
    assert len(chosen_variants("protocol", ())) == len(VARIANTS)
    on_yoga = {v.name for v in chosen_variants("yoga", ())}
    assert {"default", "tcc", "one_model"} <= on_yoga
    assert not {"videos_1", "generic", "outlier"} & on_yoga
    on_h36m = {v.name for v in chosen_variants("h36m", ())}
    assert "videos_2" in on_h36m
    assert not {"generic", "outlier"} & on_h36m
    with pytest.raises(WrongUse, match="--variants dance: trials has estimator, monocular"):
        chosen_variants("trials", ("dance",))


def test_runs_share_a_folder_when_their_inputs_agree() -> None:
    base = Choice("trials", only=("x",))
    plain = ablations.choice_of(base, VariantRun())
    assert plain == ablations.choice_of(base, VariantRun(("motion.rank=2",)))
    assert plain.folder(Path()) == Choice("trials").folder(Path())  # the plain benchmark's
    others = [VariantRun(videos=2), VariantRun(detector="generic"), VariantRun(outlier=True)]
    assert len({ablations.choice_of(base, r).label for r in others} | {plain.label}) == 4
    labels = [v.run.label for v in VARIANTS if v.run.sets]
    assert all("/" not in label and label for label in labels)
    assert len(set(labels)) == len(labels)


# --- claims


def test_differences_are_paired_by_action() -> None:
    scores = scores_of(default=[10.0, 20.0], no_iteration=[11.0, 23.0, 99.0])
    claim = ablations.Claim("x", "default", "no_iteration", (SCALED,))
    assert ablations.differences(claim, SCALED, scores) == [1.0, 3.0]


def test_fewer_videos_are_compared_on_those_that_both_have() -> None:
    scores = scores_of(videos_2=[10.0], videos_1=[15.0])
    score = scores["videos_2"]["a0"]
    score.numbers["after loop, first 1"] = {SCALED: 12.0}
    claim = ablations.Claim("x", "videos_2", "videos_1", (SCALED,), common=1)
    assert ablations.differences(claim, SCALED, scores) == [3.0]


def test_a_verdict_needs_two_standard_errors() -> None:
    assert ablations.verdict([1.0, 1.1, 0.9]) == "confirmed"
    assert ablations.verdict([-1.0, -1.1, -0.9]) == "refuted"
    assert ablations.verdict([1.0, -1.1, 0.9]) == "undecided"
    assert ablations.verdict([5.0]) == "undecided"


def test_every_claim_speaks_of_variants_that_there_are() -> None:
    for claim in (*ablations.PAPER_CLAIMS, *ablations.OUR_CLAIMS):
        assert {claim.better, claim.worse} <= set(BY_NAME)


# --- running


def test_variants_that_fail_leave_the_others_and_say_so(tmp_path, monkeypatch):
    def scored(display, workspace, base, name, variant):  # type: ignore[no-untyped-def]
        if variant.name == "rank_2":
            raise WorkFailed("rank 2 broke")
        return made_score(variant.name, name, 40.0)

    monkeypatch.setattr(ablations, "_score", scored)
    monkeypatch.setattr(ablations, "action_names", lambda root, base: ["walk", "jump"])
    monkeypatch.setattr(ablations, "chosen_names", lambda root, base: ["walk"])
    with pytest.raises(WorkFailed, match="walk, rank_2: rank 2 broke"):
        ablations.measure(Workspace(tmp_path), Choice("trials"), ("default", "rank_2"), None)  # type: ignore[arg-type]
    text = (tmp_path / "artifacts/benchmark/ablations-trials/table.md").read_text()
    assert "| default | 40.0 | – |" in text
    assert "rank_2" in text.split("Missing")[1]


def test_the_equal_stretch_goes_from_end_to_end() -> None:
    keypoints = Keypoints(videos=[swinging_video("a", 5), swinging_video("b", 9)])
    sync = ablation_variants.stretched(keypoints, "b")
    np.testing.assert_allclose(sync.maps[0].reference_frame, [0, 2, 4, 6, 8])
    np.testing.assert_allclose(sync.maps[1].reference_frame, np.arange(9))
