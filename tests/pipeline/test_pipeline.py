"""pipeline.yaml is the one truth of the graph; values in it override the parameters' defaults; the
example of a stage works."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from imocap_core.artifacts.store import Store
from imocap_core.cli import main
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.params import Params
from imocap_core.pipeline.graph import Pipeline, read_pipeline, settings
from imocap_core.pipeline.source import PROJECT

FILE = PROJECT / "pipeline.yaml"


@pytest.fixture
def content() -> dict[str, Any]:
    return yaml.safe_load(FILE.read_text())


@pytest.fixture
def pipeline() -> Pipeline:
    return read_pipeline(FILE)


def changed(tmp_path: Path, content: dict[str, Any]) -> Pipeline:
    file = tmp_path / "pipeline.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    return read_pipeline(file)


def test_the_paper_s_figure_is_in_the_graph(pipeline: Pipeline) -> None:
    names = (
        "keypoints camera_motion initial_smpl sync smpl_ba redetect refine_sync uncertainty hands "
        "evaluate"
    )
    assert list(pipeline.stages) == names.split()
    assert pipeline.upstream("sync")[-1] == "sync"
    assert "smpl_ba" not in pipeline.upstream("sync")
    assert pipeline.upstream("evaluate") == names.split()


def test_every_script_is_there(pipeline: Pipeline) -> None:
    for name in pipeline.stages:
        assert pipeline.script(name).is_file()


def test_no_default_lives_in_the_file(pipeline: Pipeline, content: dict[str, Any]) -> None:
    assert content["params"] == {}
    assert pipeline.params == Params()


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (
            ("stages", "sync", "inputs"),
            ["smpl_ba"],
            "sync.inputs: expected earlier stages (keypoints",
        ),
        (
            ("stages", "sync", "params"),
            ["zync"],
            "sync.params: expected groups of parameters (detect",
        ),
        (("stages", "sync", "reads"), ["truth"], "sync.reads: only evaluate may read truth"),
        (("stages", "sync", "reads"), ["mail"], "stages.sync.reads.0: expected"),
        (("seed",), "seven", "seed: expected a valid integer"),
        (("params", "sync"), {"method": "magic"}, "params: sync.method: expected 'als'"),
        (("params", "sync"), {"rounds": 0}, "params: sync.rounds: expected greater than"),
        (
            ("params", "sync"),
            {"magic": 1},
            "params: sync.magic: unknown parameter; expected one of method",
        ),
        (
            ("params", "magic"),
            {},
            "params: magic: unknown group of parameters; expected one of detect, ",
        ),
    ],
)
def test_faults_are_named(tmp_path, content, path, value, said):
    place = content
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    with pytest.raises(WorkFailed) as caught:
        changed(tmp_path, content)
    assert said in str(caught.value)


def test_a_file_that_lists_every_value_overrides_the_defaults(tmp_path, content):
    content["params"] = asdict(Params())
    content["params"]["sync"]["max_rate"] = 8
    pipeline = changed(tmp_path, content)
    assert pipeline.params.sync.max_rate == 8.0
    assert isinstance(pipeline.params.sync.max_rate, float)
    assert replace(pipeline.params, sync=Params().sync) == Params()


def test_an_empty_section_or_none_gives_the_defaults(tmp_path, content):
    content["params"] = None
    assert changed(tmp_path, content).params == Params()
    del content["params"]
    assert changed(tmp_path, content).params == Params()


def test_the_nearer_override_wins(pipeline: Pipeline) -> None:
    file = Path("action.yaml")
    own = {"sync": {"method": "als"}, "seed": 3}
    assert settings(pipeline, {}, file, []).seed == pipeline.seed
    assert settings(pipeline, own, file, []).params.sync.method == "als"
    once = settings(pipeline, own, file, ["sync.method=svt", "seed=4"])
    assert (once.params.sync.method, once.seed) == ("svt", 4)
    unchanged = settings(pipeline, own, file, []).params
    assert unchanged.motion == settings(pipeline, {}, file, []).params.motion


def test_who_is_at_fault_is_told(pipeline: Pipeline) -> None:
    file = Path("actions/a/action.yaml")
    with pytest.raises(WorkFailed, match=r"action\.yaml: params: sync\.method"):
        settings(pipeline, {"sync": {"method": "x"}}, file, [])
    with pytest.raises(WorkFailed, match=r"expected 'name: value' pairs, got 3"):
        settings(pipeline, {"sync": 3}, file, [])
    with pytest.raises(WrongUse, match=r"--set: sync\.method"):
        settings(pipeline, {}, file, ["sync.method=x"])


@pytest.mark.parametrize("value", ["9" * 5000, "[" * 100_000, "!!python/name:os.system", "{"])
def test_a_set_that_is_no_value_names_its_parameter(pipeline: Pipeline, value: str) -> None:
    with pytest.raises(WrongUse, match=r"^--set sync\.rank: expected a YAML value") as refusal:
        settings(pipeline, {}, Path("actions/a/action.yaml"), [f"sync.rank={value}"])
    assert len(str(refusal.value)) < 300


ACTION = """\
name: clip
videos:
  - {id: v1, keypoints: v1.npz, format: npz, layout: coco17, fps: 30, size: [640, 360]}
"""


def test_the_example_runs_and_its_artifact_is_stored(tmp_path, monkeypatch):
    example = (PROJECT / "examples" / "visibility.py").read_text()
    block = example.split("pipeline.yaml has it:\n")[1].split('"""')[0]
    graph = yaml.safe_load((PROJECT / "pipeline.yaml").read_text())
    added = yaml.safe_load(block)["stages"]
    graph["stages"] = {"keypoints": graph["stages"]["keypoints"], **added}
    (tmp_path / "pipeline.yaml").write_text(yaml.safe_dump(graph, sort_keys=False))
    (tmp_path / "stages").mkdir()
    (tmp_path / "stages" / "visibility.py").write_text(example)

    person = np.random.default_rng(0).uniform([300, 100, 0.9], [360, 260, 0.9], size=(17, 3))
    keypoints = np.tile(person, (10, 1, 1))
    keypoints[:5, 9] = (np.nan, np.nan, 0.0)  # one joint, unseen in half of the frames
    folder = tmp_path / "actions" / "clip"
    folder.mkdir(parents=True)
    np.savez(folder / "v1.npz", keypoints=keypoints)
    (folder / "action.yaml").write_text(ACTION)

    (name,) = added
    monkeypatch.setenv("IMOCAP_ALLOW_SCRIPTS", "")  # which the option changes
    assert main(["--root", str(tmp_path), "--allow-scripts", "stage", name, "clip"]) == 0
    stored = Store(tmp_path / "artifacts").load("clip", name)
    shares = json.loads(stored.content.header)["share_visible"]["v1"]
    assert shares[9] == 0.5
    assert shares[:9] + shares[10:] == [1.0] * 16
