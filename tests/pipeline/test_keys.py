"""A key changes when, and only when, something that the result depends on does."""

import dataclasses
from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed
from imocap_core.pipeline.keys import differences
from imocap_core.pipeline.source import content_digest
from imocap_core.pipeline.stage import Recipe

RECIPE = Recipe(
    code={"stages.sync": "c1", "imocap_core.sync.warp.dtw": "c2"},
    params={"sync": {"method": "als", "rank": 3}},
    seed=7,
    inputs={"initial_smpl": "i1"},
    reads={"videos v1": "r1"},
)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"code": {"stages.sync": "c1"}}, ["code: imocap_core.sync.warp.dtw is gone"]),
        ({"code": {**RECIPE.code, "new": "c3"}}, ["code: new is new"]),
        ({"params": {"sync": {"method": "svt", "rank": 3}}}, ["sync.method: als -> svt"]),
        ({"params": {"sync": {"method": "als"}}}, ["sync.rank: 3 -> absent"]),
        ({"seed": 8}, ["seed: 7 -> 8"]),
        ({"inputs": {"initial_smpl": "i2"}}, ["input: initial_smpl has changed"]),
        ({"reads": {"videos v1": "r2"}}, ["read: videos v1 has changed"]),
        ({"format": 0}, ["the way artifacts are made has changed"]),
    ],
)
def test_each_part_counts_and_is_named(change: dict[str, object], said: list[str]) -> None:
    now = dataclasses.replace(RECIPE, **change)
    assert now.key != RECIPE.key
    assert differences(RECIPE.provenance(), now) == said


def test_order_does_not_count() -> None:
    turned = dataclasses.replace(
        RECIPE,
        code=dict(reversed(RECIPE.code.items())),
        params={"sync": {"rank": 3, "method": "als"}},
    )
    assert turned.key == RECIPE.key
    assert differences(RECIPE.provenance(), turned) == []


def test_a_folder_is_its_files_and_their_names(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        (folder / "sub").mkdir(parents=True)
        (folder / "a.json").write_text("1")
        (folder / "sub" / "b.json").write_text("2")
    assert content_digest(one) == content_digest(two)
    (two / "sub" / "b.json").rename(two / "b.json")
    assert content_digest(one) != content_digest(two)
    with pytest.raises(WorkFailed, match="cannot read"):
        content_digest(tmp_path / "nowhere")
