"""pipeline.yaml is the one truth of the graph and of every default."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import BaseModel

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.params import Group, Params
from imocap_core.pipeline.graph import Pipeline, read_pipeline, settings
from imocap_core.pipeline.source import PROJECT

FILE = PROJECT / "pipeline.yaml"


@pytest.fixture
def content() -> dict[str, Any]:
    return yaml.safe_load(FILE.read_text())


@pytest.fixture
def pipeline() -> Pipeline[Params]:
    return read_pipeline(FILE, Params)


def changed(tmp_path: Path, content: dict[str, Any]) -> Pipeline[Params]:
    file = tmp_path / "pipeline.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    return read_pipeline(file, Params)


def test_the_paper_s_figure_is_in_the_graph(pipeline: Pipeline[Params]) -> None:
    names = (
        "keypoints camera_motion initial_smpl sync smpl_ba refine_sync uncertainty hands evaluate"
    )
    assert list(pipeline.stages) == names.split()
    assert pipeline.upstream("sync")[-1] == "sync"
    assert "smpl_ba" not in pipeline.upstream("sync")
    assert pipeline.upstream("evaluate") == names.split()


def test_every_script_is_there(pipeline: Pipeline[Params]) -> None:
    for stage in pipeline.stages:
        assert pipeline.script(stage).is_file()


def test_no_default_lives_in_code() -> None:
    groups = [f.annotation for f in Params.model_fields.values()]
    for group in groups:
        assert isinstance(group, type)
        assert issubclass(group, Group)
    models: list[type[BaseModel]] = [Params, *groups]  # type: ignore[list-item]
    for model in models:
        assert all(field.is_required() for field in model.model_fields.values()), model.__name__


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("stages", "sync", "inputs"), ["smpl_ba"], "sync.inputs: 'smpl_ba' is no stage before it"),
        (("stages", "sync", "params"), ["zync"], "sync.params: 'zync' is no group of params"),
        (("stages", "sync", "reads"), ["truth"], "sync.reads: truth is for evaluate alone"),
        (("stages", "sync", "reads"), ["mail"], "stages.sync.reads.0: Input should be"),
        (("seed",), "seven", "seed: Input should be a valid integer"),
        (("params", "sync", "method"), "magic", "params: sync.method: Input should be 'als'"),
        (("params", "sync", "magic"), 1, "params: sync.magic: is no known field"),
    ],
)
def test_faults_are_named(
    tmp_path: Path, content: dict[str, Any], path: tuple[str, ...], value: Any, said: str
) -> None:
    place = content
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    with pytest.raises(WorkFailed) as caught:
        changed(tmp_path, content)
    assert said in str(caught.value)


def test_a_missing_value_is_named(tmp_path: Path, content: dict[str, Any]) -> None:
    del content["params"]["sync"]["method"]
    with pytest.raises(WorkFailed, match=r"params: sync\.method: is missing"):
        changed(tmp_path, content)


def test_the_nearer_override_wins(pipeline: Pipeline[Params]) -> None:
    file = Path("action.yaml")
    own = {"sync": {"method": "als"}, "seed": 3}
    assert settings(pipeline, {}, file, []).seed == pipeline.seed
    assert settings(pipeline, own, file, []).params.sync.method == "als"
    once = settings(pipeline, own, file, ["sync.method=svt", "seed=4"])
    assert (once.params.sync.method, once.seed) == ("svt", 4)
    unchanged = settings(pipeline, own, file, []).params
    assert unchanged.motion == settings(pipeline, {}, file, []).params.motion


def test_who_is_at_fault_is_told(pipeline: Pipeline[Params]) -> None:
    file = Path("actions/a/action.yaml")
    with pytest.raises(WorkFailed, match=r"action\.yaml: params: sync\.method"):
        settings(pipeline, {"sync": {"method": "x"}}, file, [])
    with pytest.raises(WorkFailed, match=r"expected 'name: value' pairs, got 3"):
        settings(pipeline, {"sync": 3}, file, [])
    with pytest.raises(WrongUse, match=r"--set: sync\.method"):
        settings(pipeline, {}, file, ["sync.method=x"])
