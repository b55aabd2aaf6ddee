"""What is exported is of one run, and of the action as it is now; anything else is refused."""

from __future__ import annotations

import shutil

import pytest

from imocap_core.artifacts.schemas import Hands
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.generation import generation
from imocap_core.result.artifacts import artifacts_of_stages
from imocap_core.workspace import Workspace
from tests.pipeline.conftest import Toy

ALS = "sync.method=als"
NO_HANDS = Hands(videos=[], model="", model_digest="", size=1.0, status="")


def digests(toy: Toy, *sets: str, action: str = "toy") -> dict[str, str]:
    """Of the results that a reader would use, the scoring apart."""
    stored = generation(Workspace(toy.root).job(action, list(sets)), list(sets))
    return {stage: result.digest for stage, result in stored.items()}


def refusal(toy: Toy, *sets: str, action: str = "toy") -> str:
    with pytest.raises(WorkFailed) as failed:
        digests(toy, *sets, action=action)
    return str(failed.value)


def test_a_run_s_results_are_read_and_a_variant_s_on_purpose(toy: Toy) -> None:
    assert digests(toy) == {}
    toy.imocap(["run", "toy"])
    plain = digests(toy)
    assert list(plain) == ["gather", "scale"]
    toy.imocap(["run", "toy", "--set", ALS])
    text = refusal(toy)
    assert "scale: sync.method: als -> softmap" in text
    assert "Bring them up to date: imocap run toy;" in text
    assert text.endswith('the parameters that they were made with: --set sync.method="als"')
    variant = digests(toy, ALS)
    assert variant["scale"] != plain["scale"]
    toy.imocap(["run", "toy"])
    assert digests(toy) == plain
    assert digests(toy, ALS) == variant  # still in the cache
    assert "imocap run toy --set sync.method=svt" in refusal(toy, "sync.method=svt")


def test_an_edited_input_makes_results_stale_until_it_is_as_before(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    plain = digests(toy)
    (toy.action / "v2.txt").write_text("3.5")
    assert "gather: read: detections v2 has changed" in refusal(toy)
    assert "--set" not in refusal(toy)
    (toy.action / "v2.txt").write_text("2.5")
    assert digests(toy) == plain
    (toy.action / "v2.txt").unlink()  # put away: nothing says that it is another one
    assert digests(toy) == plain


def test_an_interrupted_run_leaves_a_mixture_that_is_refused(toy, monkeypatch):
    toy.imocap(["run", "toy"])
    (toy.action / "v2.txt").write_text("3.5")
    monkeypatch.setenv("TOY_SCALE", "bad")
    assert toy.imocap(["run", "toy"]) == 1
    assert "scale: input: gather has changed" in refusal(toy)


def test_two_folders_of_one_name_are_told_apart(toy: Toy) -> None:
    second = toy.root / "elsewhere"
    shutil.copytree(toy.action, second)
    (second / "v1.txt").write_text("9")
    toy.imocap(["run", "toy"])
    text = refusal(toy, action=str(second))
    assert "gather: read: detections v1 has changed" in text
    assert f"imocap run {second}" in text


def test_a_result_of_another_action_is_refused(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    second = toy.root / "actions" / "other"
    shutil.copytree(toy.action, second)
    text = (second / "action.yaml").read_text().replace("name: toy", "name: other")
    (second / "action.yaml").write_text(text)
    (second / "v1.txt").write_text("9")
    toy.imocap(["run", "other"])
    folder = toy.root / "artifacts"
    shutil.copy(folder / "other" / "scale.mcap", folder / "toy" / "scale.mcap")
    assert "scale: input: gather has changed" in refusal(toy)
    store = Workspace(toy.root).store
    artifacts = artifacts_of_stages(
        "toy", {s: r for s in ("gather", "scale") if (r := store.load("toy", s))}
    )
    artifacts.stored("gather")
    with pytest.raises(WorkFailed, match="scale was made from another gather than the one beside"):
        artifacts.stored("scale")
    unmarked = store.put("scale", "anything", NO_HANDS, {}, {})
    store.publish("toy", "scale", unmarked)
    assert "scale: it does not say what it was made from" in refusal(toy)


def test_older_code_alone_makes_no_result_wrong(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    plain = digests(toy)
    script = toy.root / "toys" / "scale.py"
    script.write_text(script.read_text() + "\nUNUSED = 1\n")
    assert digests(toy) == plain
